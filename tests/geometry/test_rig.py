"""Photos of a rig: exact relations, and adjusted rigs of cameras without common view against their truth."""

import numpy as np
from scipy.stats import chi2

from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rolling_shutter import exposures_of_photos, photos_with_partials
from orip.geometry.rotation import rotation_about_axes, rotation_from_angles, rotation_vectors_with_partials
from orip.geometry.stereo import relative_poses_with_partials

ERROR = 0.005
C = 50.0
EXPOSURES, POINTS = 6, 12
PARTS = 6 * EXPOSURES


def poses(generator, number):
    return generator.normal(0.0, 3.0, (number, 3)), rotation_from_angles(generator.uniform(-3.0, 3.0, (number, 3)))


def test_an_exposure_is_found_from_each_of_its_photos():
    generator = np.random.default_rng(5)
    exposures, mountings = poses(generator, 7), poses(generator, 7)
    photos = photos_with_partials(*exposures, *mountings)
    centres, rotations = exposures_of_photos(photos.centres, photos.rotations, *mountings)
    np.testing.assert_allclose(centres, exposures[0], atol=1e-13)
    np.testing.assert_allclose(rotations, exposures[1], atol=1e-14)


def test_mountings_are_relative_orientations_against_the_reference_camera():
    generator = np.random.default_rng(6)
    exposures, (offsets, mountings) = poses(generator, 7), poses(generator, 7)
    photos = photos_with_partials(*exposures, offsets, mountings)
    found = relative_poses_with_partials(*exposures, photos.centres, photos.rotations)
    np.testing.assert_allclose(found.base, offsets, atol=1e-13)
    np.testing.assert_allclose(found.rotation, mountings, atol=1e-14)


def looking_down_and_oblique():
    """Return offsets and mountings of two cameras whose views do not meet; the first is the reference."""
    return np.array([[0.0, 0.0, 0.0], [0.3, -0.1, 0.05]]), rotation_from_angles(np.array([[0.0] * 3, [0.2, 0.9, 0.1]]))


def images(x, start, ground):
    """Return images and their partials by six unknowns an exposure and six of the second camera.

    `x` (k,) moves `start`, which is centres, rotations, offsets and mountings; `ground` is (exposures, 2, points, 3).
    """
    centres, rotations, offsets, mountings = start
    by_exposure, by_camera = x[:PARTS].reshape(-1, 6), np.vstack([np.zeros(6), x[PARTS:]])
    exposure, camera = np.repeat(np.arange(EXPOSURES), 2), np.tile([0, 1], EXPOSURES)
    photos = photos_with_partials(
        (centres + by_exposure[:, :3])[exposure],
        (rotation_about_axes(by_exposure[:, 3:]) @ rotations)[exposure],
        (offsets + by_camera[:, :3])[camera],
        (rotation_about_axes(by_camera[:, 3:]) @ mountings)[camera],
    )
    at = np.repeat(np.arange(2 * EXPOSURES), POINTS)
    offset = ground.reshape(-1, 3) - photos.centres[at]
    found = perspective_with_partials(offset, photos.rotations[at], np.full(len(at), C))
    by_photo = np.concatenate([-found.by_point, found.by_rotation], axis=2)
    design = np.zeros((len(at), 2, len(x)))
    for row, photo in enumerate(at):
        one = 6 * exposure[photo]
        design[row, :, one : one + 6] = by_photo[row] @ photos.by_exposure[photo]
        if camera[photo]:
            design[row, :, PARTS:] = by_photo[row] @ photos.by_mounting[photo]
    return found.xy.ravel(), design.reshape(-1, len(x)), photos


def points_in_view(generator, photos):
    xy = generator.uniform(-15.0, 15.0, (len(photos.centres), POINTS, 2))
    depth = generator.uniform(8.0, 14.0, xy.shape[:2])
    in_photo = np.stack([xy[..., 0] / C * depth, xy[..., 1] / C * depth, -depth], axis=-1)
    return photos.centres[:, None] + in_photo @ np.swapaxes(photos.rotations, 1, 2)


def adjusted(generator):
    """Return estimated minus true of the mounting, with its covariance, of a rig started 0.05 and 3 degrees off."""
    offsets, mountings = looking_down_and_oblique()
    centres = generator.normal(0.0, 4.0, (EXPOSURES, 3))
    rotations = rotation_from_angles(generator.normal(0.0, 0.3, (EXPOSURES, 3)))
    true = (centres, rotations, offsets, mountings)
    nothing = np.zeros(PARTS + 6)
    photos = images(nothing, true, np.ones((EXPOSURES, 2, POINTS, 3)))[2]
    ground = points_in_view(generator, photos)
    exact = images(nothing, true, ground)[0]
    measured = exact + generator.normal(0.0, ERROR, exact.shape)
    start = x = generator.normal(0.0, 0.05, nothing.shape)
    for _ in range(6):
        now, design, _ = images(x, true, ground)
        step = np.linalg.lstsq(design, measured - now, rcond=None)[0]
        turned = rotation_about_axes(step.reshape(-1, 6)[:, 3:]) @ rotation_about_axes(x.reshape(-1, 6)[:, 3:])
        x = x + step
        x.reshape(-1, 6)[:, 3:] = rotation_vectors_with_partials(turned)[0]
    assert np.abs(x).max() < np.abs(start).max() / 10.0
    return x[PARTS:], ERROR**2 * np.linalg.inv(design.T @ design)[PARTS:, PARTS:]


def test_the_mounting_of_a_camera_without_common_view_is_true_within_its_covariance():
    generator = np.random.default_rng(7)
    number = 30
    total = 0.0
    for _ in range(number):
        difference, covariance = adjusted(generator)
        total += difference @ np.linalg.solve(covariance, difference)
    low, high = chi2.ppf([0.001, 0.999], 6 * number)
    assert low < total < high, f"errors are {np.sqrt(total / (6 * number)):.3f} of their standard deviations"
