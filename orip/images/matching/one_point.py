"""A point that is shown in one photo, found in others: search by correlation, then least-squares matching."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.images.matching.least_squares import Fate, MatchSettings, Windows, match_rays

HALF = 36
"""Pixels of a window on each side of its middle."""

SEARCHED = 24
"""Pixels of the photo that shows the point, on each side of where another photo is expected to show it."""

_PATCH = 14
"""Pixels on each side of the point, of the patch that is searched for."""

_STEP = 1.2
"""Pixels between the places of the patch that is matched."""

_LEAST_PEAK = 0.6
"""Correlation from which on what was found is matched."""

_APART = 3
"""Pixels from the highest peak of the correlation beyond which another one is of another place."""

_LEAST_LEAD = 0.05
"""Of the highest peak before those of other places: with less, nothing but the neighbours says which is the point."""


class Expected(Struct, frozen=True):
    """Where a photo is expected to show the point.

    Parameters
    ----------
    grey : ndarray (rows, columns)
        Of the whole photo.
    place : ndarray (2,)
        Column and row from the outer corner of the upper left pixel.
    affine : ndarray (2, 2)
        From pixels of the photo that shows the point to pixels of this one.
    along : tuple of 2 float
        Unit vector of the epipolar line.
    width : float
        How far off it the point may be, pixels.
    """

    grey: NDArray[np.uint8]
    place: NDArray[np.float64]
    affine: NDArray[np.float64]
    along: tuple[float, float] = (1.0, 0.0)
    width: float = np.inf


class Transfer(Struct, frozen=True):
    """Where another photo is expected to show what is at a place of a photo; coordinates as in a measurement file.

    Parameters
    ----------
    photo : str
        The other one.
    expected : ndarray (2,)
    affine : ndarray (2, 2)
        From the one photo to the other there.
    along : ndarray (2,)
        Unit vector of the epipolar line.
    error : float
        How far off the line the orientations may leave it: an a-priori error of photo coordinates.
    """

    photo: str
    expected: NDArray[np.float64]
    affine: NDArray[np.float64]
    along: NDArray[np.float64]
    error: float = 0.0


class FoundPoint(Struct, frozen=True):
    """The point in another photo.

    Parameters
    ----------
    place : ndarray (2,)
        As `Expected.place`.
    covariance : ndarray (2, 2)
        Square pixels.
    correlation : float
    fate : Fate
        What became of it: it is to be used where it is matched.
    """

    place: NDArray[np.float64]
    covariance: NDArray[np.float64]
    correlation: float
    fate: Fate


def find_point(
    grey: NDArray[np.uint8], place: NDArray[np.float64], others: Sequence[Expected]
) -> list[FoundPoint]:  # fmt: skip
    """Find a point of one photo in others.

    All photos are matched together; the place in the first is then what was given, and those in the others are the
    places that correspond to it.

    Parameters
    ----------
    grey : ndarray (rows, columns)
        The photo that shows the point.
    place : ndarray (2,)
        Where it does: column and row from the outer corner of the upper left pixel.
    """
    starts = [_searched(grey, place, other) for other in others]
    rays = [
        (grey, place, np.eye(2)),
        *((one.grey, start, one.affine) for one, (start, *_) in zip(others, starts, strict=True)),
    ]
    middles = [np.floor(at) for _, at, _ in rays]
    windows = Windows(
        np.zeros(len(rays), dtype=np.intp),
        np.stack([_window(picture, middle) for (picture, _, _), middle in zip(rays, middles, strict=True)]),
        np.stack([at - middle + HALF - 0.5 for (_, at, _), middle in zip(rays, middles, strict=True)]),
        _STEP * np.stack([affine for _, _, affine in rays]),
    )
    settings = MatchSettings()
    matched = match_rays(windows, settings)
    in_patch = np.linalg.solve(matched.affine[0], windows.centre[0] - matched.centre[0])
    back = matched.affine @ np.linalg.inv(matched.affine[0])
    places = matched.centre + matched.affine @ in_patch
    found = []
    for ray, (_, peak, lead) in enumerate(starts, start=1):
        covariance = matched.covariance[ray] + back[ray] @ matched.covariance[0] @ back[ray].T
        fate = Fate(int(matched.fate[ray]))
        if fate == Fate.MATCHED and peak < _LEAST_PEAK:
            fate = Fate.CORRELATION
        if fate == Fate.MATCHED and lead < _LEAST_LEAD:
            fate = Fate.ALIKE
        if fate == Fate.MATCHED and matched.fate[0] != Fate.MATCHED:
            fate = Fate(int(matched.fate[0]))
        at = places[ray] + middles[ray] - HALF + 0.5
        found.append(FoundPoint(at, covariance, float(matched.correlation[ray]), fate))
    return found


def _searched(
    grey: NDArray[np.uint8], place: NDArray[np.float64], other: Expected
) -> tuple[NDArray[np.float64], float, float]:
    """Return where another photo correlates best with the patch around a place, how well, and how much better there."""
    import cv2

    reach = SEARCHED + _PATCH
    patch = _resampled(grey, place, np.eye(2), _PATCH)
    around = _resampled(other.grey, other.place, other.affine, reach)
    scores: Any = cv2.matchTemplate(around, patch, cv2.TM_CCOEFF_NORMED)
    columns, rows = np.meshgrid(*(2 * [np.arange(-SEARCHED, SEARCHED + 1.0)]))
    across, down = other.affine @ [columns.ravel(), rows.ravel()]
    off = (across * other.along[1] - down * other.along[0]).reshape(scores.shape)
    is_peak = (scores == cv2.dilate(scores, np.ones((2 * _APART - 1, 2 * _APART - 1)))) & (np.abs(off) <= other.width)
    at = np.unravel_index(int(np.argmax(np.where(is_peak, scores, -1.0) if is_peak.any() else scores)), scores.shape)
    is_peak &= np.maximum(np.abs(columns - columns[at]), np.abs(rows - rows[at])) > _APART
    lead = float(scores[at] - scores[is_peak].max(initial=-1.0))
    return other.place + other.affine @ [columns[at], rows[at]], float(scores[at]), lead


def _resampled(
    grey: NDArray[np.uint8], place: NDArray[np.float64], affine: NDArray[np.float64], reach: int
) -> NDArray[np.float32]:
    """Return grey values around a place, (2 reach + 1, 2 reach + 1), in the geometry of the photo with the point."""
    from scipy.ndimage import map_coordinates

    steps = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(steps, steps)).reshape(2, -1)
    columns, rows = affine @ offsets + (place - 0.5)[:, None]
    first_column, first_row = int(np.floor(columns.min())) - 1, int(np.floor(rows.min())) - 1
    across = np.clip(np.arange(first_column, int(columns.max()) + 3), 0, grey.shape[1] - 1)
    down = np.clip(np.arange(first_row, int(rows.max()) + 3), 0, grey.shape[0] - 1)
    part = grey[np.ix_(down, across)].astype(np.float32)
    values = map_coordinates(part, [rows - first_row, columns - first_column], order=1, mode="nearest")
    return np.asarray(values, dtype=np.float32).reshape(2 * reach + 1, -1)


def _window(grey: NDArray[np.uint8], middle: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the window around a pixel; beyond the edges the outermost pixels go on."""
    reach = np.arange(-HALF, HALF + 1)
    columns = np.clip(int(middle[0]) + reach, 0, grey.shape[1] - 1)
    rows = np.clip(int(middle[1]) + reach, 0, grey.shape[0] - 1)
    found: NDArray[np.uint8] = grey[np.ix_(rows, columns)]
    return found
