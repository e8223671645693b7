"""The oriented block: a drive table made ready for driving, and each of its stereo models in the loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, Number
from orip.geometry.rotation import rotated, rotated_back
from orip.geometry.stereo import PARALLEL, Meeting, axes_of_model, meeting, y_parallax
from orip.multimodel.photo_loop import DrivenPhoto, camera_model, driven_photo
from orip.records.drive_table import DriveCode, DriveModel, DrivePhoto, DriveTable, Triple
from orip.records.names import record_key


class ObjectPlaces(NamedTuple):
    """What n pairs of plate positions show.

    Attributes
    ----------
    xyz : array (n, 3)
        The place with the least square sum of distances to both rays.
    y_parallax : array (n,)
        mm in the photo; zero where the rays meet.
    code : array (n,) of int
        A `DriveCode`; where it is not 0, the other values are meaningless.
    """

    xyz: FloatArray
    y_parallax: FloatArray
    code: NDArray[np.int64]


class ObjectPlace(NamedTuple):
    """What one pair of plate positions shows: as `ObjectPlaces`."""

    xyz: Triple
    y_parallax: float
    code: DriveCode


class ModelLoop(Struct, frozen=True):
    """One model, ready for driving.

    Parameters
    ----------
    left, right : int
        Places of its photos in the block.
    photos : tuple (left, right) of DrivenPhoto
    axes : tuple of 9 floats
        Model axes to ground axes, row by row.
    """

    name: str
    row: int
    column: int
    left: int
    right: int
    photos: tuple[DrivenPhoto, DrivenPhoto]
    axes: tuple[float, ...]

    @property
    def swapped(self) -> bool:
        """Return whether the left photo is not on the upper stage, which the left eyepiece shows."""
        return self.photos[0].stage != "UPPER"

    def object_place(self, upper: tuple[float, float], lower: tuple[float, float]) -> ObjectPlace:
        """Return the place that a pair of plate positions shows."""
        at_left, at_right = (lower, upper) if self.swapped else (upper, lower)
        left, right = self.photos[0].ray(*at_left), self.photos[1].ray(*at_right)
        if left is None or right is None:
            return ObjectPlace((np.nan,) * 3, np.nan, DriveCode.NOT_INVERTIBLE)
        sine_square, along_left, along_right, middle = self._meeting(left, right)
        if not sine_square > PARALLEL:
            return ObjectPlace((np.nan,) * 3, np.nan, DriveCode.PARALLEL_RAYS)
        if along_left <= 0.0 or along_right <= 0.0:
            return ObjectPlace(middle, np.nan, DriveCode.BEHIND_CAMERA)
        return ObjectPlace(middle, self._y_parallax(left, right), DriveCode.NONE)

    def object_places(self, upper: FloatArray, lower: FloatArray) -> ObjectPlaces:
        """Return the places that pairs of plate positions (n, 2) show."""
        at_left, at_right = (lower, upper) if self.swapped else (upper, lower)
        left, right = self.photos[0].rays(at_left), self.photos[1].rays(at_right)
        columns = tuple(left.direction.T), tuple(right.direction.T)
        with np.errstate(all="ignore"):  # the codes say which values are valid
            sine_square, along_left, along_right, middle = self._meeting(*columns)
            parallax = self._y_parallax(*columns)
        code = np.where((along_left <= 0.0) | (along_right <= 0.0), DriveCode.BEHIND_CAMERA, DriveCode.NONE)
        code[~(sine_square > PARALLEL)] = DriveCode.PARALLEL_RAYS
        code = np.where(left.code | right.code, DriveCode.NOT_INVERTIBLE, code)
        return ObjectPlaces(np.stack(middle, axis=1), parallax, code)

    def object_of_model(self, x: Number, y: Number, z: Number) -> tuple[Number, Number, Number]:
        """Return ground coordinates of model coordinates."""
        x0, y0, z0 = self.photos[0].centre
        dx, dy, dz = self.object_direction(x, y, z)
        return x0 + dx, y0 + dy, z0 + dz

    def model_of_object(self, x: Number, y: Number, z: Number) -> tuple[Number, Number, Number]:
        """Return model coordinates of ground coordinates."""
        x0, y0, z0 = self.photos[0].centre
        return rotated_back(self.axes, x - x0, y - y0, z - z0)

    def object_direction(self, x: Number, y: Number, z: Number) -> tuple[Number, Number, Number]:
        """Return a vector given along the model axes along the ground axes."""
        return rotated(self.axes, x, y, z)

    def _meeting(self, left: tuple[Number, ...], right: tuple[Number, ...]) -> Meeting[Number]:
        return meeting(self.photos[0].centre, self.photos[1].centre, left, right)

    def _y_parallax(self, left: tuple[Number, ...], right: tuple[Number, ...]) -> Number:
        c = 0.5 * (self.photos[0].camera.principal_distance + self.photos[1].camera.principal_distance)
        return y_parallax(self.axes, c, left, right)


def model_axes(left: DrivePhoto, right: DrivePhoto) -> FloatArray | None:
    """Return the matrix (3, 3) from model axes to ground axes; see `axes_of_model`."""
    return axes_of_model(left.centre, right.centre, left.rotation[2::3], right.rotation[2::3])


def model_loop(model: DriveModel, photos: dict[str, tuple[int, DrivePhoto, DrivenPhoto]]) -> ModelLoop:
    """Make a model of the drive table ready for driving.

    Parameters
    ----------
    model : DriveModel
        Its photos are on different stages, and it has axes.
    photos : dict by name
        Place in the block, record, and loop of every photo.
    """
    left, right = photos[model.left], photos[model.right]
    axes = model_axes(left[1], right[1])
    if axes is None:
        message = f"model {model.name} has no axes; check the table first"
        raise ValueError(message)
    return ModelLoop(
        model.name, model.row, model.column, left[0], right[0], (left[2], right[2]), tuple(axes.ravel().tolist())
    )


class OrientedBlock(Struct, frozen=True, eq=False):
    """A block of models that can be driven.

    Parameters
    ----------
    photos : tuple of DrivenPhoto
        In the order of the table.
    models : tuple of ModelLoop
        By row and column; their order is that of *Next Model*.
    rows, columns : arrays (number of models,) of int
    """

    table: DriveTable
    photos: tuple[DrivenPhoto, ...]
    models: tuple[ModelLoop, ...]
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]

    def model_index(self, name: str) -> int | None:
        """Return the place of a model by its name; case does not count."""
        return next((place for place, model in enumerate(self.models) if model.name == record_key(name)), None)

    def photo(self, name: str) -> DrivenPhoto | None:
        """Return a photo by its name; case does not count."""
        return next((photo for photo in self.photos if photo.name == record_key(name)), None)

    def distances(self, model: int) -> NDArray[np.int64]:
        """Return |row difference| + |column difference| of all models from one."""
        return np.asarray(np.abs(self.rows - self.rows[model]) + np.abs(self.columns - self.columns[model]))


def oriented_block(table: DriveTable) -> OrientedBlock:
    """Make a drive table ready for driving; `table_faults` finds nothing wrong with it."""
    cameras = {camera.name: camera_model(camera) for camera in table.cameras}
    photos = tuple(driven_photo(photo, cameras[photo.camera], table.limits(photo.stage)) for photo in table.photos)
    by_name = {
        record.name: (place, record, loop)
        for place, (record, loop) in enumerate(zip(table.photos, photos, strict=True))
    }
    in_order = sorted(table.models, key=lambda model: (model.row, model.column))
    return OrientedBlock(
        table,
        photos,
        tuple(model_loop(model, by_name) for model in in_order),
        np.array([model.row for model in in_order], dtype=np.int64),
        np.array([model.column for model in in_order], dtype=np.int64),
    )
