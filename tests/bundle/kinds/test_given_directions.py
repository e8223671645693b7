"""Given directions from one point to another."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.kinds.direction_blocks import DIRECTION_ERROR, PAIRS, direction_block
from bundle.solving import OFF, redefined, rows, solution, solved

from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.structs import replace


def block_with(run=1, **settings):
    made = direction_block(run, **settings)
    return replace(made, block=replace(made.block, given_directions=())), made.block


def test_residuals_are_the_angles_to_the_adjusted_directions():
    made, block = block_with(**OFF)
    found = solution(block)
    assert found.redundancy == solution(made.block).redundancy + 2 * len(PAIRS)
    place = dict(zip(found.points.names, found.points.values, strict=True))
    mine = rows(found, "given direction")
    for number, line in enumerate(block.given_directions):
        along, given = place[line.end] - place[line.start], np.array(line.direction)
        cosine = along @ given / (np.linalg.norm(along) * np.linalg.norm(given))
        sine = np.linalg.norm(np.cross(along, given)) / (np.linalg.norm(along) * np.linalg.norm(given))
        two = found.residuals.residual[mine[2 * number : 2 * number + 2]]
        assert np.linalg.norm(two) == pytest.approx(np.degrees(np.arctan2(sine, cosine)), rel=1e-9)
        side = np.cross([0.0, 0.0, 1.0], given)
        expected = np.degrees(along @ side / np.linalg.norm(side) / np.linalg.norm(along))
        assert two[0] == pytest.approx(expected, abs=1e-6)


def test_a_direction_the_other_way_round_is_off_by_half_a_turn():
    _, block = block_with(noise=False, **OFF)
    first = block.given_directions[0]
    turned = replace(first, direction=tuple(-value for value in first.direction), error=-1.0)
    found = solution(replace(block, given_directions=(turned, *block.given_directions[1:])))
    mine = rows(found, "given direction")[:2]
    assert np.linalg.norm(found.residuals.residual[mine]) == pytest.approx(180.0, abs=0.05)
    assert np.isnan(found.residuals.weight_factor[mine]).all()


def test_precise_directions_make_points_precise_across_them():
    made, block = block_with(error=0.001, **OFF)
    found, without = solved(block), solved(made.block)
    columns = [one.problem.unknowns.points[made.block.point_index()["N2"]] for one in (found, without)]
    assert np.trace(found.cofactors.reduced[np.ix_(columns[0], columns[0])]) < 0.8 * np.trace(
        without.cofactors_of(columns[1])
    )


def test_directions_turn_a_free_network_and_leave_place_and_scale():
    _, block = block_with(**OFF)
    free = redefined(replace(block, control_points=()), datum="free")
    one = replace(free, given_directions=free.given_directions[:1])
    # about a single direction the block may still turn
    assert (solved(free).problem.defect, solved(one).problem.defect) == (4, 5)


def test_sigma0_is_1():
    found = [solved(block_with(run, **OFF)[1]) for run in range(20)]
    squares = redundancy = 0.0
    for one in found:
        kinds = np.array([part.rows.kind.name for part in one.problem.observations for _ in part.rows.photo])
        mine = kinds == "given direction"
        squares += float(np.sum(one.equations.residual[mine] ** 2))
        redundancy += float(np.sum(one.variance.redundancy_numbers[mine]))
        assert one.variance.redundancy_numbers.sum() == pytest.approx(one.variance.redundancy, abs=1e-6)
    assert np.sqrt(squares / redundancy) == pytest.approx(1.0, abs=0.15)


def test_a_wrong_direction_is_named():
    named = 0
    for run in range(10):
        _, clean = block_with(run, **OFF)
        number = solved(clean).variance.redundancy_numbers
        kinds = [one.rows for one in solved(clean).problem.observations]
        first = sum(len(one.photo) for one in kinds[: [one.kind.name for one in kinds].index("given direction")])
        size = 2.0 * 4.13 * DIRECTION_ERROR / np.sqrt(number[first])
        _, spoilt = block_with(run, wrong=size, **OFF)
        found = snoop(spoilt, SnoopingSettings("apriori"), lambda _: None, lambda: False)
        named += any(first in rows_ for one in found.findings for rows_ in (one.rows, *one.alternatives))
    assert named >= 9
