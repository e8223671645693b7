"""Points that do not fit where partial blocks are joined, and those that are off as the camera is not calibrated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.prelim.rays import ImageRays
from orip.prelim.sampling import median
from orip.prelim.similarity.adjustment import SimilarityAdjustment
from orip.wording import counted

_NAMED = 6
"""Number of points that are named one by one."""

_FOR_BENDING = 12
"""Common points from which on it can be told whether they are off as bent strips are: twice the coefficients."""

_STANDING_OUT = 5.0
"""Median difference from the bent strip above which a point does not belong to it: 7.7 standard deviations."""

_BENT = 0.6
"""Ratio of median residuals after and before below which strips are bent: polynomials alone leave 0.8."""

_DISTORTION = 0.005
"""Part of the largest photo coordinate that a camera which is not calibrated displaces images by."""

_ROUNDS, _LEAST_LENGTH = 20, 1e-12
"""Rounds of reweighting; and a length that is none."""

_MM = 1000.0
"""Millimetres in a metre."""


def room_for_cameras(rays: object, photos: Sequence[int]) -> float:
    """Return how far points of photos may be off at photo scale (m) as cameras are not calibrated; 0: they are."""
    if not isinstance(rays, ImageRays) or not len(rays.cameras.of_photo):
        return 0.0
    is_unknown = bool((rays.cameras.of_photo[list(photos)] >= 0).any())
    return _DISTORTION * float(np.abs(rays.xy).max()) / _MM if is_unknown else 0.0


def misfits(points: Sequence[str], coordinates: FloatArray, found: SimilarityAdjustment, room: float) -> list[str]:
    """Return a sentence for each point that does not fit, for the first few of many.

    Parameters
    ----------
    points : sequence of str, length n
    coordinates : array (n, 3)
    room : float
        How far points may be off as the cameras are not calibrated; those that are off by more are not named where
        their neighbours are off alike.
    """
    fits, off_by = found.fits[: len(points)], found.lengths[: len(points)]
    lengths, is_bent = off_by, np.zeros(len(points), dtype=bool)
    if room:
        left = np.linalg.norm(unbent(coordinates, found.residuals[: len(points)]), axis=1)
        is_bent = ~fits & (off_by <= room)
        if median(left) < _BENT * median(off_by):
            lengths, is_bent = left, is_bent | (~fits & (left <= _STANDING_OUT * median(left)))
    sentences = _standing_out(points, lengths, fits | is_bent)
    if is_bent.any():
        most = float(off_by[is_bent].max()) * _MM
        of_points = f"{counted(int(is_bent.sum()), 'point')} off by up to {most:.2g} mm at photo scale"
        sentences.append(f"{of_points}, as they are where the camera is not calibrated: no point need be wrong")
    return sentences


def _standing_out(points: Sequence[str], lengths: FloatArray, fits: BoolArray) -> list[str]:
    if fits.all():
        return []
    usual = lengths[fits]
    others = f" (the others: {float(np.sqrt(np.mean(usual**2))) * _MM:.2g} mm)" if len(usual) else ""
    off = [k for k in np.argsort(-lengths) if not fits[k]]
    sentences = [
        f"point {points[k]} does not fit: it is off by {lengths[k] * _MM:.2g} mm at photo scale{others}"
        for k in off[:_NAMED]
    ]
    return [*sentences, f"{len(off) - _NAMED} more points do not fit"] if len(off) > _NAMED else sentences


def unbent(coordinates: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return what residuals (n, 3) at coordinates (n, 3) differ from a bent strip by.

    Errors of the camera bend strips: residuals of their connection follow polynomials of the second order in the plane
    of the points, as in the adjustment of strips by polynomials (Schut 1964). They are fitted with weights that fall
    above the median difference, so that no wrong point leads them. Fewer points than `_FOR_BENDING` are taken as they
    are.
    """
    if len(coordinates) < _FOR_BENDING:
        return residuals
    centred = coordinates - coordinates.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    x, y = (centred @ axes[:2].T).T / max(float(np.abs(centred).max()), _LEAST_LENGTH)
    design = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    weight, left = np.ones(len(x)), residuals
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        polynomials, *_ = np.linalg.lstsq(design * root, residuals * root, rcond=None)
        left = residuals - design @ polynomials
        lengths = np.linalg.norm(left, axis=1)
        weight = 1.0 / np.maximum(lengths / max(median(lengths), _LEAST_LENGTH), 1.0)
    return np.asarray(left)
