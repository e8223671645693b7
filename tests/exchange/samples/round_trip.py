"""Imported, exported and imported again: through orip's cameras and poses, and what has to be the same then."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from exchange.imported import read_well, with_frame

from orip.exchange.conversion.cameras import convert_camera, export_camera, pixels_of_directions
from orip.exchange.conversion.ground import from_local_ground, in_local_ground, local_ground
from orip.exchange.conversion.poses import exchanged_poses, orip_poses
from orip.exchange.formats import format_named
from orip.exchange.project.exported import in_terms_of
from orip.records.exchanged import ExchangedProject
from orip.structs import replace


def through_orip(project: ExchangedProject, name: str) -> ExchangedProject:
    """Return a project whose poses and cameras were orip's between import and export."""
    ground = local_ground(project) if project.frame.kind == "geocentric" else None
    found = local_through_orip(project, name)
    return found if ground is None else from_local_ground(found, ground)


def local_through_orip(project: ExchangedProject, name: str, *, corrects: bool = False) -> ExchangedProject:
    """Return the same in the plain system in which orip has it; measurements may be corrected as an export does."""
    conventions = format_named(name).conventions
    assert conventions is not None
    assert conventions.lens is not None
    ground = local_ground(project) if project.frame.kind == "geocentric" else None
    local = project if ground is None else in_local_ground(project, ground)
    converted = [convert_camera(camera, "C", accepts_any_fit=True) for camera in local.cameras]
    exported = [
        export_camera(
            one.camera,
            one.source.name,
            conventions.lens,
            conventions.lens_axes,
            conventions.ray_axes,
            accepts_any_fit=corrects,
        )
        for one in converted
    ]
    image = local.rays.image.copy()
    of_ray = np.array([photo.camera for photo in local.photos])[local.rays.photo]
    for number, (one, other) in enumerate(zip(converted, exported, strict=True)):
        image[of_ray == number] = other.rays_of_pixels(
            one.pixels(image[of_ray == number]), corrects_distortion=corrects
        )
    numbers, positions = exchanged_poses(*orip_poses(local.photos, local.readings[0]), conventions.reading)
    photos = tuple(
        replace(photo, rotation=tuple(numbers[n].tolist()), position=tuple(positions[n].tolist()))
        for n, photo in enumerate(local.photos)
    )
    cameras, rays = tuple(one.camera for one in exported), replace(local.rays, image=image)
    return replace(local, cameras=cameras, photos=photos, rays=rays, readings=(conventions.reading,))


def comes_back(folder: Path, source: Path, reader: str, name: str, *, copies: bool = False) -> None:
    """Import a project, write it in a format, and require that what is imported again is the same.

    Parameters
    ----------
    folder : Path
        An empty one.
    source : Path
    reader, name : str
        Formats in which it is read and written.
    copies : bool
        It is written into a copy of the source.
    """
    given = format_named(reader)
    assert given.read is not None
    returns(folder, with_sizes(read_well(given.read, source)), name, source if copies else None)


def returns(folder: Path, before: ExchangedProject, name: str, original: Path | None = None) -> ExchangedProject:
    """Write a project in a format, require that what is read again is the same, and return that."""
    found = format_named(name)
    assert found.read is not None
    assert found.write is not None
    files = found.write(through_orip(before, name), original)
    for file, data in files.items():
        (folder / file).write_bytes(data)
    if name == "opensfm" and original is not None:
        shutil.copy(original / "tracks.csv", folder)
    is_document = name == "metashape" or found.is_file
    after = with_sizes(read_well(found.read, folder / next(iter(files)) if is_document else folder))
    require_same(before, after)
    return after


def unchanged_files(source: Path, name: str) -> dict[str, bool]:
    """Return of the files that an export writes into a copy of their source whether they are equal byte by byte.

    Nothing was adjusted, but poses and cameras were orip's between import and export.
    """
    found = format_named(name)
    assert found.read is not None
    assert found.write is not None
    project = read_well(found.read, source)
    assert found.conventions is not None
    ready = local_through_orip(project, name)
    if found.conventions.has_terms_of_original:
        ready = in_terms_of(ready, found, source)
    files = found.write(ready, source)
    folder = source if source.is_dir() else source.parent
    return {file: (folder / file).read_bytes() == data for file, data in files.items() if (folder / file).is_file()}


def with_sizes(project: ExchangedProject) -> ExchangedProject:
    """Return a project whose cameras have the size of their photos, which VisualSFM does not write."""
    return project if all(camera.columns for camera in project.cameras) else with_frame(project, 2832, 2128)


def require_same(before: ExchangedProject, after: ExchangedProject) -> None:
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
