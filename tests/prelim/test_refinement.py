"""Refinement of photos and points together: exact blocks, scipy's least squares, blunders, what is held."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from support.seen_points import rays_of, rotation_of

from orip.prelim.rays import ALL_KNOWN, UnknownCameras, intersect
from orip.prelim.refinement import EXPECTED, refine
from orip.structs import replace


def block(photos=5, rows=2, points=150, noise_mm=0.0, seed=1):
    """Strips flown at 1500 m with a camera 150 mm / 230 mm, every tenth point known."""
    generator = np.random.default_rng(seed)
    centres = np.array([[900.0 * i, 1500.0 * row, 1500.0] for row in range(rows) for i in range(photos)])
    rotations = np.stack([rotation_of(*generator.normal(0.0, 2.0, 2), generator.uniform(-180, 180)) for _ in centres])
    ground = generator.uniform([-300.0, -800.0, 0.0], [900.0 * photos, 1500.0 * rows, 150.0], (points, 3))
    return rays_of(ground, rotations, centres, 150.0, 230.0, generator, noise_mm), rotations, centres, ground


def start(rays, rotations, centres, ground, seed=2, turn=0.01, shift=15.0, known=10):
    generator = np.random.default_rng(seed)
    turned = Rotation.from_rotvec(generator.normal(0.0, turn, (len(centres), 3))).as_matrix() @ rotations
    moved = centres + generator.normal(0.0, shift, centres.shape)
    oriented = np.ones(len(centres), dtype=bool)
    coordinates = intersect(turned, moved, oriented, rays).coordinates
    held = np.arange(len(ground)) % known == 0
    coordinates[held] = ground[held]
    return (rays, turned, moved, oriented, coordinates), held


@pytest.mark.parametrize("rows", [1, 2, 4])
def test_exact_rays_give_the_truth(rows):
    given, held = start(*(truth := block(rows=rows)))
    found = refine(*given, held_points=held)
    _, rotations, centres, ground = truth
    known = np.isfinite(given[4]).all(axis=1)
    # iterations end when little is left to gain; from 15 m to less than a millimetre
    assert np.allclose(found.centres, centres, atol=1e-3)
    assert np.allclose(found.rotations, rotations, atol=1e-6)
    assert np.allclose(found.coordinates[known], ground[known], atol=2e-3)
    assert (found.coordinates[held] == given[4][held]).all()


def test_without_anything_held_the_image_fits():
    given, _ = start(*block(noise_mm=0.005))
    found = refine(*given)
    # points with two rays have smaller residuals than the others, which the median does not know
    assert found.s0 == pytest.approx(1.0, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("unknown", [(), (0, 1, 2, 3), (0, 3)])
def test_without_blunders_it_is_scipys_least_squares(unknown):
    given, held = start(*block(photos=3, rows=1, points=60, noise_mm=0.005), known=6)
    unknown = np.array(unknown, dtype=int)
    cameras = (
        UnknownCameras(np.zeros(3, dtype=int), np.isin(np.arange(4), unknown)[None]) if len(unknown) else ALL_KNOWN
    )
    given = replace(given[0], cameras=cameras), *given[1:]
    rays, rotations, centres, _, coordinates = given
    found = refine(*given, held_points=held)
    free = np.flatnonzero(np.isfinite(coordinates).all(axis=1) & ~held)
    used = np.isfinite(coordinates).all(axis=1)[rays.point]
    photo, point, xy = rays.photo[used], rays.point[used], rays.xy[used]
    factors = found.weight_factors[used]

    def residuals(x):
        turns, shifts, points = x[:9].reshape(3, 3), x[9:18].reshape(3, 3), coordinates.copy()
        points[free] = x[18 : 18 + 3 * len(free)].reshape(-1, 3) + coordinates[free]
        corrections = np.zeros(4)
        corrections[unknown] = x[18 + 3 * len(free) :]
        scale, dx, dy, radial = corrections
        in_photo = np.einsum(
            "nji,nj->ni", (Rotation.from_rotvec(turns).as_matrix() @ rotations)[photo],
            points[point] - (centres + 100.0 * shifts)[photo],
        )  # fmt: skip
        image = -150.0 * np.exp(scale) * in_photo[:, :2] / in_photo[:, 2:]
        square = (xy**2).sum(axis=1, keepdims=True) / 150.0**2
        corrected = xy * (1.0 + radial * square) + 150.0 * np.array([dx, dy])
        return np.r_[(np.sqrt(factors)[:, None] * (image - corrected) / 0.005).ravel(), corrections / EXPECTED]

    nothing = np.zeros(18 + 3 * len(free) + len(unknown))
    expected = least_squares(residuals, nothing, x_scale="jac", method="trf", xtol=1e-12)
    assert (factors == 1.0).mean() > 0.95
    # some centimetres are the standard deviations of the centres
    assert np.allclose(found.centres, centres + 100.0 * expected.x[9:18].reshape(3, 3), atol=5e-3)
    assert np.allclose(
        found.coordinates[free], coordinates[free] + expected.x[18 : 18 + 3 * len(free)].reshape(-1, 3), atol=5e-3
    )
    # C is nearly the scale of heights here, and the last iteration leaves some of it
    assert np.allclose(found.corrections[:, unknown], expected.x[18 + 3 * len(free) :], atol=2e-5)


def test_wrong_rays_do_no_harm():
    rays, rotations, centres, ground = block(photos=6, rows=3, points=300, noise_mm=0.005)
    generator = np.random.default_rng(5)
    wrong = generator.random(len(rays.point)) < 0.05
    vectors = rays.vectors.copy()
    vectors[wrong, :2] += generator.uniform(2.0, 30.0, (int(wrong.sum()), 2))
    given, held = start(replace(rays, vectors=vectors, xy=vectors[:, :2]), rotations, centres, ground)
    found = refine(*given, held_points=held)
    assert np.linalg.norm(found.centres - centres, axis=1).max() < 1.0
    assert found.s0 == pytest.approx(1.0, abs=0.25)
    # of points with two rays a shift along the base does not show in the residuals
    assert np.mean(found.weight_factors[wrong] < 0.1) > 0.85


def test_one_photo_that_is_quite_wrong_comes_right():
    rays, rotations, centres, ground = block(photos=6, rows=3, points=400, noise_mm=0.005)
    given, held = start(rays, rotations, centres, ground, known=5)
    given[2][7] += [300.0, -200.0, 100.0]
    found = refine(*given, held_points=held)
    assert np.linalg.norm(found.centres - centres, axis=1).max() < 1.0


def test_photos_that_are_not_oriented_stay():
    rays, rotations, centres, ground = block(noise_mm=0.005)
    given, _ = start(rays, rotations, centres, ground)
    oriented = np.arange(len(centres)) != 6
    found = refine(rays, given[1], given[2], oriented, given[4])
    assert (found.centres[6] == given[2][6]).all()
    assert (found.rotations[6] == given[1][6]).all()
    assert (found.centres[oriented] != given[2][oriented]).any(axis=1).all()
    assert (found.weight_factors[rays.photo == 6] == 0.0).all()


def test_photos_alone():
    rays, rotations, centres, ground = block()
    given, _ = start(rays, rotations, centres, ground)
    photos = refine(*given[:4], ground, held_points=np.ones(len(ground), dtype=bool))
    assert np.allclose(photos.centres, centres, atol=1e-3)
    assert (photos.coordinates == ground).all()


def test_points_without_position_stay_without():
    given, held = start(*block())
    coordinates = given[4].copy()
    coordinates[11:14] = np.nan
    found = refine(*given[:4], coordinates, held_points=held)
    assert np.isnan(found.coordinates[11:14]).all()
    assert (found.weight_factors[np.isin(given[0].point, [11, 12, 13])] == 0.0).all()


def test_nothing_to_do():
    rays, rotations, centres, ground = block(points=10)
    found = refine(rays, rotations, centres, np.zeros(len(centres), dtype=bool), ground)
    assert (found.centres == centres).all()
    assert found.iterations == 0
