"""Covariances between any records against the dense inverse of the complete normal equations."""

from __future__ import annotations

import numpy as np
import pytest
from aerial_blocks import aerial_block as large_aerial_block
from bundle.aerial_block import aerial_block
from bundle.free_networks import SUBSET, dense_free_cofactors, free
from bundle.solving import noisy, redefined, solved
from support.aerial_block_in_crs import aerial_block as aerial_block_in_crs
from support.synthetic_block import synthetic_block

from orip.adjustment.factorisation.band import BandMatrix
from orip.bundle.results.covariance import Figures, camera_figures, covariance, photo_figures, point_figures
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT
from orip.geometry.rotation import angles_from_rotation
from orip.records.control import Control
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN


def normal_matrix(found: SolvedBlock) -> np.ndarray:
    """Return A^T P A (u, u) of the places that are unknowns, at the solution with its last weights."""
    equations = found.equations
    weights = np.where(equations.active, found.weight_factors, 0.0)
    design = equations.design * np.sqrt(weights)[:, None]
    return (design.T @ design).toarray()


def dense_inverse(found: SolvedBlock) -> tuple[np.ndarray, float]:
    """Return the inverse (m + 3 b, m + 3 b), and the condition of what was inverted, scaled to a unit diagonal."""
    normals = normal_matrix(found)
    free_places = ~found.problem.layout.fixed & ~found.normals.removed
    root = np.sqrt(np.diag(normals))[free_places]
    scaled = normals[np.ix_(free_places, free_places)] / np.outer(root, root)
    inverse = np.linalg.inv(scaled)
    result = np.zeros_like(normals)
    result[np.ix_(free_places, free_places)] = inverse / np.outer(root, root)
    return result, float(np.linalg.norm(scaled, 1) * np.linalg.norm(inverse, 1))


def places(found: SolvedBlock) -> tuple[int, int]:
    """Return two points that are determined, far from each other in the block."""
    determined = np.flatnonzero(np.isfinite(solution_of(found).points.sd).all(axis=1))
    return int(determined[1]), int(determined[-1])


def records(found: SolvedBlock) -> list[Figures]:
    """Return figures of a camera, of two photos and of two points."""
    photos = (0, len(found.block.photos) - 1)
    return [
        camera_figures(found, 0),
        *(photo_figures(found, photo) for photo in photos),
        *(point_figures(found, point) for point in places(found)),
    ]


def values_of(found: SolvedBlock, state: BlockState) -> list[np.ndarray]:
    """Return the same records' figures at a state; angles about the project's axes at the adjusted centres."""
    ground = found.block.ground
    axes = ground.axes_at(ground.to_project(found.state.centres))
    angles = angles_from_rotation(axes @ state.rotations) * DEGREES_PER_RADIAN
    photos = np.hstack([ground.to_project(state.centres), angles])
    points = ground.to_project(state.points)
    cameras = np.hstack([state.cameras, state.additional])
    return [cameras[0], photos[0], photos[-1], *points[list(places(found))]]


def differences(found: SolvedBlock, cofactors: np.ndarray) -> list[np.ndarray]:
    """Return the partials of the figures by all unknowns: each is moved by a tenth of its deviation."""
    state, unknowns = found.state, found.problem.unknowns
    columns = np.unique(np.concatenate([record.columns for record in records(found)]))
    partials = [np.zeros((len(value), len(cofactors))) for value in values_of(found, state)]
    for column in columns[columns != CONSTANT]:
        step = np.zeros(len(cofactors))
        step[column] = 0.1 * np.sqrt(cofactors[column, column]) or 1e-6
        after, before = (values_of(found, state.moved(sign * step, unknowns)) for sign in (1.0, -1.0))
        for partial, one, other in zip(partials, after, before, strict=True):
            partial[:, column] = (one - other) / (2.0 * step[column])
    # rounding of the differences is no dependence
    return [np.where(np.abs(partial) < 1e-9, 0.0, partial) for partial in partials]


def assert_all_covariances(found: SolvedBlock, cofactors: np.ndarray, tolerance: float) -> None:
    """Compare all blocks between the records as correlations."""
    partials = differences(found, cofactors)
    scale = found.deviation_scale**2
    roots = [np.sqrt(np.maximum(np.diag(partial @ cofactors @ partial.T), 0.0)) for partial in partials]
    for row, figures in enumerate(records(found)):
        for column, others in enumerate(records(found)):
            wanted = partials[row] @ cofactors @ partials[column].T
            both = np.outer(roots[row], roots[column])
            difference = covariance(found, [figures], [others]) / scale - wanted
            unknown = both > 0.0
            assert np.abs(difference[unknown] / both[unknown]).max(initial=0.0) < tolerance
            assert np.array_equal(difference[~unknown], np.zeros(np.count_nonzero(~unknown)))


def tolerance(condition: float) -> float:
    """Return what rounding leaves of a correlation: some units of the last digit times the condition, and 1e-6.

    The latter is for the differences of the partials: their error is the square of a tenth of a deviation, and that of
    PROJ's coordinates in it.
    """
    return 1e-6 + 100.0 * np.finfo(float).eps * condition


CONTROLLED = {
    "self-calibration": redefined(
        noisy(synthetic_block("convergent", "covariance", noise_mm=0.005, unknown=("C", "DX", "DY", "A3")), 5)
    ),
    "weights reduced": noisy(synthetic_block("strip", "covariance", noise_mm=0.02), 6),
    "walls, phi 90 degrees": noisy(synthetic_block("terrestrial", "covariance"), 7),
    "held angles": noisy(
        synthetic_block("strip", "covariance", control="constant", constant=[("OMEGA",), (), ("X0", "KAPPA")]), 8
    ),
}


# at phi = 90 degrees there are no omega and kappa whose differences could be taken
@pytest.mark.parametrize("name", sorted(set(CONTROLLED) - {"walls, phi 90 degrees"}))
def test_with_control(name: str) -> None:
    found = solved(CONTROLLED[name])
    cofactors, condition = dense_inverse(found)
    assert_all_covariances(found, cofactors, tolerance(condition))


@pytest.mark.parametrize("names", [(), SUBSET])
def test_of_a_free_network(names: tuple[str, ...]) -> None:
    block = free("aerial", names)
    found = solved(block)
    # inverted by other means: with the inner constraints as a border
    assert_all_covariances(found, dense_free_cofactors(block, found), 1e-5)


def test_in_the_axes_of_a_crs() -> None:
    made = aerial_block_in_crs()
    block = made.assembled(Control(points=tuple(made.control(dict.fromkeys(made.corners, (0.02, 0.03, 0.05))))))
    found = solved(block)
    cofactors, condition = dense_inverse(found)
    assert_all_covariances(found, cofactors, tolerance(condition))


def test_outside_the_band_of_a_large_block() -> None:
    found = solved(large_aerial_block(80, 12))
    assert isinstance(found.cofactors.reduced, BandMatrix)
    first, last = found.problem.unknowns.photos[[0, -1]]
    with pytest.raises(IndexError, match="no observation in common"):
        found.cofactors_of(np.concatenate([first, last]))
    cofactors, condition = dense_inverse(found)
    assert_all_covariances(found, cofactors, tolerance(condition))


@pytest.mark.parametrize("name", CONTROLLED)
def test_variances_are_those_of_the_results(name: str) -> None:
    found = solved(CONTROLLED[name])
    solution = solution_of(found)
    for estimates, figures in (
        (solution.cameras, camera_figures), (solution.photos, photo_figures), (solution.points, point_figures),
    ):  # fmt: skip
        for row, sd in enumerate(estimates.sd):
            one = figures(found, row)
            variance = np.diag(covariance(found, [one], [one]))
            known = np.isfinite(sd)
            # both come from one factor, by the inverse and by back-substitution
            assert np.sqrt(variance[known]) == pytest.approx(sd[known], rel=1e-6)
            assert np.array_equal(variance[np.isnan(sd)], np.zeros(np.count_nonzero(np.isnan(sd))))


def test_several_records_make_one_matrix() -> None:
    found = solved(CONTROLLED["self-calibration"])
    camera, photo, _, point, other = records(found)
    joint = covariance(found, [camera, point, other], [photo, point])
    assert joint.shape == (13 + 3 + 3, 6 + 3)
    whole = covariance(found, [point, photo], [point, photo])
    deviations = np.sqrt(np.diag(whole))
    difference = joint[13:16, :6] - covariance(found, [point], [photo])
    # the same columns of the inverse, solved for beside others: a product may be summed in another order
    rounding = 100.0 * np.finfo(float).eps * dense_inverse(found)[1]
    assert np.abs(difference / np.outer(deviations[:3], deviations[3:])).max() < rounding < 1e-6
    assert np.allclose(whole, whole.T, rtol=1e-6, atol=1e-12 * np.abs(whole).max())
    roots = np.sqrt(np.diag(whole))
    assert np.linalg.eigvalsh(whole / np.outer(roots, roots)).min() > 0.0


def test_what_nothing_determines_has_no_covariance() -> None:
    made = aerial_block("covariance")
    block = noisy(made, 9)
    rays = np.flatnonzero(block.photo_points.point == 1)
    used = block.photo_points.used.copy()
    used[rays[1:]] = False
    found = solved(replace(block, photo_points=replace(block.photo_points, used=used)))
    assert [unknown.name for unknown in solution_of(found).singular] == [block.point_names[1]]
    point, photo = point_figures(found, 1), photo_figures(found, 0)
    undetermined = np.isinf(solution_of(found).points.sd[1])
    joint = covariance(found, [point], [photo, point])
    assert np.isnan(joint[undetermined]).all()
    assert np.isfinite(joint[~undetermined][:, :6]).all()
    assert np.isfinite(covariance(found, [photo], [photo])).all()
