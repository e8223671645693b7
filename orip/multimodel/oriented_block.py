"""The oriented block: a drive table made ready for driving, with all models in the order of the block."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.multimodel.camera_model import camera_model
from orip.multimodel.model_loop import ModelLoop, model_loop
from orip.multimodel.photo_loop import DrivenPhoto, driven_photo
from orip.records.drive_table import DriveTable
from orip.records.names import record_key


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
