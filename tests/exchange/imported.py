"""What tests of readers have in common: reading without complaints, and the reprojection of what was read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reference.published_data import data_set

from orip.exchange.conversion.cameras import ConvertedCamera, convert_camera
from orip.exchange.conversion.reprojection import Reprojection, fitting_reading
from orip.exchange.format import Read
from orip.records.exchanged import ExchangedProject
from orip.structs import replace


def sample(*names: str) -> Path:
    """Return a genuine file of another program, or skip the test."""
    path = data_set("exchange").joinpath(*names)
    if not path.exists():
        pytest.skip(f"{path} is not there: genuine files of other programs are no part of the project")
    return path


def read_well(read: Read, source: Path) -> ExchangedProject:
    """Read a project that is sound."""
    parsed = read(source, source.name)
    assert not parsed.complaints, parsed.complaints[:3]
    assert parsed.value is not None
    return parsed.value


def with_frame(project: ExchangedProject, columns: int, rows: int) -> ExchangedProject:
    """Return the project with the size of its photos, which some formats do not say."""
    return replace(project, cameras=tuple(replace(camera, columns=columns, rows=rows) for camera in project.cameras))


def converted_cameras(project: ExchangedProject) -> list[ConvertedCamera]:
    return [convert_camera(camera, f"C{n}", accepts_any_fit=True) for n, camera in enumerate(project.cameras)]


def reprojected(project: ExchangedProject) -> tuple[Reprojection, bool]:
    """Return how photos and points fit the measurements, and whether in a reading that the format declares."""
    cameras = converted_cameras(project)
    pixels = np.full((len(project.rays.photo), 2), np.nan)
    camera_of_ray = np.array([project.photos[photo].camera for photo in project.rays.photo], dtype=np.int64)
    for number, camera in enumerate(cameras):
        rows = camera_of_ray == number
        pixels[rows] = camera.corrected_pixels(camera.pixels(project.rays.image[rows]))
    return fitting_reading(project, cameras, pixels)


def written(path: Path, text: str) -> Path:
    """Write a text and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path
