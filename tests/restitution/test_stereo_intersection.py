"""Vertices fall where they are, scatter as their standard deviations say, and agree with closed forms."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from restitution.stereo_study import NOISE, images, measured, places_between, solved_strip
from support.synthetic_block import DISTORTED, synthetic_block

from orip.bundle.solve import solve_block
from orip.restitution.intersection import StereoMarks, intersect
from orip.structs import replace

LOG = logging.getLogger(__name__)


@pytest.mark.parametrize("distortion_at", ["ideal", "measured"])
@pytest.mark.parametrize("scene", ["strip", "convergent", "room"])
def test_without_errors_vertices_are_where_they_are(scene, distortion_at):
    made = synthetic_block(scene, "exact", distortion=DISTORTED, distortion_at=distortion_at, start_error=1e-4)
    solved = solve_block(made.block, lambda _: None, lambda: False)
    points = solved.block.photo_points
    left, right = (dict(zip(*rows, strict=True)) for rows in (_seen(points, 1), _seen(points, 2)))
    both = sorted(left.keys() & right.keys())
    xy = np.array([[left[point], right[point]] for point in both])
    found = intersect(solved, StereoMarks(np.full(len(both), 1), np.full(len(both), 2), xy, np.full(xy.shape, NOISE)))
    size = np.ptp(made.points, axis=0).max()
    assert len(both) > 3
    assert np.abs(found.xyz - made.points[both]).max() < 1e-8 * size
    assert np.abs(found.y_parallax).max() < 1e-8


def _seen(points, photo):
    mine = points.photo == photo
    return points.point[mine].tolist(), points.xy[mine].tolist()


def test_of_constant_photos_the_standard_deviations_are_those_of_the_normal_case():
    made, _ = solved_strip("normal case", 0.0)
    c, b, h = made.cameras[0, 0], 600.0, 1000.0
    centres = np.array([[0.0, 0.0, h], [b, 0.0, h]])
    photos = tuple(
        replace(photo, orientation=(*centre, 0.0, 0.0, 0.0), constant=("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA"))
        for photo, centre in zip(made.block.photos[:2], centres.tolist(), strict=True)
    )
    first = made.block.photo_points.photo < 2
    block = replace(
        made.block, photos=photos, photo_camera=made.block.photo_camera[:2],
        photo_orientation=np.column_stack([centres, np.zeros((2, 3))]), control_points=(),
        photo_points=made.block.photo_points.of(np.flatnonzero(first)),
    )  # fmt: skip
    # its points lie elsewhere, so that sigma0 is not 1: it is divided out
    solved = solve_block(block, lambda _: None, lambda: False)
    xy = np.array([[[c * 0.3, 0.0], [-c * 0.3, 0.0]]]) + made.cameras[0, 1:3]
    found = intersect(solved, StereoMarks(np.array([0]), np.array([1]), xy, np.full((1, 2, 2), NOISE)))
    assert np.allclose(found.xyz[0], [300.0, 0.0, 0.0], atol=1e-6)
    scale = h / c * NOISE * solved.deviation_scale
    expected = np.array([1.0 / np.sqrt(2.0), 1.0 / np.sqrt(2.0), h / b * np.sqrt(2.0)]) * scale
    assert np.allclose(np.sqrt(np.diag(found.covariance[0])), expected, rtol=1e-9)


def test_the_y_parallax_is_that_of_the_photos_and_its_w_that_of_its_error():
    made, solved = solved_strip("parallax")
    random = np.random.default_rng(2)
    xyz = places_between(made, 2, 3, 4, random)
    marks = measured(made, 2, 3, xyz, random, 0.0)
    marks.xy[:, 0, 1] += 0.05
    found = intersect(solved, marks)
    assert np.allclose(found.y_parallax, 0.05, atol=0.01)
    # of two coordinates of 5 µm, and a little from the orientations
    assert np.allclose(found.w, 0.05 / (np.sqrt(2.0) * NOISE), rtol=0.25)


def test_parallel_rays_and_rays_that_diverge_have_no_vertex():
    made, solved = solved_strip("diverging", 0.0)
    xyz = np.array([[2250.0, 2000.0, 200.0]])
    marks = measured(made, 2, 3, xyz, np.random.default_rng(3), 0.0)
    found = intersect(solved, StereoMarks(marks.right, marks.left, marks.xy, marks.error))
    assert np.isnan(found.xyz).all()
    assert np.isnan(found.w).all()


def standardised(blocks: int, vertices: int) -> np.ndarray:
    """Return squares of differences against the stated covariances, over their number, of all vertices."""
    found = []
    for number in range(blocks):
        made, solved = solved_strip(f"scatter {number}", unknown=("C",), control_error=0.02)
        random = np.random.default_rng(1000 + number)
        left = number % 5
        xyz = places_between(made, left, left + 1, vertices, random)
        result = intersect(solved, measured(made, left, left + 1, xyz, random))
        difference = result.xyz - xyz
        found.append(
            np.column_stack(
                [
                    difference**2 / np.einsum("nii->ni", result.covariance),
                    np.einsum("ni,nij,nj->n", difference, np.linalg.inv(result.covariance), difference) / 3.0,
                    result.w**2,
                ]
            )
        )
    return np.vstack(found)


def test_vertices_scatter_as_their_standard_deviations_say():
    squares = standardised(20, 10)
    scatter = np.sqrt(squares.mean(axis=0))
    LOG.info("200 vertices, differences over stated sd: X %.3f Y %.3f Z %.3f, joint %.3f, w %.3f", *scatter)
    assert np.abs(scatter - 1.0).max() < 0.15


@pytest.mark.long
def test_many_vertices_scatter_as_their_standard_deviations_say():
    squares = standardised(500, 4)
    scatter = np.sqrt(squares.mean(axis=0))
    LOG.info("2000 vertices, differences over stated sd: X %.3f Y %.3f Z %.3f, joint %.3f, w %.3f", *scatter)
    assert np.abs(scatter - 1.0).max() < 0.05


def test_images_of_the_study_are_those_of_the_block():
    made, solved = solved_strip("images", 0.0)
    points = solved.block.photo_points
    mine = points.photo == 1
    assert np.allclose(images(made, 1, made.points[points.point[mine]]), points.xy[mine], atol=1e-9)
