"""The reduced system as a band against the full one, on a block of a hundred photos."""

from __future__ import annotations

import numpy as np
import pytest
from aerial_blocks import aerial_block

from orip.adjustment.factorisation.band import BandMatrix
from orip.adjustment.factorisation.band_cholesky import BandFactor
from orip.adjustment.normals import solve_normals
from orip.adjustment.precision import cofactors
from orip.bundle.problem import pose_problem
from orip.bundle.results.ground import reduced_cofactors
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import solve_block
from orip.bundle.starting_state import starting_state
from orip.structs import replace

MAX_LOST = 12.0
BLOCK = aerial_block(100, 40)


def solved_normals(block, *, streamed, banded):
    problem = pose_problem(block)
    layout = problem.layout if banded else replace(problem.layout, arrangement=None)
    if not streamed:
        problem = replace(problem, streamed=None)
    equations = problem.linearise(starting_state(block))
    weights = np.random.default_rng(8).uniform(0.3, 1.0, len(equations.residual))
    normals = solve_normals(equations, weights, layout, MAX_LOST)
    return normals, cofactors(equations, normals), problem.unknowns


@pytest.mark.parametrize("streamed", [True, False])
def test_band_and_full_matrix_give_the_same_figures(streamed):
    normals, found, unknowns = solved_normals(BLOCK, streamed=streamed, banded=True)
    full, wanted, _ = solved_normals(BLOCK, streamed=False, banded=False)
    assert isinstance(normals.factor, BandFactor)
    assert isinstance(found.reduced, BandMatrix)
    deviation = np.sqrt(np.concatenate([np.diag(wanted.reduced), np.einsum("bii->bi", wanted.blocks).ravel()]))
    size = np.abs(full.correction / deviation).max()
    # a self-calibrated block of a hundred photos loses some six digits
    assert np.abs((normals.correction - full.correction) / deviation).max() < 1e-8 * size
    assert normals.reduced_square_sum == pytest.approx(full.reduced_square_sum, rel=1e-9)
    assert np.allclose(found.reduced.diagonal(), np.diag(wanted.reduced), rtol=1e-7)
    assert np.allclose(np.einsum("bii->bi", found.blocks), np.einsum("bii->bi", wanted.blocks), rtol=1e-7)
    assert np.allclose(found.leverage, wanted.leverage, rtol=1e-6, atol=1e-9)
    for columns in (unknowns.photos[17], unknowns.cameras[0][unknowns.cameras[0] >= 0]):
        pairs = np.ix_(columns, columns)
        roots = np.outer(deviation[columns], deviation[columns])
        assert np.allclose(found.reduced[pairs] / roots, wanted.reduced[pairs] / roots, atol=1e-7)
    right = np.random.default_rng(9).normal(size=(len(deviation), 2)) / deviation[:, None]
    roots = deviation[:, None]
    assert np.allclose(normals.solve(right) / roots, full.solve(right) / roots, rtol=1e-6, atol=1e-5)


def test_without_control_seven_unknowns_of_photos_are_removed():
    block = replace(BLOCK, control_points=())
    normals, _, unknowns = solved_normals(block, streamed=True, banded=True)
    full, _, _ = solved_normals(block, streamed=False, banded=False)
    assert isinstance(normals.factor, BandFactor)
    assert np.count_nonzero(full.removed) == 7
    assert [unknowns.names[place].group for place in np.flatnonzero(normals.removed)] == ["PHOTO"] * 7
    # the residuals left are the same whatever movements are held
    assert normals.reduced_square_sum == pytest.approx(full.reduced_square_sum, rel=1e-8)


def test_photos_with_too_few_points_lose_the_same_unknowns_in_band_and_full_matrix():
    points = BLOCK.photo_points
    used = points.used.copy()
    weak = [17, 50, 51, 90]
    for photo, kept in zip(weak, (0, 1, 2, 2), strict=True):
        used[np.flatnonzero(points.photo == photo)[kept:]] = False
    block = replace(BLOCK, photo_points=replace(points, used=used))
    normals, _, unknowns = solved_normals(block, streamed=True, banded=True)
    full, _, _ = solved_normals(block, streamed=False, banded=False)
    assert isinstance(normals.factor, BandFactor)
    assert np.array_equal(normals.removed, full.removed)
    assert normals.removed[unknowns.photos[weak]].sum() == 6 + 4 + 2 + 2


def test_results_of_a_block_with_a_band():
    solved = solve_block(BLOCK, lambda _: None, lambda: False)
    assert isinstance(solved.cofactors.reduced, BandMatrix)
    solution = solution_of(solved)
    assert solution.status == "converged"
    assert np.isfinite(solution.photos.sd).all()
    assert np.isfinite(solution.points.sd).all()
    assert np.nansum(solved.variance.redundancy_numbers) == pytest.approx(solved.variance.redundancy, abs=1e-4)
    assert len(solution.correlations) == 10


def test_a_free_network_in_a_band_has_the_cofactors_of_the_full_matrix():
    free = replace(BLOCK, control_points=(), definition=replace(BLOCK.definition, datum="free"))
    problem, state = pose_problem(free), starting_state(free)
    equations = problem.linearise(state)
    found = []
    for layout in (problem.layout, replace(problem.layout, arrangement=None)):
        normals = solve_normals(equations, np.ones(len(equations.residual)), layout, MAX_LOST)
        found.append(cofactors(equations, normals, problem.inner_constraints(state)))
    band, full = found
    assert isinstance(band.reduced, BandMatrix)
    assert isinstance(full.reduced, np.ndarray)
    assert np.allclose(band.reduced.diagonal(), np.diag(full.reduced), rtol=1e-6)
    deviation = np.sqrt(np.einsum("bii->bi", full.blocks))
    roots = deviation[:, :, None] * deviation[:, None, :]
    assert np.allclose(band.blocks / roots, full.blocks / roots, atol=1e-6)


@pytest.mark.parametrize("streamed", [True, False])
def test_some_unknowns_are_solved_for_without_the_others(streamed):
    normals, _, unknowns = solved_normals(BLOCK, streamed=streamed, banded=True)
    columns = np.sort(np.concatenate([unknowns.photos[3], unknowns.points[[5, 40]].ravel(), unknowns.points[7, :1]]))
    right = np.random.default_rng(4).normal(size=(len(columns), 9))
    whole = np.zeros((len(normals.correction), 9))
    whole[columns] = right
    wanted = normals.solve(whole)[columns]
    np.testing.assert_allclose(normals.solve_at(columns, right), wanted, rtol=1e-6, atol=1e-9 * np.abs(wanted).max())
    inverse = normals.inverse_at(columns)
    np.testing.assert_allclose(inverse @ right, wanted, rtol=1e-6, atol=1e-9 * np.abs(wanted).max())


def test_cameras_of_single_photos_of_which_few_parameters_are_unknown():
    # the cameras' unknowns are all over the band, and constants beside them have no place in it
    cameras = tuple(replace(BLOCK.cameras[0], name=photo.name, unknown=("C", "A3")) for photo in BLOCK.photos)
    photos = tuple(replace(photo, camera=photo.name) for photo in BLOCK.photos)
    own = replace(BLOCK, cameras=cameras, photos=photos, photo_camera=np.arange(len(photos)))
    solved = solve_block(own, lambda _: None, lambda: False)
    assert isinstance(solved.cofactors.reduced, BandMatrix)
    columns = solved.problem.unknowns.cameras
    found = reduced_cofactors(solved, columns)
    unknown = columns >= 0
    assert np.array_equal(found != 0.0, unknown[:, :, None] & unknown[:, None, :])
    variance = solved.cofactors.reduced.diagonal()[columns[unknown]]
    assert np.array_equal(np.einsum("nii->ni", found)[unknown], variance)
