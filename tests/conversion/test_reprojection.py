"""The test which reading of the poses fits."""

from __future__ import annotations

import numpy as np
import pytest
from conversion.exchanged_blocks import OBLIQUE, PINHOLE, block

from orip.exchange.conversion.cameras import convert_camera
from orip.exchange.conversion.poses import other_readings
from orip.exchange.conversion.reprojection import Reprojection, fitting_reading, reprojection, said_of_reading
from orip.records.exchanged import ExchangedProject, PoseReading
from orip.structs import replace

OPK = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree")
CAMERAS = [convert_camera(PINHOLE, "K1")]


def fitted(project: ExchangedProject) -> tuple[Reprojection, bool]:
    return fitting_reading(project, CAMERAS, project.rays.image)


@pytest.mark.parametrize("truth", other_readings(OPK), ids=repr)
def test_the_reading_that_was_meant_is_found_among_all(truth: PoseReading) -> None:
    project = replace(block(truth, noise_px=0.5), readings=(OPK,))
    found, is_declared = fitted(project)
    assert found.fits
    # 0.5 px of each coordinate; 720 values have an rms known to 2.6 per cent
    assert found.rms == pytest.approx(0.5 * np.sqrt(2.0), rel=0.1)
    assert is_declared == (truth == OPK)
    assert found.reading == truth or truth in found.others
    assert (said_of_reading(found, is_declared=is_declared) is None) == (truth == OPK)


def test_a_declared_reading_is_taken_without_a_word() -> None:
    found, is_declared = fitted(block(PoseReading(form="quaternion", position="translation")))
    assert is_declared
    assert said_of_reading(found, is_declared=is_declared) is None
    # printed to 1e-16 of 4000 px, and a few roundings
    assert found.rms < 1e-8


def test_nadir_photos_leave_the_order_of_omega_and_phi_open() -> None:
    angles = np.column_stack([np.full((4, 2), 1e-3), np.arange(4) * 0.7])
    # all look down from one place each: spread the photos by their kappa alone
    project = block(replace(OPK, form="phi_omega_kappa"), angles, noise_px=0.5)
    project = replace(project, readings=(OPK, replace(OPK, form="phi_omega_kappa")))
    found, is_declared = fitted(project)
    assert found.fits
    said = said_of_reading(found, is_declared=is_declared)
    assert said is not None
    assert "fit equally well" in said


def test_no_reading_fits_measurements_that_belong_to_nothing() -> None:
    project = block(OPK)
    shuffled = np.random.default_rng(5).permutation(project.rays.image)
    project = replace(project, rays=replace(project.rays, image=shuffled))
    found, is_declared = fitted(project)
    assert not found.fits
    assert is_declared
    assert said_of_reading(found, is_declared=is_declared) is None


def test_points_without_coordinates_are_intersected() -> None:
    truth = replace(OPK, sense="to_camera")
    project = block(truth, noise_px=0.5)
    unknown = np.full_like(project.points.coordinates, np.nan)
    project = replace(project, points=replace(project.points, coordinates=unknown), readings=(OPK,))
    found, _ = fitted(project)
    assert found.fits
    assert found.reading == truth
    # 6 rays for each point take 3 of 12 redundancies away: 0.5 sqrt(2 * 9 / 12) = 0.61
    assert found.rms == pytest.approx(0.61, rel=0.1)


def test_rays_that_are_left_out_do_not_count_and_points_behind_do() -> None:
    project = block(OPK)
    image = project.rays.image.copy()
    image[0] += 500.0
    active = project.rays.is_active.copy()
    active[0] = False
    project = replace(project, rays=replace(project.rays, image=image, is_active=active))
    found = reprojection(project, CAMERAS, image, OPK)
    assert len(found.lengths) == len(image) - 1
    assert found.rms < 1e-8
    turned = reprojection(project, CAMERAS, image, replace(OPK, camera_axes="y_down"))
    assert turned.is_behind.mean() > 0.5
    assert not turned.fits


def test_the_mean_over_points_is_that_of_their_mean_lengths() -> None:
    project = block(OPK, OBLIQUE, noise_px=0.5)
    found = reprojection(project, CAMERAS, project.rays.image, OPK)
    lengths = np.hypot(*found.residuals.T)
    by_hand = np.mean([lengths[project.rays.point == n].mean() for n in range(60)])
    assert found.mean_of_points(project.rays.point) == pytest.approx(by_hand, rel=1e-12)


def test_without_rays_nothing_speaks_against_a_reading() -> None:
    project = block(OPK)
    none = np.zeros(0, dtype=np.int64)
    rays = replace(
        project.rays, photo=none, point=none, image=np.zeros((0, 2)), deviation=np.zeros(0), is_active=none.astype(bool)
    )
    found, is_declared = fitting_reading(replace(project, rays=rays), CAMERAS, np.zeros((0, 2)))
    assert found.fits
    assert is_declared


def test_a_declared_reading_that_fits_coarsely_is_told_from_one_that_does_not_fit() -> None:
    found, is_declared = fitted(block(OPK, noise_px=12.0))
    # half of the lengths of two coordinates of 12 px are above 12 sqrt(2 ln 2) = 14 px
    assert found.typical == pytest.approx(14.1, rel=0.1)
    assert (found.fits, found.fits_coarsely, is_declared) == (False, True, True)


def test_the_error_of_measurements_follows_from_the_residuals_of_an_adjustment() -> None:
    """Of 30 points in 4 photos; those of 3 points are fewer than the coordinates and orientations."""
    photo, point = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(30), indexing="ij"))
    residuals = np.full((len(photo), 2), 0.5)
    found = Reprojection(OPK, np.zeros((4, 3, 3)), np.zeros((4, 3)), residuals, np.zeros(len(photo), dtype=bool))
    # 240 coordinates, 90 + 24 unknowns
    assert found.measurement_error(photo, point) == pytest.approx(0.5 * np.sqrt(240 / 126))
    few = point < 3
    none = point < 0
    assert np.isnan(replace(found, residuals=residuals[none]).measurement_error(photo[none], point[none]))
    small = replace(found, residuals=residuals[few])
    assert np.isnan(small.measurement_error(photo[few], point[few]))
