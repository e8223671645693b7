"""Blocks that are divided by nested dissection against the same blocks as a whole."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.blocking.divided_blocks import (
    calibrated,
    free,
    largest_difference,
    largest_difference_of_shape,
    undetermined,
    with_blunders,
    with_distances,
    with_stations,
    with_terrain,
)
from rolling.rolling_flights import flown
from support.rig_blocks import rig_block

from orip.adjustment.normals import solve_normals
from orip.archive.blocking.divided_problem import pose_divided
from orip.bundle.compiled.photo_loop import is_compiled
from orip.bundle.methods import Method, adjust_block
from orip.bundle.problem import pose_problem
from orip.bundle.results.solution import solution_of
from orip.bundle.snooping.search import SnoopingSettings
from orip.bundle.solve import iteration_settings, solve_problem
from orip.bundle.starting_state import starting_state
from orip.errors import NotSolvableError
from orip.structs import replace

MADE = (calibrated, free, with_stations, with_distances, with_terrain, with_blunders, undetermined)
LEAST_PHOTOS, LARGEST_PART = 50, 10
FEW_PHOTOS = 24  # where a block is adjusted again and again
MAX_LOST = 12.0

pytestmark = pytest.mark.skipif(not is_compiled(), reason="sub-blocks need the compiled loop")


def solved(problem, block):
    settings = iteration_settings(block.definition)
    return solve_problem(problem, starting_state(block), settings, lambda _: None, lambda: False)


def whole_and_divided(block, largest):
    return solved(pose_problem(block), block), solved(pose_divided(block, largest=largest), block)


@pytest.mark.parametrize("made", MADE)
@pytest.mark.parametrize(
    ("photos", "largest"),
    [(LEAST_PHOTOS, LARGEST_PART), pytest.param(500, 40, marks=pytest.mark.long)],
)
def test_a_divided_block_has_the_results_of_the_whole_one(made, photos, largest):
    block = made(photos)
    whole, divided = whole_and_divided(block, largest)
    assert divided.reason is whole.reason
    assert len(divided.iterations) == len(whole.iterations)
    assert largest_difference(whole, divided) < 1e-9
    assert divided.variance.sigma0 == pytest.approx(whole.variance.sigma0, rel=1e-10)
    assert np.array_equal(divided.normals.removed, whole.normals.removed)
    weighted = whole.weight_factors > 0.0
    assert np.allclose(divided.weight_factors, whole.weight_factors, rtol=1e-8)
    # the last digits that a camera loses against its photos are lost in its cofactors as well
    assert np.allclose(divided.cofactors.reduced.diagonal(), whole.cofactors.reduced.diagonal(), rtol=1e-7)
    assert np.allclose(
        np.einsum("bii->bi", divided.cofactors.blocks), np.einsum("bii->bi", whole.cofactors.blocks), rtol=1e-7
    )
    numbers = divided.variance.redundancy_numbers - whole.variance.redundancy_numbers
    assert np.nanmax(np.abs(numbers[weighted])) < 1e-8


@pytest.mark.long
def test_a_large_free_network_has_the_shape_of_the_whole_one():
    """Its datum is that of the path of the iterations: renumbered photos move it by as much, 2.3e-9 deviations."""
    block = free(2000)
    whole, divided = whole_and_divided(block, 40)
    assert largest_difference_of_shape(whole, divided) < 1e-9
    assert largest_difference(whole, divided) < 1e-8


def test_elements_of_the_inverse_are_those_of_the_whole_one():
    block = calibrated(LEAST_PHOTOS)
    whole, divided = whole_and_divided(block, LARGEST_PART)
    unknowns = whole.problem.unknowns
    deviation = np.sqrt(whole.cofactors.reduced.diagonal())
    camera = unknowns.cameras[0][unknowns.cameras[0] >= 0]
    for columns in (*unknowns.photos, camera, np.concatenate([camera, unknowns.photos[7]])):
        pairs = np.ix_(columns, columns)
        roots = np.outer(deviation[columns], deviation[columns])
        difference = divided.cofactors.reduced[pairs] - whole.cofactors.reduced[pairs]
        assert np.abs(difference / roots).max() < 1e-8


def test_an_element_that_no_front_has_is_refused():
    block = calibrated(LEAST_PHOTOS)
    divided = solved(pose_divided(block, largest=LARGEST_PART), block)
    first, last = divided.problem.unknowns.photos[[0, -1], 0]
    with pytest.raises(IndexError, match="no observation in common"):
        divided.cofactors.reduced[first, last]


def test_no_front_is_nearly_as_large_as_the_block():
    block = calibrated(LEAST_PHOTOS)
    loop, _ = pose_divided(block, largest=LARGEST_PART).streamed
    fronts = [len(node.front) for node in loop.tree.nodes]
    assert len(fronts) >= 7
    assert max(fronts) < 0.5 * len(loop.tree.place)


def test_every_photo_point_is_in_one_sub_block():
    block = calibrated(LEAST_PHOTOS)
    loop, _ = pose_divided(block, largest=LARGEST_PART).streamed
    rays = np.concatenate([members.rays for members in loop.members])
    assert np.array_equal(np.sort(rays), np.arange(len(block.photo_points.photo)))


def test_solutions_with_any_right_hand_side():
    block = with_distances(LEAST_PHOTOS)
    found = []
    for problem in (pose_problem(block), pose_divided(block, largest=LARGEST_PART)):
        equations = problem.linearise(starting_state(block))
        weights = np.random.default_rng(8).uniform(0.3, 1.0, len(equations.residual))
        normals = solve_normals(equations, weights, problem.layout, MAX_LOST, damping=0.01)
        right = np.random.default_rng(9).normal(size=(problem.layout.size, 2))
        columns = np.sort(np.concatenate([problem.unknowns.photos[3], problem.unknowns.points[[5, 40]].ravel()]))
        at = normals.solve_at(columns, right[columns]), normals.inverse_at(columns)
        again = equations.rows.right_side(weights, -weights * equations.residual, problem.layout)
        found.append((normals.correction, normals.solve(right), *at, again))
    for one, other in zip(*found, strict=True):
        # self-calibration loses some six digits
        assert np.abs(one - other).max() < 1e-8 * np.abs(one).max()


def test_the_solution_in_the_user_s_names_is_the_same():
    block = with_stations(LEAST_PHOTOS)
    whole, divided = map(solution_of, whole_and_divided(block, LARGEST_PART))
    assert np.allclose(divided.photos.sd, whole.photos.sd, rtol=1e-7)
    assert [(one.a, one.b) for one in divided.correlations] == [(one.a, one.b) for one in whole.correlations]
    difference = np.array([one.r for one in divided.correlations]) - [one.r for one in whole.correlations]
    assert np.abs(difference).max() < 1e-8


def by_both(block, method):
    """Return the solutions of a block as a whole and divided, by a method."""
    return [
        adjust_block(block, method, lambda _: None, lambda: False, pose=pose)[0]
        for pose in (pose_problem, lambda part: pose_divided(part, largest=LARGEST_PART))
    ]


def test_snooping_finds_the_same_blunders_in_a_divided_block():
    block = with_blunders(FEW_PHOTOS)
    whole, divided = by_both(block, Method(SnoopingSettings()))
    assert len(whole.blunders) >= 10
    for one, other in zip(whole.blunders, divided.blunders, strict=True):
        assert (one.kind, one.photo, one.point) == (other.kind, other.photo, other.point)
        # a size and its statistic are quotients of cofactors
        assert other.statistic == pytest.approx(one.statistic, rel=1e-7)
    assert divided.sigma0 == pytest.approx(whole.sigma0, rel=1e-10)
    assert np.allclose(divided.photos.sd, whole.photos.sd, rtol=1e-7)


def test_variance_components_of_a_divided_block_are_the_same():
    block = with_stations(FEW_PHOTOS)
    whole, divided = by_both(block, Method(variance_components=True))
    assert sum(np.isfinite(found.factor) for found in whole.variance_components) >= 3
    for one, other in zip(whole.variance_components, divided.variance_components, strict=True):
        assert other.factor == pytest.approx(one.factor, rel=1e-8, nan_ok=True)
        assert other.sd == pytest.approx(one.sd, rel=1e-7, nan_ok=True)
    assert np.allclose(divided.photos.sd, whole.photos.sd, rtol=1e-7)


def test_parameters_that_are_not_significant_are_removed_from_divided_blocks_as_well():
    block = calibrated(LEAST_PHOTOS)
    (camera,) = block.cameras
    block = replace(block, cameras=(replace(camera, unknown=(*camera.unknown, "P1", "P2")),))
    whole, divided = by_both(block, Method(prune=True))
    pruned = [found.text for found in whole.diagnosis if found.code == "pruned"]
    assert any(text.startswith("P1, P2 of camera CAM was held at zero") for text in pruned)
    assert [found.text for found in divided.diagnosis if found.code == "pruned"] == pruned
    assert np.allclose(divided.photos.sd, whole.photos.sd, rtol=1e-7)


def test_what_is_not_divided_is_said():
    with pytest.raises(NotSolvableError, match="a block with rigs is not divided: adjust it as a whole, without Dask"):
        pose_divided(rig_block("stereo", "divided").block, largest=LARGEST_PART)


@pytest.mark.parametrize(
    "motions",
    [{}, {"velocity_error": 0.5, "rate_error": 2.0}, {"known": (0.05, 0.3)}],
    ids=["held", "bundle", "stations"],
)
def test_a_divided_block_of_a_rolling_shutter_has_the_results_of_the_whole_one(motions):
    block = flown(3, 0.03, 10.0, unknown=("C", "READOUT"), given=0.02, **motions).block
    whole, divided = whole_and_divided(block, 6)
    assert len(divided.iterations) == len(whole.iterations)
    assert np.abs(divided.state.centres - whole.state.centres).max() < 1e-9
    assert np.abs(divided.state.readouts - whole.state.readouts).max() < 1e-9
    assert np.abs(divided.state.motion_corrections - whole.state.motion_corrections).max() < 1e-9
