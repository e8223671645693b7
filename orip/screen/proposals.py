"""Marks that are proposed: a point that was measured in one photo, matched in the others that should show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.images.matching.least_squares import Fate
from orip.images.matching.one_point import Expected, FoundPoint, Transfer, find_point
from orip.images.tiles import TileStore
from orip.screen.plates import Plate

MOST_PHOTOS = 24
"""In which a point is matched at a time."""

MOST_OFF = 2.0
"""Pixels from the epipolar line up to which a mark is accepted with all others; and, where that is more,"""
MOST_ERRORS = 2.5
"""a-priori errors of photo coordinates: the lines of a block that fits badly do."""

MOST_UNCERTAIN = 0.35
"""Pixels of standard deviation up to which a mark is accepted with all others: where a wall ends, or hardly anything
but an edge is to be seen, matching ends at places that differ by pixels, and says so by its error."""

MOST_BACK = 0.5
"""Pixels by which a place that is matched back from another photo may be beside where it was."""

_REACH = 160
"""Pixels around a place that are looked at."""

_SCALES = (0.35, 2.8)
"""Of two photos of a point, within which they can be compared."""

_REASONS = {
    Fate.CORRELATION: "does not correlate",
    Fate.NO_CONVERGENCE: "no convergence",
    Fate.DRIFT: "drifted away",
    Fate.DEFORMED: "deformed",
    Fate.WEAK: "weak texture",
    Fate.ALONE: "does not correlate",
    Fate.CONTRADICTS: "contradicts others",
    Fate.ALIKE: "another place looks alike",
}


class Proposal(Struct, frozen=True):
    """A mark that is proposed.

    Parameters
    ----------
    photo : str
    place : tuple of 2 float
        Pixels.
    error : float
        Standard deviation in its largest direction, pixels.
    off : float
        Pixels from the epipolar line.
    reason : str
        Why it is not to be accepted with all others; empty: it is.
    """

    photo: str
    place: tuple[float, float]
    error: float
    off: float
    reason: str


def propose(
    store: TileStore,
    plates: Mapping[str, Plate],
    photo: str,
    pixel: tuple[float, float],
    transfers: Sequence[Transfer],
    *,
    checks_back: bool = True,
) -> tuple[list[Proposal], list[str]]:
    """Match a place of a photo in others.

    Parameters
    ----------
    plates : mapping of Plate
        By photo.
    pixel : tuple
        Where it shows the point.
    transfers : sequence
        Where the others are expected to show it.
    checks_back : bool
        Match each place in the photo again, and accept only what comes back to where it was.

    Returns
    -------
    proposals : list of Proposal
    faults : list of str
        Of images that cannot be read.

    Raises
    ------
    InputError
        If the image of the photo itself cannot be read.
    """
    grey, place, _ = _part(store, plates[photo], np.array(pixel))
    used, expected, corners, faults = [], [], [], []
    for one in transfers[:MOST_PHOTOS]:
        plate, scale = plates.get(one.photo), float(np.sqrt(abs(np.linalg.det(one.affine))))
        if plate is None or plate.fault or not _SCALES[0] <= scale <= _SCALES[1]:
            continue
        try:
            part, at, corner = _part(store, plate, one.expected + plate.origin)
        except InputError as fault:
            faults.append(str(fault))
            continue
        used.append(one)
        expected.append(Expected(part, at, one.affine, (float(one.along[0]), float(one.along[1])), _width(one)))
        corners.append(corner)
    if not used:
        return [], faults
    found = []
    points = find_point(grey, place, expected)
    for one, corner, point, other in zip(used, corners, points, expected, strict=True):
        at = point.place + corner
        away = at - one.expected - plates[one.photo].origin
        off = abs(float(away[0] * one.along[1] - away[1] * one.along[0]))
        error = float(np.sqrt(max(np.linalg.eigvalsh(point.covariance)[-1], 0.0)))
        reason = _REASONS.get(point.fate, "")
        if not reason and off > _width(one):
            reason = f"{off:.1f} px off the epipolar line"
        if not reason and error > MOST_UNCERTAIN:
            reason = f"uncertain by {error:.2f} px"
        if not reason and checks_back:
            reason = _back(grey, place, other, point)
        x, y = at.round(3).tolist()
        found.append(Proposal(one.photo, (x, y), error, off, reason))
    return found, faults


def _back(grey: NDArray[np.uint8], place: FloatArray, other: Expected, point: FoundPoint) -> str:
    """Return why a point that was found in another photo is not found from there where it was; empty: it is."""
    inverse = np.linalg.inv(other.affine).astype(np.float64)
    (back,) = find_point(other.grey, point.place, [Expected(grey, place, inverse)])
    away = float(np.linalg.norm(back.place - place))
    is_found = back.fate in {Fate.MATCHED, Fate.ALIKE} and away <= MOST_BACK
    return "" if is_found else "is not found back from there"


def _width(transfer: Transfer) -> float:
    """Return how far off the epipolar line a point may be."""
    return max(MOST_OFF, MOST_ERRORS * transfer.error)


def _part(store: TileStore, plate: Plate, place: FloatArray) -> tuple[Any, FloatArray, FloatArray]:
    """Return the grey values around a place, the place in them, and their first column and row."""
    first = np.clip(np.floor(place).astype(int) - _REACH, 0, np.array(plate.size) - 1)
    last = np.minimum(first + 2 * _REACH, plate.size)
    rows, columns = (slice(int(first[axis]), int(last[axis])) for axis in (1, 0))
    part = store.grey(plate.stored, rows, columns)
    return part, place - first, first.astype(np.float64)
