"""Every genuine file of formats that are read and written: imported, exported and imported again it is the same."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exchange.imported import read_well, sample

from orip.conversion.cameras import convert_camera, export_camera, pixels_of_directions
from orip.conversion.ground import from_local_ground, in_local_ground, local_ground
from orip.conversion.poses import exchanged_poses, orip_poses
from orip.exchange.formats import format_named
from orip.records.exchanged import ExchangedProject


def _berlin(folder: Path) -> Path:
    given = sample("opensfm", "berlin")
    shutil.copy(given / "reconstruction_example.json", folder / "reconstruction.json")
    shutil.copy(given / "tracks_example.csv", folder / "tracks.csv")
    return folder


def _unpacked(*names: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        for path in sample(*names).iterdir():
            data = path.read_bytes()
            is_packed = path.suffix == ".gz"
            (folder / (path.stem if is_packed else path.name)).write_bytes(gzip.decompress(data) if is_packed else data)
        return folder

    return make


def _in_place(*names: str) -> Callable[[Path], Path]:
    return lambda _: sample(*names)


SAMPLES: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "COLMAP text": ("colmap", _unpacked("colmap", "sceaux-9-text")),
    "COLMAP binary": ("colmap", _unpacked("colmap", "sceaux-11-binary")),
    "COLMAP 4 binary": ("colmap", _unpacked("colmap", "sceaux-9-colmap4", "binary")),
    "OpenSfM": ("opensfm", _berlin),
    "Metashape": ("metashape", _in_place("metashape", "geograypher", "camera.xml")),
    "MicMac radial": ("micmac", _in_place("micmac", "MMVII-TestDir", "Input", "Saisies-MMV1", "Ori-Ground_mm3d")),
    "MicMac Fraser": ("micmac", _in_place("micmac", "MMVII-TestDir", "Input", "Ori-MMV1")),
    "MMVII": ("micmac", _in_place("micmac", "MMVII-TestDir", "Input", "Saisies-MMV1", "MMVII-PhgrProj")),
}


def through_orip(project: ExchangedProject, name: str) -> ExchangedProject:
    """Return a project whose poses and cameras were orip's between import and export."""
    conventions = format_named(name).conventions
    assert conventions is not None
    assert conventions.lens is not None
    ground = local_ground(project) if project.frame.kind == "geocentric" else None
    local = project if ground is None else in_local_ground(project, ground)
    cameras = tuple(
        export_camera(
            convert_camera(camera, "C").camera, camera.name, conventions.lens,
            conventions.lens_axes, conventions.ray_axes,
        ).camera
        for camera in local.cameras
    )  # fmt: skip
    numbers, positions = exchanged_poses(*orip_poses(local.photos, local.readings[0]), conventions.reading)
    photos = tuple(
        replace(photo, rotation=tuple(numbers[n].tolist()), position=tuple(positions[n].tolist()))
        for n, photo in enumerate(local.photos)
    )
    found = replace(local, cameras=cameras, photos=photos, readings=(conventions.reading,))
    return found if ground is None else from_local_ground(found, ground)


@pytest.mark.parametrize("copies", [True, False], ids=["copy", "new"])
@pytest.mark.parametrize(
    "title", [pytest.param(title, marks=[pytest.mark.long] * title.startswith("COLMAP")) for title in SAMPLES]
)
def test_a_genuine_project_comes_back(tmp_path: Path, title: str, copies: bool) -> None:
    name, make = SAMPLES[title]
    (tmp_path / "given").mkdir()
    source = make(tmp_path / "given")
    found = format_named(name)
    assert found.read is not None
    assert found.write is not None
    before = read_well(found.read, source)
    files = found.write(through_orip(before, name), source if copies else None)
    target = tmp_path / "again"
    target.mkdir()
    for file, data in files.items():
        (target / file).write_bytes(data)
    if name == "opensfm" and copies:
        shutil.copy(source / "tracks.csv", target)
    is_document = name == "metashape"
    after = read_well(found.read, target / next(iter(files)) if is_document else target)
    _require_same(before, after)


def _require_same(before: ExchangedProject, after: ExchangedProject) -> None:
    place = {photo.name: n for n, photo in enumerate(after.photos)}
    order = [place[photo.name] for photo in before.photos]
    (rotations, centres), (found, places) = (orip_poses(one.photos, one.readings[0]) for one in (before, after))
    assert np.abs(found[order] - rotations).max() < 1e-9
    # geocentric coordinates of six million metres have 1e-9 m, and rotations of eight decimals are made orthogonal
    assert np.abs(places[order] - centres).max() < 1e-8
    directions = np.array([[0.3, 0.2], [-0.3, 0.1], [0.1, -0.25], [0.0, 0.0]])
    for n, photo in enumerate(before.photos):
        old, new = before.cameras[photo.camera], after.cameras[after.photos[order[n]].camera]
        seen, again = (pixels_of_directions(convert_camera(one, "C").camera, directions) for one in (old, new))
        # hundredths of a pixel where orip's polynomial only comes near (b2 of Metashape)
        limit = 1e-6 if convert_camera(old, "C").is_exact else 0.03
        assert np.abs(seen - again).max() < limit
    if len(after.rays.photo):
        assert len(after.rays.photo) == len(before.rays.photo)
        assert _rays(after) == pytest.approx(_rays(before), abs=1e-6)


def _rays(project: ExchangedProject) -> np.ndarray:
    """Return the image coordinates in an order of their own, with the points that they are of."""
    coordinates = project.points.coordinates[project.rays.point]
    rows = np.column_stack([project.rays.image, coordinates])
    return rows[np.lexsort(np.round(rows, 4).T)]
