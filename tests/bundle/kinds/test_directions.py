"""Theodolite directions and zenith angles."""

from __future__ import annotations

import json

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import OFF, controlled, directions_from, noisy, redefined, rows, singular, solution, started_off

from orip.files.result.json_text import result_text
from orip.report.precision import zero_direction_table
from orip.structs import replace
from orip.workflow.adjust.results import results

MADE = aerial_block("directions", 6)
TARGETS = ("105", "111", "117", "123")


def block_with(**settings):
    block = redefined(noisy(MADE, 1), **OFF)
    return directions_from(MADE, block, settings.pop("station", "102"), settings.pop("targets", TARGETS), **settings)


def of_component(found, component):
    return [row for row in rows(found, "direction") if found.residuals.component[row] == component]


def test_directions_fit_and_their_zero_direction_is_found():
    found = solution(block_with())
    assert found.status == "converged"
    assert len(of_component(found, "direction")) == len(of_component(found, "zenith")) == len(TARGETS)
    assert found.residuals.point[of_component(found, "zenith")[0]] == "102-105"
    # five hundredths of a metre at a kilometre are three thousandths of a degree
    assert np.abs(found.residuals.residual[rows(found, "direction")]).max() < 0.004
    assert found.redundancy == solution(redefined(noisy(MADE, 1), **OFF)).redundancy + 2 * len(TARGETS) - 1


@pytest.mark.parametrize("zero", [40.0, 359.9995])
def test_the_zero_direction_is_told_with_its_precision(zero):
    found = solution(block_with(zero=zero))
    (direction,) = found.zero_directions
    assert direction.set == found.residuals.photo[rows(found, "direction")[0]]
    assert 0.0 <= direction.value < 360.0
    # every reading and its residual give the azimuth between the adjusted points
    place = block_with().point_index()
    for row in of_component(found, "direction"):
        station, target = found.residuals.point[row].split("-")
        dx, dy, _ = found.points.values[place[target]] - found.points.values[place[station]]
        reading = found.residuals.observed[row] + found.residuals.residual[row]
        difference = np.degrees(np.arctan2(dx, dy)) - reading - direction.value
        assert (difference + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)
    # four directions of a thousandth of a degree, and points of some centimetres at a kilometre
    assert 0.0003 < direction.sd < 0.01
    document = json.loads(result_text(found))
    assert document["theodolites"] == {direction.set: {"R": {"value": direction.value, "sd": direction.sd}}}
    lines = results(found, "theodolites", ()).text.splitlines()
    assert lines[-1].split()[0] == direction.set
    assert float(lines[-1].split()[1]) == pytest.approx(direction.value, abs=1e-3)
    assert zero_direction_table(found).columns[1].cells == [lines[-1].split()[1]]


def test_a_rotated_circle_turns_the_zero_direction_and_nothing_else():
    one, other = solution(block_with(zero=40.0)), solution(block_with(zero=359.9))
    assert np.allclose(one.points.values, other.points.values, atol=1e-7)
    assert np.allclose(one.residuals.residual, other.residuals.residual, atol=1e-7)


def test_precise_directions_make_their_points_precise():
    without = solution(redefined(noisy(MADE, 1), **OFF))
    found = solution(block_with(error=1e-4, zenith_error=1e-4))
    place = noisy(MADE, 1).point_index()
    for name in TARGETS:
        ratio = (found.points.sd / found.sigma0)[place[name]] / (without.points.sd / without.sigma0)[place[name]]
        assert ratio.max() < 1.0
        assert ratio[2] < 0.9
    adjusted = found.points.values[[place[name] for name in ("102", *TARGETS)]]
    offset, true = (
        adjusted[1:] - adjusted[0],
        MADE.points[[place[name] for name in TARGETS]] - MADE.points[place["102"]],
    )
    zenith = np.degrees(np.arctan2(np.hypot(*offset[:, :2].T), offset[:, 2]))
    assert np.allclose(zenith, np.degrees(np.arctan2(np.hypot(*true[:, :2].T), true[:, 2])), atol=3e-4)


def test_zenith_angles_take_the_place_of_height_control():
    # two control points along X leave the rotation about X, and heights across it fix it
    two = controlled(MADE, started_off(MADE, noisy(MADE, 1), 3), ("102", "104"))
    two = redefined(two, **OFF)
    assert len(singular(solution(two))) == 1
    found = solution(directions_from(MADE, two, "102", ("111", "117", "123"), error=0.001, zenith_error=0.001))
    assert singular(found) == []
    assert found.status == "converged"
    assert np.abs(found.points.values - MADE.points).max() < 1.0


def test_a_direction_along_the_line_cannot_fix_that_rotation():
    two = redefined(controlled(MADE, started_off(MADE, noisy(MADE, 1), 3), ("102", "104")), **OFF)
    found = solution(directions_from(MADE, two, "102", ("104",)))
    assert len(singular(found)) == 1


def test_a_constant_zero_direction_turns_a_block_that_one_point_and_heights_hold():
    block = redefined(started_off(MADE, noisy(MADE, 1), 3), **OFF)
    one = controlled(MADE, block, ("102",))
    found = solution(directions_from(MADE, one, "102", TARGETS, constant_zero=True))
    # scale alone is left
    assert len(singular(found)) == 1
    free = solution(directions_from(MADE, one, "102", TARGETS))
    assert len(singular(free)) == 2


@pytest.mark.parametrize("error", [-0.001, -5.0])
def test_disregarded_directions_are_listed_without_influence(error):
    without = solution(redefined(noisy(MADE, 1), **OFF))
    block = block_with(error=error, zenith_error=error)
    block = replace(
        block, directions=tuple(replace(direction, zenith=direction.zenith + 5.0) for direction in block.directions)
    )
    found = solution(block)
    zenith = of_component(found, "zenith")
    assert np.allclose(found.residuals.residual[zenith], -5.0, atol=0.01)
    assert np.isnan(found.residuals.weight_factor[rows(found, "direction")]).all()
    assert np.allclose(found.points.values, without.points.values, atol=1e-7)
    assert found.redundancy == without.redundancy
    # nothing determines the set's zero direction then, and it is the only one
    assert singular(found) == [("S", "R")]


def test_zenith_angles_alone_can_be_disregarded():
    found = solution(block_with(zenith_error=-0.001))
    assert found.redundancy == solution(block_with(zenith_error=None)).redundancy
    assert np.isnan(found.residuals.weight_factor[of_component(found, "zenith")]).all()
    assert (found.residuals.weight_factor[of_component(found, "direction")] == 1.0).all()


def test_two_sets_have_zero_directions_of_their_own():
    block = block_with()
    second = replace(
        block.theodolites[0],
        name="T",
        zero_direction=np.radians(100.5),
    )
    more = directions_from(MADE, block, "123", ("102", "111"), zero=100.0).directions
    both = replace(
        block,
        directions=block.directions + tuple(replace(direction, set="T") for direction in more),
        theodolites=(*block.theodolites, second),
    )
    found = solution(both)
    assert np.abs(found.residuals.residual[rows(found, "direction")]).max() < 0.004
    assert found.redundancy == solution(block).redundancy + 4 - 1
