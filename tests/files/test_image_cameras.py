"""Cameras and exposure stations of image files, from EXIF and XMP."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from exchange.imported import sample
from support.image_heads import DRONE, FOCAL_35, FOCAL_MM, FULL, MODEL, WIDTH, image

from orip.files.exif import exposure_of, image_tags
from orip.files.image_cameras import ImageCamera, camera_of, station_of, utm_zone
from orip.geometry.rotation import rotation_from_navigation
from orip.records.control import Station

pytest.importorskip("exifread")


def camera(folder: Path, size: tuple[int, int], tags: dict[int, object]) -> ImageCamera:
    return camera_of(image_tags(image(folder / "a.jpg", size, tags)), *size)


def station(path: Path) -> Station:
    (found,) = station_of(path.stem, exposure_of(image_tags(path)))
    return found


def test_the_focal_length_is_that_of_the_sensor_or_of_35_mm_film(tmp_path: Path) -> None:
    first = camera(tmp_path, (5472, 3648), FULL)
    # 4000 pixels per cm: 2.5 micrometres
    assert first.model == "Phantom"
    assert first.focal_px == pytest.approx(8.8 / 0.0025)
    assert first.width_mm == pytest.approx(13.68)
    portrait = camera(tmp_path, (3648, 5472), {**FULL, WIDTH: 3648})
    assert portrait.focal_px == pytest.approx(8.8 / 0.0025)
    assert portrait != first
    assert camera(tmp_path, (5472, 3648), {**FULL, FOCAL_MM: (240, 10)}).focal_px == pytest.approx(24.0 / 0.0025)
    phone = camera(tmp_path, (4000, 3000), {MODEL: "P 1", FOCAL_35: 26})
    # the diagonal of 35 mm film is 43.27 mm
    assert phone.focal_px == pytest.approx(26.0 * 5000.0 / math.hypot(36.0, 24.0), abs=0.05)
    assert (phone.width_mm, phone.source) == (0.0, "unknown")
    assert camera(tmp_path, (600, 400), {}).focal_px == 0.0


def test_an_image_that_was_made_smaller_has_larger_pixels(tmp_path: Path) -> None:
    found = camera(tmp_path, (2736, 1824), FULL)
    assert found.focal_px == pytest.approx(8.8 / 0.005)
    assert found.width_mm == pytest.approx(13.68)


def test_positions_and_gimbal_become_stations(tmp_path: Path) -> None:
    single_fix = DRONE.replace("9.9", "9.9001").replace('RtkFlag="50"', 'RtkFlag="16"')
    fixed = station(image(tmp_path / "d1.jpg", (5472, 3648), FULL, DRONE))
    single = station(image(tmp_path / "d2.jpg", (5472, 3648), FULL, single_fix))
    assert fixed.position == pytest.approx((9.9, 53.5, 120.25))
    assert fixed.position_error == (0.01, 0.012, 0.03)
    assert single.position_error == (5.0, 5.0, 10.0)
    assert utm_zone(np.array([fixed.position, single.position])) == "EPSG:32632"
    gimbal = np.radians([[0.0, -80.0, -30.0]])
    assert rotation_from_navigation(np.array([fixed.angles]), "body") == pytest.approx(
        rotation_from_navigation(gimbal, "gimbal"), abs=1e-12
    )


def test_the_sample_of_a_camera_is_read(tmp_path: Path) -> None:
    path = Path(shutil.copy(sample("exif", "lund_01.jpg"), tmp_path))
    found = station(path)
    # Lund in Sweden
    assert found.position[:2] == pytest.approx((13.19, 55.70), abs=0.01)
    assert utm_zone(np.array([found.position])) == "EPSG:32633"
