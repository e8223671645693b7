"""Orientations that the space resection of a photo starts from, found without initial values."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.geometry.homography import plane_orientations
from orip.geometry.three_point_resection import three_point_resection
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.resection.known_points import FEW_BLUNDERS, KnownPoints, Orientations
from orip.prelim.sampling import subsets

_TRIPLES, _TRIPLES_OF_TRACKS = 50, 400
"""Number of triples. With 35 % blunders a triple is free of them with probability 0.27: none of 50 is with probability
1e-7, and some of the good ones have a good shape. With 70 % it is free of them with probability 0.027: none of 400 is
with probability 2e-5."""

CANDIDATES = 5
"""Orientations that are improved before the best one is chosen; both solutions of a plane are among them."""

FITS = 9.0
"""Squared standardised residual that most points exceed at a wrong orientation; as soon as enough candidates stay below
it, no more triples are tried."""

PLANE = 0.15
"""Thickness over width of an object below which its homography gives orientations too, where few points are wrong: it
is of all of them."""


def starting_orientations(known: KnownPoints) -> Orientations:
    """Return the most promising orientations, the best first; of three points all there are.

    Parameters
    ----------
    known : KnownPoints

    Returns
    -------
    Orientations
        None where no camera position shows a triple as measured.

    Notes
    -----
    Orientations of triples (Grunert 1841), and of an object that is nearly plane from its homography, are ranked by the
    quantile of the residuals that blunders do not affect (least median of squares, Rousseeuw 1984).
    """
    triples = triples_of(known)
    tried, quantile = (_compiled_of_triples if is_compiled() else _of_triples)(known, triples)
    if len(known) == 3:
        return _most_square_first(known, tried)
    if quantile.min(initial=np.inf) > FITS and known.blunders <= FEW_BLUNDERS and _is_flat(known):
        of_plane = _of_plane(known)
        tried, quantile = tried.joined(of_plane), np.concatenate([quantile, _quantile(known, of_plane)])
        tried, _ = _best(tried, quantile)
    return tried


def triples_of(known: KnownPoints) -> IntArray:
    """Return the triples of points (s, 3) that orientations are computed from."""
    return triples_for(len(known), known.blunders)


def triples_for(count: int, blunders: float) -> IntArray:
    """Return the triples (s, 3) of `count` points of which such a part may be blunders."""
    return subsets(count, 3, _TRIPLES if blunders <= FEW_BLUNDERS else _TRIPLES_OF_TRACKS)


def _of_triples(known: KnownPoints, triples: IntArray) -> tuple[Orientations, FloatArray]:
    """Return the best orientations of triples of points, the best first, and their quantiles.

    Once enough fitting candidates have been found, further triples are ignored.
    """
    found = three_point_resection(known.vectors[triples], known.coordinates[triples])
    tried = Orientations(found.rotations[found.valid], found.centres[found.valid])
    quantile = _quantile(known, tried)
    triple = np.nonzero(found.valid)[0]
    enough = np.flatnonzero(np.cumsum(quantile <= FITS) >= CANDIDATES)
    looked_at = triple <= (triple[enough[0]] if len(enough) else len(triples))
    return _best(tried.of(looked_at), quantile[looked_at])


def _compiled_of_triples(known: KnownPoints, triples: IntArray) -> tuple[Orientations, FloatArray]:
    """Do what `_of_triples` does in the compiled loop."""
    rotations, centres, quantile = np.empty((CANDIDATES, 3, 3)), np.empty((CANDIDATES, 3)), np.empty(CANDIDATES)
    kernels.rank_triples(
        *known.arrays, triples, rotations, centres, quantile,
        known.error_mm, known.least, FITS,
    )  # fmt: skip
    number = np.count_nonzero(np.isfinite(quantile))
    return Orientations(rotations[:number], centres[:number]), quantile[:number]


def _best(tried: Orientations, quantile: FloatArray) -> tuple[Orientations, FloatArray]:
    """Return the orientations that most points fit best, and their quantiles."""
    best = np.argsort(quantile, kind="stable")
    best = best[np.isfinite(quantile[best])][:CANDIDATES]
    return tried.of(best), quantile[best]


def _quantile(known: KnownPoints, at: Orientations) -> FloatArray:
    return np.asarray(np.partition(known.squares(at), known.least - 1, axis=1)[:, known.least - 1])


def _is_flat(known: KnownPoints) -> bool:
    _, width, thickness = np.linalg.svd(known.coordinates, compute_uv=False)
    return bool(thickness < PLANE * width)


def _of_plane(known: KnownPoints) -> Orientations:
    try:
        return Orientations(*plane_orientations(known.vectors, known.coordinates))
    except ValueError:
        return Orientations(np.empty((0, 3, 3)), np.empty((0, 3)))


def _most_square_first(known: KnownPoints, found: Orientations) -> Orientations:
    """Return orientations in the order of the angle at which they see the plane of three points."""
    normal = np.cross(known.coordinates[1] - known.coordinates[0], known.coordinates[2] - known.coordinates[0])
    cosine = np.abs(found.centres @ normal) / np.linalg.norm(found.centres, axis=1)
    return found.of(np.argsort(-cosine, kind="stable"))
