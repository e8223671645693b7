"""Orientations that the space resection of a photo starts from, found without initial values."""

from __future__ import annotations

import numpy as np

from orip.geometry.homography import plane_orientations
from orip.geometry.three_point_resection import three_point_resection
from orip.prelim.resection_adjustment import KnownPoints, Orientations
from orip.prelim.sampling import subsets

_TRIPLES = 50
"""With 35 % blunders a triple is free of them with probability 0.27: 50 of them all miss with probability 1e-7, and
some of the good ones have a good shape."""

_CANDIDATES = 5
"""Orientations that are improved before the best is chosen; both of a plane are among them."""

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
    found = three_point_resection(known.vectors[triples], known.coordinates[triples])
    tried = Orientations(found.rotations[found.valid], found.centres[found.valid])
    if len(known) == 3:
        return _most_square_first(known, tried)
    _, width, thickness = np.linalg.svd(known.coordinates, compute_uv=False)
    if thickness < _PLANE * width:
        tried = tried.joined(_of_plane(known))
    quantile = np.partition(known.squares(tried), known.least - 1, axis=1)[:, known.least - 1]
    best = np.argsort(quantile, kind="stable")
    return tried.of(best[np.isfinite(quantile[best])][:_CANDIDATES])


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
