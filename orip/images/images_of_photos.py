"""Which image belongs to which photo of a project, and what keeps one from being used."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from orip.errors import Complaint, InputError
from orip.files.image_headers import IMAGE_ENDINGS, read_header
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.records.photo import Scan


def images_by_photo(folder: Path, photos: Iterable[str]) -> tuple[dict[str, Path], list[Complaint]]:
    """Return the image files of a folder that are named as photos are, and what is wrong.

    Parameters
    ----------
    photos : iterable of str
        Names; case does not count.
    """
    try:
        with os.scandir(folder) as entries:
            names = sorted(entry.name for entry in entries)
    except OSError as error:
        return {}, [Complaint(f"the folder cannot be read ({error.strerror})", str(folder))]
    files: dict[str, list[str]] = {}
    for name in names:
        path = Path(name)
        if path.suffix.lower() in IMAGE_ENDINGS:
            files.setdefault(record_key(path.stem), []).append(name)
    found, complaints = {}, []
    for photo in photos:
        own = files.get(record_key(photo), [])
        if len(own) > 1:
            complaints.append(Complaint(f"photo '{photo}' has {len(own)} images: {', '.join(own)}", str(folder)))
        elif own:
            found[photo] = folder / own[0]
    return found, complaints


def image_fault(path: Path, size: tuple[int, int] | None) -> tuple[tuple[int, int] | None, str]:
    """Return columns and rows of an image by its head, without decoding it; or None, and what is wrong with it.

    Parameters
    ----------
    size : tuple of 2 int or None
        Columns and rows of the photo's sensor, if it has one.
    """
    try:
        header = read_header(path)
    except InputError as error:
        return None, reason(error)
    found = (header.columns, header.rows)
    if size is not None and found != size:
        return None, (
            f"the image has {found[0]} x {found[1]} pixels, the sensor of its camera {size[0]} x {size[1]}: give the "
            "image as the camera has stored it, or correct the sensor"
        )
    return found, ""


def reason(error: InputError) -> str:
    """Return what is wrong with an image, without its name."""
    return f"the image cannot be used: {'; '.join(complaint.message for complaint in error.complaints)}"


def paths_of_photos(
    photos: Mapping[str, str | None], folder: Path, images: Path | None
) -> tuple[dict[str, Path], list[Complaint]]:
    """Return the images of photos: those that the project names, else those of a folder that are named as they are.

    Parameters
    ----------
    photos : mapping of str to (str or None)
        What the project names, relative to its folder.
    folder : Path
        Of the project.
    images : Path or None
        Folder of the images; None: that of the project.
    """
    named = {photo: folder / image for photo, image in photos.items() if image is not None}
    others = [photo for photo in photos if photo not in named]
    found, complaints = images_by_photo(images or folder, others) if others else ({}, [])
    return {photo: path for photo in photos if (path := {**found, **named}.get(photo)) is not None}, complaints


def origin_of_pixels(camera: Camera | None, scan: Scan | None) -> float | None:
    """Return where the outer corner of the upper left pixel is in measured coordinates, columns and rows; negated.

    None where a photo is measured in millimetres: nothing tells where these are in its image.
    """
    if camera is not None and camera.sensor is not None:
        return 0.0
    if camera is None or scan is None:
        return None
    return 0.5 if scan.origin == "centre" else 0.0
