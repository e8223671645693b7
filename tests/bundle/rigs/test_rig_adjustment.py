"""Blocks of rigs: both ways of forming normal equations agree, and what follows from exposures has its precision."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.rig_blocks import C, rig_block, single

from orip.bundle.compiled import photo_loop
from orip.bundle.diagnosis import diagnose
from orip.bundle.kinds.observation import partials_by_unknowns
from orip.bundle.problem import pose_problem
from orip.bundle.results.covariance import covariance, photo_figures
from orip.bundle.results.ground import photo_cofactors
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import solve_block
from orip.bundle.starting_state import starting_state
from orip.records.camera import Sensor
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.rig import Rigs
from orip.structs import replace


def adjusted(block, **settings):
    return solve_block(block, lambda _: None, lambda: False, **settings)


def rolling(camera):
    return replace(camera, parameters=(*camera.parameters[:-1], 0.03), sensor=Sensor(3600, 2400, *camera.frame))


def stored(block):
    """Return the problem of a block whose design matrix is stored."""
    return replace(pose_problem(block), streamed=None)


@pytest.mark.skipif(not photo_loop.is_compiled(), reason="the extension was not built: no compiler here")
@pytest.mark.parametrize(
    ("head", "settings"),
    [
        ("penta", {}),
        ("apart", {"missing": 3}),
        ("three", {"mounting_error": (0.01, 0.05)}),
        ("stereo", {"datum": "free"}),
        ("around", {"datum": "free", "mounting_error": (0.01, 0.05)}),
        ("stereo", {"strips": 2, "exposures": 45, "points": 1200}),
        ("three", {"velocity_error": 0.3, "rate_error": 0.5}),
    ],
)
def test_compiled_loops_and_stored_rows_give_the_same(head, settings):
    block = rig_block(head, "same", **settings).block
    if "rate_error" in settings:
        block = replace(block, cameras=tuple(map(rolling, block.cameras)))
    found, expected = adjusted(block), adjusted(block, pose=stored)
    if settings.get("exposures"):
        assert found.problem.layout.arrangement is not None
    assert found.problem.streamed is not None
    scale = found.deviation_scale
    np.testing.assert_allclose(found.state.points, expected.state.points, atol=1e-6)
    np.testing.assert_allclose(found.state.rigs.offsets, expected.state.rigs.offsets, atol=1e-6)
    np.testing.assert_allclose(found.variance.sigma0, expected.variance.sigma0, rtol=1e-7)
    np.testing.assert_allclose(found.cofactors.blocks, expected.cofactors.blocks, rtol=1e-5, atol=1e-9 * scale)
    active = found.equations.active
    np.testing.assert_allclose(found.cofactors.leverage[active], expected.cofactors.leverage[active], atol=1e-7)
    np.testing.assert_allclose(photo_cofactors(found), photo_cofactors(expected), rtol=1e-4, atol=1e-12)
    assert not found.normals.removed.any()


def test_statistics_are_those_of_a_dense_adjustment():
    solved = adjusted(rig_block("three", "dense", strips=1, points=60, start_down_weight=60).block)
    unknowns = solved.problem.unknowns
    design, residual = np.zeros((0, unknowns.layout.size)), np.zeros(0)
    for kind in solved.problem.observations:
        found, (partials, columns) = partials_by_unknowns(kind, solved.state, unknowns)
        rows = np.zeros((len(partials), unknowns.layout.size + 1))
        np.add.at(rows, (np.arange(len(rows))[:, None], columns), partials / kind.rows.error[:, None])
        design = np.vstack([design, rows[:, :-1]])
        residual = np.append(residual, found.residual / kind.rows.error)
    inverse = np.linalg.inv(design.T @ design)
    m = unknowns.layout.reduced
    np.testing.assert_allclose(np.diag(inverse)[:m], solved.cofactors.reduced.diagonal(), rtol=1e-6)
    leverage = np.einsum("ni,ij,nj->n", design, inverse, design)
    np.testing.assert_allclose(leverage, solved.cofactors.leverage, atol=1e-7)
    redundancy = len(residual) - design.shape[1]
    assert solved.variance.redundancy == redundancy
    assert solved.variance.sigma0 == pytest.approx(np.sqrt(residual @ residual / redundancy))


def test_a_rig_of_exact_images_is_found_exactly():
    made = rig_block("penta", "exact", noise=0.0)
    state = adjusted(made.block).state
    np.testing.assert_allclose(state.rigs.offsets, made.offsets, atol=1e-6)
    np.testing.assert_allclose(state.rigs.mountings, made.mountings, atol=1e-8)
    np.testing.assert_allclose(state.points, made.points, atol=1e-6)


def test_a_rig_has_fewer_unknowns_and_smaller_deviations_than_its_photos():
    block = rig_block("penta", "fewer").block
    rig, alone = adjusted(block), adjusted(single(block))
    photos, exposures = len(block.photos), len(block.rigs.exposures)
    assert alone.problem.layout.unknowns - rig.problem.layout.unknowns == 6 * (photos - exposures - 4)
    smaller = np.einsum("nii->n", rig.cofactors.blocks) < np.einsum("nii->n", alone.cofactors.blocks)
    assert smaller.all()


def test_photos_have_covariances_that_follow_from_exposure_and_mounting():
    solved = adjusted(rig_block("around", "covariances").block)
    photos, solution = [2, 7], solution_of(solved)
    figures = [photo_figures(solved, photo) for photo in photos]
    found = covariance(solved, figures, figures)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), solution.photos.sd[photos].ravel(), rtol=1e-6)
    assert {row.camera for row in solution.mountings} == {"A", "B", "C"}
    assert len(solution.rig_exposures) == 6 * 10
    reference = [row.sd for row in solution.mountings if row.camera == "A"]
    assert np.isnan(reference).all()
    others = [row.sd for row in solution.mountings if row.camera != "A"]
    assert np.isfinite(others).all()


def test_a_mounting_that_no_exposure_determines_is_named():
    block = rig_block("stereo", "loose", start_error=0.0).block
    alone = (replace(one, photos=one.photos[row % 2 :][:1]) for row, one in enumerate(block.rigs.exposures))
    solved = adjusted(replace(block, rigs=Rigs(block.rigs.rigs, tuple(alone))))
    names = [solved.problem.unknowns.names[column] for column in np.flatnonzero(solved.normals.removed)]
    assert solved.converged
    assert [(name.group, name.name) for name in names] == [("MOUNTING", "B on HEAD")] * 6
    (named,) = [one for one in diagnose(solved) if one.code == "undetermined"]
    assert "no exposure has a photo of this camera" in named.text


def test_a_photo_that_is_not_oriented_starts_where_its_exposure_has_it():
    made = rig_block("three", "placed", start_error=0.0)
    orientation = made.block.photo_orientation.copy()
    orientation[[4, 9]] = np.nan
    rigs = starting_state(replace(made.block, photo_orientation=orientation)).rigs
    np.testing.assert_allclose(rigs.offsets, made.offsets, atol=1e-9)
    np.testing.assert_allclose(rigs.centres, made.centres, atol=1e-9)


def test_wrong_orientations_of_a_few_photos_do_not_start_a_rig_wrongly():
    made = rig_block("penta", "wrong starts", start_error=0.0)
    orientation = made.block.photo_orientation.copy()
    orientation[::7] += [20.0, -30.0, 10.0, 0.5, -0.3, 1.0]
    rigs = starting_state(replace(made.block, photo_orientation=orientation)).rigs
    turns = Rotation.from_matrix(rigs.mountings @ np.swapaxes(made.mountings, 1, 2)).magnitude()
    assert turns.max() < 0.02
    assert np.abs(rigs.offsets - made.offsets).max() < 2.0


def test_constant_elements_of_a_photo_of_a_rig_are_met_exactly():
    from orip.bundle.local_frame import constants_of_rigs

    block = rig_block("stereo", "constant").block
    held = replace(block.photos[3], constant=("X0", "KAPPA"))
    block = constants_of_rigs(replace(block, photos=(*block.photos[:3], held, *block.photos[4:])))
    solved = adjusted(block)
    found = solution_of(solved).photos
    for element in held.constant:
        column = PHOTO_PARAMETERS.index(element)
        assert found.values[3, column] == pytest.approx(held.orientation[column], abs=1e-7)
        assert np.isnan(found.sd[3, column])


def test_principal_distances_differ_from_camera_to_camera():
    block = rig_block("apart", "unknown cameras").block
    cameras = tuple(replace(camera, unknown=("C",)) for camera in block.cameras)
    found = solution_of(adjusted(replace(block, cameras=cameras))).cameras
    assert (np.abs(found.values[:, 0] - C) < 5.0 * found.sd[:, 0]).all()
