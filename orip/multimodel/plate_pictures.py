"""The images of a project's photos as they lie on the plates, for the page that watches a plate processor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np

from orip.geometry.plane import PlaneTransformation
from orip.images.images_of_photos import image_fault, origin_of_pixels, paths_of_photos
from orip.images.tiles import TILE, StoredImage, TileName, TileStore, level_count
from orip.records.names import record_key
from orip.web.page_server import Document, RequestError
from orip.workflow.observations.films import plate_of_log
from orip.workflow.project.state import ProjectState


class PlatePicture(NamedTuple):
    """An image: the photo's name in the drive table, and from columns and rows to plate units."""

    photo: str
    image: StoredImage
    to_plate: PlaneTransformation
    origin: float


class PlatePictures:
    """Images on the plates; may be used by several threads.

    Parameters
    ----------
    folder : Path
        Of the project.
    """

    def __init__(self, folder: Path, pictures: Sequence[PlatePicture]) -> None:
        self._pictures = tuple(pictures)
        self._store = TileStore(folder) if pictures else None

    def document(self) -> Document:
        """Return by photo size, levels and what takes columns and rows to the plate: a, b, c, d, e, f of a canvas."""
        return {
            "tile": TILE,
            "photos": {
                one.photo: {
                    "number": number,
                    "columns": one.image.size[0],
                    "rows": one.image.size[1],
                    "levels": level_count(*one.image.size),
                    "to_plate": _canvas_matrix(one),
                }
                for number, one in enumerate(self._pictures)
            },
        }

    def picture(self, name: str) -> bytes:
        """Return a tile, ``NUMBER/LEVEL/COLUMN/ROW``.

        Raises
        ------
        RequestError
            If there is no such image.
        InputError
            If it cannot be read, or has no such tile.
        """
        words = name.split("/")
        if len(words) != 4 or not all(word.isascii() and word.isdecimal() and len(word) < 7 for word in words):
            message = "a picture has the number of its photo, its level, column and row"
            raise RequestError(message)
        number, level, column, row = map(int, words)
        if self._store is None or number >= len(self._pictures):
            message = f"there is no photo {number} with an image"
            raise RequestError(message)
        return self._store.tile(self._pictures[number].image, TileName(level, column, row))


def _canvas_matrix(one: PlatePicture) -> list[float]:
    corner, right, down = one.to_plate.apply(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) - one.origin)
    return [*(right - corner).tolist(), *(down - corner).tolist(), *corner.tolist()]


NO_PICTURES = PlatePictures(Path(), ())


def plate_pictures(state: ProjectState, photos: Iterable[str]) -> PlatePictures:
    """Return the images of those photos that have one; none without Pillow.

    Parameters
    ----------
    state : ProjectState
        With definitions.
    photos : iterable of str
        As the drive table calls them.
    """
    if find_spec("PIL") is None:
        return NO_PICTURES
    records = [record for name in photos if (record := state.records.photos.get(record_key(name))) is not None]
    folder, found = state.project.folder, []
    paths, _ = paths_of_photos({photo.name: photo.image for photo in records}, folder, None)
    for photo in records:
        camera, template = state.records.cameras.get(record_key(photo.camera)), state.records.template_of(photo)
        scan = photo.scan or (None if template is None else template.scan)
        path, origin = paths.get(photo.name), origin_of_pixels(camera, scan)
        if path is None or origin is None:
            continue
        sensor = None if camera is None else camera.sensor
        size, _ = image_fault(path, None if sensor is None else (sensor.columns, sensor.rows))
        if size is not None:
            image = StoredImage(path, state.project.shown(path), size)
            found.append(PlatePicture(record_key(photo.name), image, plate_of_log(scan), origin))
    return PlatePictures(folder, found)
