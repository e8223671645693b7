"""Every genuine file of formats that are read and written: imported, exported and imported again it is the same."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exchange.imported import read_well, sample, with_frame

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
    "VisualSFM": ("nvm", _in_place("colmap", "visualsfm", "sceaux.nvm")),
    # formats that are read alone come back in another one
    "Pix4D": ("pix4d colmap", _in_place("pix4d")),
    "IGN": ("ign blocks", _in_place("opk-ign")),
    "MMVII": ("micmac", _in_place("micmac", "MMVII-TestDir", "Input", "Saisies-MMV1", "MMVII-PhgrProj")),
}


def through_orip(project: ExchangedProject, name: str) -> ExchangedProject:
    """Return a project whose poses and cameras were orip's between import and export."""
    conventions = format_named(name).conventions
    assert conventions is not None
    assert conventions.lens is not None
    ground = local_ground(project) if project.frame.kind == "geocentric" else None
    local = project if ground is None else in_local_ground(project, ground)
    converted = [convert_camera(camera, "C") for camera in local.cameras]
    exported = [
        export_camera(one.camera, one.source.name, conventions.lens, conventions.lens_axes, conventions.ray_axes)
        for one in converted
    ]
    image = local.rays.image.copy()
    of_ray = np.array([photo.camera for photo in local.photos])[local.rays.photo]
    for number, (one, other) in enumerate(zip(converted, exported, strict=True)):
        image[of_ray == number] = other.rays_of_pixels(one.pixels(image[of_ray == number]))
    numbers, positions = exchanged_poses(*orip_poses(local.photos, local.readings[0]), conventions.reading)
    photos = tuple(
        replace(photo, rotation=tuple(numbers[n].tolist()), position=tuple(positions[n].tolist()))
        for n, photo in enumerate(local.photos)
    )
    cameras, rays = tuple(one.camera for one in exported), replace(local.rays, image=image)
    found = replace(local, cameras=cameras, photos=photos, rays=rays, readings=(conventions.reading,))
    return found if ground is None else from_local_ground(found, ground)


@pytest.mark.parametrize("copies", [True, False], ids=["copy", "new"])
@pytest.mark.parametrize(
    "title", [pytest.param(title, marks=[pytest.mark.long] * title.startswith("COLMAP")) for title in SAMPLES]
)
def test_a_genuine_project_comes_back(tmp_path: Path, title: str, copies: bool) -> None:
    names, make = SAMPLES[title]
    reader, name = names.split()[0], names.split()[-1]
    if copies and (reader != name or title == "VisualSFM"):
        pytest.skip("the format is not copied")
    (tmp_path / "given").mkdir()
    source = make(tmp_path / "given")
    found, given = format_named(name), format_named(reader)
    assert found.read is not None
    assert found.write is not None
    assert given.read is not None
    before = _with_sizes(read_well(given.read, source))
    files = found.write(through_orip(before, name), source if copies else None)
    target = tmp_path / "again"
    target.mkdir()
    for file, data in files.items():
        (target / file).write_bytes(data)
    if name == "opensfm" and copies:
        shutil.copy(source / "tracks.csv", target)
    is_document = name == "metashape" or found.is_file
    after = _with_sizes(read_well(found.read, target / next(iter(files)) if is_document else target))
    _require_same(before, after)


def _with_sizes(project: ExchangedProject) -> ExchangedProject:
    """Return a project whose cameras have the size of their photos, which VisualSFM does not write."""
    return project if all(camera.columns for camera in project.cameras) else with_frame(project, 2832, 2128)


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
        assert _rays(after) == pytest.approx(_rays(before), abs=1e-6, nan_ok=True)


def _rays(project: ExchangedProject) -> np.ndarray:
    """Return the image coordinates in an order of their own, with the points that they are of."""
    coordinates = project.points.coordinates[project.rays.point]
    pixels = project.rays.image.copy()
    of_ray = np.array([photo.camera for photo in project.photos])[project.rays.photo]
    for number, camera in enumerate(project.cameras):
        pixels[of_ray == number] = convert_camera(camera, "C").pixels(pixels[of_ray == number])
    rows = np.column_stack([pixels, coordinates])
    return rows[np.lexsort(np.round(rows, 4).T)]
