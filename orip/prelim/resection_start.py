"""Orientations that the space resection of a photo starts from, found without initial values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.geometry.homography import plane_orientations
from orip.geometry.three_point_resection import three_point_resection
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.resection_adjustment import KnownPoints, Orientations
from orip.prelim.sampling import subsets

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_TRIPLES = 50
"""With 35 % blunders a triple is free of them with probability 0.27: 50 of them all miss with probability 1e-7, and
some of the good ones have a good shape."""

_CANDIDATES = 5
"""Orientations that are improved before the best is chosen; both of a plane are among them."""

_FITS = 9.0
"""Square of the standardised residual that most points have at least where no triple has led to the orientation."""

_PLANE = 0.15
"""Thickness over width of an object below which its homography gives orientations too."""


def starting_orientations(known: KnownPoints, seed: int) -> Orientations:
    """Return the most promising orientations, the best first; of three points all there are.

    Parameters
    ----------
    known : KnownPoints
    seed : int
        Of the choice among many triples.

    Returns
    -------
    Orientations
        None where no triple can be seen as it is in the photo.

    Notes
    -----
    Orientations of triples (Grunert 1841), and of an object that is nearly plane from its homography, are ranked by the
    quantile of the residuals that blunders leave alone (least median of squares, Rousseeuw 1984).
    """
    triples = subsets(len(known), 3, _TRIPLES, seed)
    tried, quantile = (_compiled_of_triples if is_compiled() else _of_triples)(known, triples)
    if len(known) == 3:
        return _most_square_first(known, tried)
    if quantile.min(initial=np.inf) > _FITS and _is_flat(known):
        of_plane = _of_plane(known)
        tried, quantile = tried.joined(of_plane), np.concatenate([quantile, _quantile(known, of_plane)])
    best = np.argsort(quantile, kind="stable")
    return tried.of(best[np.isfinite(quantile[best])][:_CANDIDATES])


def _of_triples(known: KnownPoints, triples: IntArray) -> tuple[Orientations, FloatArray]:
    """Return the orientations of triples of points, and their quantiles."""
    found = three_point_resection(known.vectors[triples], known.coordinates[triples])
    tried = Orientations(found.rotations[found.valid], found.centres[found.valid])
    return tried, _quantile(known, tried)


def _compiled_of_triples(known: KnownPoints, triples: IntArray) -> tuple[Orientations, FloatArray]:
    """Do what `_of_triples` does in the compiled loop."""
    count = 4 * len(triples)
    rotations, centres, quantile = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty(count)
    triples = np.ascontiguousarray(triples)
    kernels.rank(
        *known.arrays, triples, rotations, centres, quantile, np.empty(len(known)), known.error_mm, known.least
    )
    valid = np.isfinite(quantile)
    return Orientations(rotations[valid], centres[valid]), quantile[valid]


def _quantile(known: KnownPoints, at: Orientations) -> FloatArray:
    return np.asarray(np.partition(known.squares(at), known.least - 1, axis=1)[:, known.least - 1])


def _is_flat(known: KnownPoints) -> bool:
    _, width, thickness = np.linalg.svd(known.coordinates, compute_uv=False)
    return bool(thickness < _PLANE * width)


def _of_plane(known: KnownPoints) -> Orientations:
    try:
        return Orientations(*plane_orientations(known.vectors, known.coordinates))
    except ValueError:
        return Orientations(np.empty((0, 3, 3)), np.empty((0, 3)))


def _most_square_first(known: KnownPoints, found: Orientations) -> Orientations:
    """Return orientations in the order of the angle at which they look at the plane of three points."""
    normal = np.cross(known.coordinates[1] - known.coordinates[0], known.coordinates[2] - known.coordinates[0])
    cosine = np.abs(found.centres @ normal) / np.linalg.norm(found.centres, axis=1)
    return found.of(np.argsort(-cosine, kind="stable"))
