"""Heights from terrain models."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.kinds.terrain_blocks import HEIGHT_ERROR, hills, terrain_block
from bundle.solving import OFF, redefined, rows, solution, solved
from monte_carlo.grouped_blocks import verdict_of

from orip.bundle.groups.words import group_diagnosis
from orip.bundle.kinds.terrain_height import with_terrain_heights
from orip.bundle.snooping.findings import blunders_of, snooping_diagnosis, without_blunders
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.bundle.variance.groups import VarianceGroup, with_errors_times
from orip.errors import InputError
from orip.geometry.height_grid import surface_at
from orip.records.ground import TerrainModel
from orip.structs import replace


def described(block, **settings):
    """Return the block with other keys of its [[terrain]]."""
    (model,) = block.terrains
    return with_terrain_heights(replace(block, terrains=(replace(model, terrain=replace(model.terrain, **settings)),)))


def test_points_without_errors_lie_on_the_terrain():
    made = terrain_block(0, noise=False, **OFF)
    found = solved(made.block)
    assert np.abs(found.equations.residual).max() < 1e-6
    assert np.allclose(found.state.points, made.points, atol=1e-8)


def test_the_height_of_a_point_is_that_of_the_weighted_mean():
    """One point: closed form, the sequential least squares of its estimate without the model and of the height."""
    made = terrain_block(3, **OFF)
    row, name = 6, made.block.point_names[6]
    one = replace(made.block, terrain_heights=made.block.terrain_heights[row : row + 1])
    with_height, without = solved(one), solved(replace(one, terrain_heights=()))
    at = without.state.points[row]
    cofactors = without.cofactors_of(without.problem.unknowns.points[row])
    surface = surface_at(hills(), at[None, :2])
    partials = np.append(-surface.slope[0], 1.0)
    gain = cofactors @ partials / (HEIGHT_ERROR**2 + partials @ cofactors @ partials)
    expected = at - gain * (at[2] - surface.height[0])
    assert one.terrain_heights[0].point == name
    # what is neglected is the second order: slopes change by 0.6 per unit, over some millimetres
    assert np.allclose(with_height.state.points[row], expected, atol=2e-6)
    left = with_height.cofactors_of(with_height.problem.unknowns.points[row])
    assert np.allclose(left, cofactors - np.outer(gain, partials @ cofactors), rtol=0.0, atol=5e-3 * cofactors.max())


def test_heights_alone_determine_those_of_a_block_with_plan_control():
    made = terrain_block(1, **OFF)
    plan = tuple(
        replace(point, coordinates=(*point.coordinates[:2], None), errors=(*point.errors[:2], None))
        for point in made.block.control_points
    )
    found = solved(replace(made.block, control_points=plan))
    assert not found.normals.removed.any()
    assert np.abs(found.state.points[:, 2] - made.points[:, 2]).max() < 4.0 * HEIGHT_ERROR


def test_the_error_grows_with_the_slope():
    block = terrain_block(2, **OFF).block
    steep, _ = described(block, plan_error=0.02)
    slope = np.linalg.norm(surface_at(hills(), block.point_start[:, :2]).slope, axis=1)
    found = [one.error for one in steep.terrain_heights]
    assert np.allclose(found, np.sqrt(HEIGHT_ERROR**2 + (0.02 * slope) ** 2))
    # Monte Carlo: what a wrong place of the model changes of its heights, to the first order of the slope
    off = np.random.default_rng(5).normal(scale=0.02, size=(4000, 2))
    place = block.point_start[4, :2]
    change = surface_at(hills(), place + off).height - surface_at(hills(), place[None]).height
    assert np.sqrt(found[4] ** 2 - HEIGHT_ERROR**2) == pytest.approx(change.std(), rel=0.05)


def test_points_are_chosen_by_patterns_and_disregarded():
    block, warnings = described(terrain_block(0).block, points=("N1*", "N3"), disregard=("N17",))
    assert {one.point for one in block.terrain_heights} == {"N3", "N1", *(f"N{number}" for number in range(10, 20))}
    assert [one.point for one in block.terrain_heights if one.error < 0.0] == ["N17"]
    assert not warnings
    found = solution(redefined(block, **OFF))
    assert np.isnan(found.residuals.redundancy_number[rows(found, "terrain")]).sum() <= 1
    _, (warning,) = described(block, points=("X",))
    assert "has none of the points" in warning.text


def test_points_outside_and_in_holes_are_named():
    block = terrain_block(0).block
    (model,) = block.terrains
    heights = model.grid.heights.copy()
    heights[:, :24] = np.nan
    holed = TerrainModel(model.terrain, replace(model.grid, heights=heights))
    block, (warning,) = with_terrain_heights(replace(block, terrains=(holed,)))
    known = {one.point for one in block.terrain_heights}
    assert 0 < len(known) < 24
    # the first four columns beyond the hole lack a neighbour, one pixel of them each
    assert all((block.point_start[row, 0] > 0.5) == (f"N{row}" in known) for row in range(24)
               if abs(block.point_start[row, 0] - 0.5) > 0.3)  # fmt: skip
    assert f"{len(known)} of 24" in warning.text
    assert "without holes" in warning.text


def test_a_free_network_only_compares_them():
    block = redefined(replace(terrain_block(0, **OFF).block, control_points=()), datum="free")
    found = solved(block)
    (heights,) = [kind for kind in found.problem.observations if kind.rows.kind.name == "terrain"]
    assert not heights.rows.used.any()
    assert found.problem.defect == 7


def test_a_model_that_is_too_low_is_named_with_its_shift():
    block = terrain_block(4, shift=0.05).block
    _, verdict = verdict_of(block)
    (diagnosis, *_) = group_diagnosis(verdict.contradictions, "m")
    # as many control points are as precise: which of the two are off is not known
    assert diagnosis.text.startswith("the heights on terrain DTM and the Z of the control points contradict each other")
    assert verdict.contradictions[0].shift == pytest.approx(-0.05, abs=4.0 * verdict.contradictions[0].shift_sd)
    assert "height system" in diagnosis.remedy


def test_a_point_on_a_roof_is_left_out_and_told():
    block = terrain_block(5, wrong={9: 0.2}, **OFF).block
    found = snoop(block, SnoopingSettings("apriori", 1e-6), lambda _: None, lambda: False)
    (text,) = [one.text for one in snooping_diagnosis(found.solved, found.findings)]
    assert text.startswith("height of point N9 on terrain DTM contradicts the other observations; it is off by Z -0.")
    left = without_blunders(block, blunders_of(found.solved, found.findings))
    assert [one.point for one in left.terrain_heights if one.error < 0.0] == ["N9"]


def test_errors_are_multiplied_by_the_factor_of_the_model():
    block = terrain_block(0).block
    found = with_errors_times(block, {VarianceGroup("terrain", "DTM"): 3.0})
    assert all(one.error == pytest.approx(3.0 * HEIGHT_ERROR) for one in found.terrain_heights)


def test_a_model_that_is_too_precise_is_refused():
    block, _ = described(terrain_block(0).block, error=1e-7)
    with pytest.raises(InputError, match="terrain DTM has an a-priori error of 1e-07"):
        solved(block)
