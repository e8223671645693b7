"""All kinds of observation in a sequential block: residuals and redundancy numbers are those of the adjustment."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import OFF, directions_from, noisy, redefined, solved

from orip.bundle.solve import SolvedBlock
from orip.online.sequential.observation_rows import ObservationKey, ReducedColumns, linearised, tied_points
from orip.online.sequential.sequential_block import SequentialBlock
from orip.records.block import Block
from orip.records.control import ControlDistance, ControlElement, Station
from orip.records.observation_kinds import OBSERVATION_KINDS
from orip.structs import replace

MADE = aerial_block("one after the other", 6)


def _block() -> Block:
    """Return a block with a distance, directions, observed elements, a station with its attitude and an unknown C."""
    block = redefined(noisy(MADE, 3), **OFF)
    block = directions_from(MADE, block, "101", ["104", "110", "115"])
    place = block.point_index()
    length = float(np.linalg.norm(MADE.points[place["102"]] - MADE.points[place["109"]]))
    x0, kappa = MADE.orientations[2, 0], np.degrees(MADE.orientations[2, 5])
    return replace(
        block,
        cameras=tuple(replace(camera, unknown=("C",)) for camera in block.cameras),
        distances=(ControlDistance("D1", "102", "109", "XYZ", length + 0.02, 0.01),),
        elements=(
            ControlElement("P3", "PHOTO", "X0", float(x0) + 0.03, 0.05),
            ControlElement("P3", "PHOTO", "KAPPA", float(kappa), 0.001),
        ),
        stations=(
            Station(
                "P5", tuple((MADE.orientations[4, :3] + 0.02).tolist()), (0.02,) * 3,
                tuple(np.degrees(MADE.orientations[4, 3:]).tolist()), (0.002,) * 3,
            ),
        ),
    )  # fmt: skip


def _sequential(found: SolvedBlock, block: Block) -> SequentialBlock[ObservationKey]:
    """Return the observations of a solved block, taken in one after the other."""
    columns, made = ReducedColumns(), SequentialBlock[ObservationKey]()
    rows = linearised(block, found.state, tied_points(block), columns)
    made.append(len(columns.names))
    for key, equations in rows.items():
        made.include(key, equations)
    return made


@pytest.fixture(scope="module")
def both() -> tuple[SolvedBlock, SequentialBlock[ObservationKey]]:
    block = _block()
    found = solved(block)
    return found, _sequential(found, block)


def test_block_has_all_kinds_that_can_be_observed(both) -> None:
    kinds = {key.kind for key in both[1].included}
    assert kinds == {"photo", "control", "element", "distance", "direction", "station", "attitude"}
    assert kinds <= set(OBSERVATION_KINDS)


def test_square_sum_and_redundancy_are_those_of_the_adjustment(both) -> None:
    found, made = both
    rest = found.equations.residual[found.equations.active]
    # the adjustment ends with corrections of 1e-4 standard deviations; the sum depends on their square
    assert made.square_sum == pytest.approx(float(rest @ rest), rel=1e-6)
    assert made.redundancy == found.variance.redundancy
    # what is left to correct is less than that
    assert np.abs(made.triangle.solution()).max() < 1e-3


def test_redundancy_numbers_are_those_of_the_adjustment(both) -> None:
    found, made = both
    expected: dict[str, list[float]] = {}
    first = 0
    for kind in found.problem.observations:
        part = slice(first, first + len(kind.rows.error))
        expected[kind.rows.kind.name] = (1.0 - found.cofactors.leverage[part]).tolist()
        first = part.stop
    of_kinds: dict[str, list[float]] = {}
    for key in made.included:
        of_kinds.setdefault(key.kind, []).extend(made.standing(key).redundancy.tolist())
    for kind, values in of_kinds.items():
        # cofactors from normal equations have half the digits of those from R
        assert values == pytest.approx(expected[kind], abs=1e-7), kind


def test_each_observation_predicts_the_fall_of_the_square_sum(both) -> None:
    """Taking an observation out lowers the square sum by its test quantity, whichever kind it is."""
    _, made = both
    firsts = {key.kind: key for key in reversed(made.included)}
    for key in firsts.values():
        rows, before, (fall, _) = made.included[key], made.square_sum, made.standing(key).square()
        made.exclude(key)
        assert before - made.square_sum == pytest.approx(fall, rel=1e-6, abs=1e-8)
        assert made.trial(key, rows).square()[0] == pytest.approx(fall, rel=1e-6, abs=1e-8)
        left = made.include(key, rows)
        assert float(left @ left) == pytest.approx(fall, rel=1e-6, abs=1e-8)


def test_leftover_of_a_ray_is_its_normalised_residual_in_the_adjustment_with_it() -> None:
    block = redefined(noisy(MADE, 5), **OFF)
    found = solved(block)
    made = _sequential(found, block)
    key = next(key for key in made.included if key.kind == "photo" and key.point == "108")
    rows = made.included[key]
    made.exclude(key)
    trial, leftovers = made.trial(key, rows), made.include(key, rows)
    place = list(zip(found.problem.observations[0].rows.photo, found.problem.observations[0].rows.point, strict=True))
    y = place.index((key.photo, key.point)) + 1
    expected = found.equations.residual[y] / np.sqrt(1.0 - found.cofactors.leverage[y])
    assert abs(leftovers[1]) == pytest.approx(abs(expected), abs=1e-6)
    assert trial.normalised()[1] == pytest.approx(expected, abs=1e-6)


def test_a_constant_distance_counts_as_in_the_adjustment() -> None:
    block = _block()
    block = replace(block, distances=(replace(block.distances[0], error=0.0),))
    found = solved(block)
    made = _sequential(found, block)
    key = next(key for key in made.included if key.kind == "constant distance")
    assert made.included[key].exact
    assert made.redundancy == found.variance.redundancy
    assert np.abs(made.triangle.solution()).max() < 1e-3


def test_two_rays_cannot_be_told_apart() -> None:
    """With two rays, an error across the base is seen but not located: both residuals are one."""
    block = redefined(noisy(MADE, 5), **OFF)
    made = _sequential(solved(block), block)
    rays = [key for key in made.included if key.kind == "photo" and key.point == "108"]
    for key in rays[2:]:
        made.exclude(key)
    (correlation,) = made.correlations(rays[0], rays[1:2])
    assert np.abs(correlation).max() == pytest.approx(1.0, abs=1e-2)
    more = _sequential(solved(block), block)
    assert max(np.abs(one).max() for one in more.correlations(rays[0], rays[1:])) < 0.9
