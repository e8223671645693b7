"""The unknowns and their order: cameras, photos, tied points in the reduced system; all other points eliminated.

Within a photo the order is X0, Y0, Z0, KAPPA, OMEGA, PHI: where two control points leave one rotation undetermined, it is
OMEGA or PHI that is named, and not KAPPA.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.equations import Layout
from orip.model.block import Block
from orip.model.camera import CAMERA_PARAMETERS
from orip.model.photo import PHOTO_PARAMETERS

IntArray = NDArray[np.int64]

CONSTANT = -1
POINT_COORDINATES = ("X", "Y", "Z")
_PHOTO_ORDER = ("X0", "Y0", "Z0", "KAPPA", "OMEGA", "PHI")


class UnknownName(NamedTuple):
    """An unknown in the user's names: group (CAMERA, PHOTO, POINT), record or point, kind."""

    group: str
    name: str
    kind: str


@dataclass(frozen=True, slots=True)
class Unknowns:
    """Columns of the unknowns; `CONSTANT` where a parameter is none.

    Parameters
    ----------
    cameras : array (number of cameras, 11)
    photos : array (number of photos, 6)
        In the order of `PHOTO_PARAMETERS`.
    points : array (number of points, 3)
    layout : Layout
    names : tuple of UnknownName or None, length m + 3 b
        None for places that are no unknowns.
    """

    cameras: IntArray
    photos: IntArray
    points: IntArray
    layout: Layout
    names: tuple[UnknownName | None, ...]

    def values(self, columns: IntArray, vector: NDArray[np.float64], constant: float) -> NDArray[np.float64]:
        """Return the entries of a vector at columns, and `constant` where there is no unknown."""
        return (
            np.where(columns == CONSTANT, constant, vector[np.maximum(columns, 0)])
            if len(vector)
            else np.full(columns.shape, constant)
        )


def number_unknowns(block: Block, constant_points: NDArray[np.bool_], tied_points: Iterable[int]) -> Unknowns:
    """Number the unknowns of a block.

    Parameters
    ----------
    block : Block
    constant_points : array (number of points, 3) of bool
        Coordinates held by control.
    tied_points : iterable of int
        Points that an observation ties to another point: they stay in the reduced system.

    Returns
    -------
    Unknowns
    """
    names: list[UnknownName | None] = []

    def take(group: str, name: str, kind: str) -> int:
        names.append(UnknownName(group, name, kind))
        return len(names) - 1

    cameras = np.full((len(block.cameras), len(CAMERA_PARAMETERS)), CONSTANT)
    for row, camera in enumerate(block.cameras):
        for place, kind in enumerate(CAMERA_PARAMETERS):
            if kind in camera.unknown:
                cameras[row, place] = take("CAMERA", camera.name, kind)
    photos = np.full((len(block.photos), len(PHOTO_PARAMETERS)), CONSTANT)
    for row, photo in enumerate(block.photos):
        for kind in _PHOTO_ORDER:
            if kind not in photo.constant:
                photos[row, PHOTO_PARAMETERS.index(kind)] = take("PHOTO", photo.name, kind)
    points = np.full((len(block.point_names), 3), CONSTANT)
    tied = sorted(set(tied_points))
    for point in tied:
        for place, kind in enumerate(POINT_COORDINATES):
            if not constant_points[point, place]:
                points[point, place] = take("POINT", block.point_names[point], kind)

    reduced = len(names)
    eliminated = np.setdiff1d(np.arange(len(block.point_names)), tied)
    columns = reduced + np.arange(3 * len(eliminated)).reshape(-1, 3)
    held = constant_points[eliminated]
    points[eliminated] = np.where(held, CONSTANT, columns)
    for point, holds in zip(eliminated, held, strict=True):
        name = block.point_names[point]
        names += [
            None if hold else UnknownName("POINT", name, kind)
            for hold, kind in zip(holds, POINT_COORDINATES, strict=True)
        ]
    fixed = np.concatenate([np.zeros(reduced, dtype=bool), held.ravel()])
    return Unknowns(cameras, photos, points, Layout(reduced, len(eliminated), fixed), tuple(names))
