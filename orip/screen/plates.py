"""The images that lie on the plates: of each photo the file, its size, and how its pixels are measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from msgspec import Struct

from orip.errors import InputError, UsageError
from orip.files.text.regular_file import is_there
from orip.images.images_of_photos import image_fault, origin_of_pixels, paths_of_photos
from orip.images.tiles import StoredImage
from orip.records.names import record_key
from orip.workflow.project.state import ProjectState


class Plate(Struct, frozen=True):
    """The image of a photo.

    Parameters
    ----------
    photo : str
    image : Path or None
        None where there is none.
    shown : str
        The file as the user would name it.
    size : tuple of 2 int
        Columns and rows.
    origin : float
        What measured coordinates are less than columns and rows from the outer corner of the upper left pixel.
    fault : str
        Why nothing can be measured in it; empty: it can.
    """

    photo: str
    image: Path | None
    shown: str
    size: tuple[int, int]
    origin: float
    fault: str

    @property
    def stored(self) -> StoredImage:
        """Return the image; there is one."""
        assert self.image is not None, "it has no fault"
        return StoredImage(self.image, self.shown, self.size)

    def to_log(self, pixel: tuple[float, float]) -> tuple[float, float]:
        """Return the coordinates of a measurement file of a place in pixels."""
        return pixel[0] - self.origin, pixel[1] - self.origin

    def to_pixel(self, log: tuple[float, float]) -> tuple[float, float]:
        """Return the place in pixels of coordinates of a measurement file."""
        return log[0] + self.origin, log[1] + self.origin


def plates_of(state: ProjectState, images: Path | None) -> dict[str, Plate]:
    """Return the plates of all photos of a project by their names.

    Parameters
    ----------
    state : ProjectState
        With definitions.
    images : Path or None
        Folder of images that the project does not name; None: that of the project.

    Raises
    ------
    InputError
        If a photo has several images.
    UsageError
        If no photo has an image that can be measured in, or Pillow or OpenCV is not installed.
    """
    _require_packages()
    records, folder = state.records, state.project.folder
    paths, complaints = paths_of_photos({photo.name: photo.image for photo in records.photos.values()}, folder, images)
    if complaints:
        raise InputError(complaints)
    found: dict[str, Plate] = {}
    for photo in records.photos.values():
        camera, template = records.cameras.get(record_key(photo.camera)), records.template_of(photo)
        origin = origin_of_pixels(camera, photo.scan or (None if template is None else template.scan))
        sensor = None if camera is None else camera.sensor
        path = paths.get(photo.name)
        if path is None:
            size, fault = None, "no image of this photo was found: name it with image = in orip.toml"
        elif not is_there(path):
            size, fault = (
                None,
                f"its image {state.project.shown(path)} is missing: put it there, or correct image in orip.toml",
            )
        else:
            size, fault = image_fault(path, None if sensor is None else (sensor.columns, sensor.rows))
        if origin is None:
            fault = "it is measured in millimetres: give its camera a sensor, or the photo a scan"
        shown = "" if path is None else state.project.shown(path)
        found[photo.name] = Plate(photo.name, path, shown, size or (0, 0), origin or 0.0, fault)
    _require_one(found)
    return found


def _require_one(plates: Mapping[str, Plate]) -> None:
    if all(plate.fault for plate in plates.values()):
        faults = "".join(f"\n  photo {plate.photo}: {plate.fault}" for plate in list(plates.values())[:5])
        message = (
            "no photo has an image that can be measured in: name it with image = in orip.toml, or put images named as "
            f"the photos into the project folder, or into one given with --images{faults}"
        )
        raise UsageError(message)


def _require_packages() -> None:
    try:
        import cv2  # noqa: F401
        import PIL  # noqa: F401
    except ImportError as error:
        message = f"images need the package {error.name}, which is not installed: pip install 'orip[images]'"
        raise UsageError(message) from error
