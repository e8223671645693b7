"""Control that is less precise than is said is found in X, Y and Z together, and no single point of it is accused."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.bundle.groups.words import CODE
from orip.records.block import Block
from orip.records.results.solution import Diagnosis
from orip.solving.solve import solve
from orip.structs import replace

NOISE_MM = 0.005


def block_of(seed: int, factor: float) -> Block:
    """Return a block whose control has a-priori errors too small by a factor."""
    made = synthetic_block("convergent", f"control {seed}", noise_mm=NOISE_MM, precision_mm=NOISE_MM)
    points = tuple(
        replace(point, errors=tuple(error / factor for error in point.errors)) for point in made.block.control_points
    )
    return replace(made.block, photo_orientation=made.orientations, point_start=made.points, control_points=points)


def first_of_groups(block: Block) -> Diagnosis | None:
    solution, _ = solve(block)
    return next((one for one in solution.diagnosis if one.code == CODE), None)


@pytest.mark.parametrize("seed", range(8))
def test_control_of_a_third_of_its_precision_is_said_as_a_whole(seed: int) -> None:
    found = first_of_groups(block_of(seed, 3.0))
    assert found is not None
    assert found.where.endswith("control points")
    assert "times their a-priori errors" in found.text
    assert "less precise than is said" in found.remedy


@pytest.mark.parametrize("seed", range(8))
def test_control_as_precise_as_is_said_is_not_accused(seed: int) -> None:
    assert first_of_groups(block_of(seed, 1.0)) is None


@pytest.mark.parametrize("seed", range(4))
def test_a_single_wrong_point_is_still_named(seed: int) -> None:
    block = block_of(seed, 1.0)
    wrong, *others = block.control_points
    shift = np.array([0.0, 0.0, 12.0 * wrong.errors[2]])
    moved = replace(wrong, coordinates=tuple((np.array(wrong.coordinates) + shift).tolist()))
    solution, _ = solve(replace(block, control_points=(moved, *others)))
    assert wrong.name in f"{solution.verdict} {solution.warnings} {solution.diagnosis}"
    assert not any("less precise" in one.remedy for one in solution.diagnosis)
