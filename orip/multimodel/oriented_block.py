"""The oriented block: a drive table made ready for driving, and each of its stereo models in the loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, Number
from orip.geometry.rotation import rotated, rotated_back
from orip.multimodel.photo_loop import DrivenPhoto, camera_model, driven_photo
from orip.records.drive_table import DriveCode, DriveModel, DrivePhoto, DriveTable, Triple
from orip.records.names import record_key

# Model axes, in ground units: the origin is the left projection centre, x runs along the base to the right projection
# centre, z is the mean of both cameras' z axes made perpendicular to the base and points towards the cameras, y = z ×
# x.
#
# The y-parallax is that of the photos rectified to the model's axes: with a ray's direction (dx, dy, dz) there, it is
# the difference left minus right of −C dy / dz, with C the mean principal distance, in mm. It is zero exactly when the
# two rays lie in one plane with the base, that is, when they meet.

_PARALLEL = 1e-10
"""Square of the sine of the angle at which rays count as parallel: two seconds of arc."""

_NO_BASE = 1e-9
"""Part of the distance of the projection centres from the origin up to which they coincide."""

_ALONG_BASE = 1e-6
"""Least component of the mean viewing direction across the base that determines the model's z axis."""


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
    name : str
    row, column : int
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
        if not sine_square > _PARALLEL:
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
        code[~(sine_square > _PARALLEL)] = DriveCode.PARALLEL_RAYS
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

    def _meeting(
        self, left: tuple[Number, ...], right: tuple[Number, ...]
    ) -> tuple[Number, Number, Number, tuple[Number, Number, Number]]:
        """Return the square of the sine between rays, how far along each they come nearest, and the middle there.

        The middle of the common perpendicular has the least square sum of distances to two lines.
        """
        bx, by, bz = (b - a for a, b in zip(self.photos[0].centre, self.photos[1].centre, strict=True))
        (ax, ay, az), (cx, cy, cz) = left, right
        aa, cc, ac = ax * ax + ay * ay + az * az, cx * cx + cy * cy + cz * cz, ax * cx + ay * cy + az * cz
        nx, ny, nz = ay * cz - az * cy, az * cx - ax * cz, ax * cy - ay * cx
        square = nx * nx + ny * ny + nz * nz
        ba, bc = bx * ax + by * ay + bz * az, bx * cx + by * cy + bz * cz
        # parallel rays meet nowhere; the floor keeps plain numbers from dividing by zero
        along_left, along_right = (ba * cc - bc * ac) / (square + 1e-300), (ba * ac - bc * aa) / (square + 1e-300)
        x0, y0, z0 = self.photos[0].centre
        middle = (
            x0 + 0.5 * (bx + along_left * ax + along_right * cx),
            y0 + 0.5 * (by + along_left * ay + along_right * cy),
            z0 + 0.5 * (bz + along_left * az + along_right * cz),
        )
        return square / (aa * cc), along_left, along_right, middle

    def _y_parallax(self, left: tuple[Number, ...], right: tuple[Number, ...]) -> Number:
        c = 0.5 * (self.photos[0].camera.principal_distance + self.photos[1].camera.principal_distance)
        (_, y1, z1), (_, y2, z2) = rotated_back(self.axes, *left), rotated_back(self.axes, *right)
        # a ray in the plane of the base has no such image; the floor keeps plain numbers from dividing by zero
        return -c * (y1 / (z1 - 1e-300) - y2 / (z2 - 1e-300))


def model_axes(left: DrivePhoto, right: DrivePhoto) -> FloatArray | None:
    """Return the matrix (3, 3) from model axes to ground axes.

    None where there are no such axes: the centres coincide, or both cameras look along the base.
    """
    first, second = np.array(left.centre), np.array(right.centre)
    base = second - first
    length = float(np.linalg.norm(base))
    if not _NO_BASE * float(np.abs([first, second]).max()) < length < np.inf:
        return None
    ex = base / length
    mean = 0.5 * (np.array(left.rotation[2::3]) + np.array(right.rotation[2::3]))
    across = mean - (mean @ ex) * ex
    if not float(np.linalg.norm(across)) > _ALONG_BASE:
        return None
    ez = across / np.linalg.norm(across)
    return np.column_stack([ex, np.cross(ez, ex), ez])


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
    table : DriveTable
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
