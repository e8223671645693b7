"""The image files that photos name: which are missing, unusable, or of another size than the camera's sensor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from orip.errors import InputError, ProjectWarning
from orip.files.image_headers import read_header
from orip.files.text.regular_file import is_there
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.records.photo import Photo

IMAGE_CODE = "image-file"
"""Code of the warning about an image that cannot be used for its photo."""


def image_path(folder: Path, photo: Photo) -> Path | None:
    """Return the path of a photo's image, from the project folder; None of a photo that names none."""
    return None if photo.image is None else folder / photo.image


def image_warnings(folder: Path, photos: Iterable[Photo], cameras: Mapping[str, Camera]) -> tuple[ProjectWarning, ...]:
    """Return a warning for each photo whose image cannot be used, or is that of another one; no pixel is decoded.

    Parameters
    ----------
    folder : Path
        Of the project.
    cameras : mapping of str to Camera
        By `record_key`.
    """
    first: dict[Path, str] = {}
    found = []
    for photo in photos:
        camera, path = cameras.get(record_key(photo.camera)), image_path(folder, photo)
        fault = image_fault(folder, photo, camera)
        # a scan may show several photos
        if not fault and path is not None and camera is not None and camera.sensor is not None:
            other = first.setdefault(path, photo.name)
            if other != photo.name:
                fault = f"its image {photo.image} is that of photo {other}; correct 'image' in orip.toml"
        if fault:
            found.append(ProjectWarning(IMAGE_CODE, f"photo {photo.name}", fault))
    return tuple(found)


def usable_images(folder: Path, photos: Iterable[Photo], cameras: Mapping[str, Camera]) -> dict[str, Path]:
    """Return the paths of the images of photos that name one that can be used, by `record_key`."""
    return {
        record_key(photo.name): path
        for photo in photos
        if (path := image_path(folder, photo)) is not None
        and not image_fault(folder, photo, cameras.get(record_key(photo.camera)))
    }


def image_fault(folder: Path, photo: Photo, camera: Camera | None) -> str:
    """Say why the image of a photo cannot be used; empty if it can, or the photo names none."""
    path = image_path(folder, photo)
    if path is None:
        return ""
    if not is_there(path):
        return f"its image {photo.image} is missing; put it there, or correct 'image' in orip.toml"
    try:
        header = read_header(path, photo.image or "")
    except InputError as error:
        return f"its image {photo.image} cannot be used: {error.complaints[0].message}"
    sensor = None if camera is None else camera.sensor
    size = (header.columns, header.rows)
    if sensor is None or size == (sensor.columns, sensor.rows):
        return ""
    found = f"its image {photo.image} has {size[0]} x {size[1]} pixels, and the sensor of camera {photo.camera} has"
    remedy = (
        "name the image as the camera wrote it"
        if size != (sensor.rows, sensor.columns)
        else ("it was turned: name the image as the camera wrote it, whose pixels are not turned")
    )
    return f"{found} {sensor.columns} x {sensor.rows}; {remedy}"
