"""Other places of points that a ray contradicts, and rays to them in the form in which the adjustment tries them."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from orip.adjustment.equations import Equations, OtherPlace
from orip.adjustment.weights import LEAST_WEIGHT, danish_costs
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.kinds.photo_point import POINT_PARTIALS, PhotoPointObservations
from orip.bundle.points.consensus import PointRays, points_by_photos_alone
from orip.bundle.rigs.starting import chained
from orip.bundle.state import BlockState, poses_of_rays
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.interior.image_coordinates import image_vectors
from orip.interior.motions import Poses
from orip.records.block import Block
from orip.structs import replace


class RaysAtPlaces(NamedTuple):
    """Rays to p places of points, k to each, linearised there.

    Attributes
    ----------
    kind : PhotoPointObservations
        All photo points of the block, whose equations are the first ones.
    state : BlockState
        Of the photos; and where the points are.
    rays : array (p, k) of int
    points : array (p, 3)
        The places.
    partials : array (p, 2 k, u)
        By all unknowns that a ray touches, divided by the a-priori errors.
    residuals : array (p, 2 k)
        Likewise.
    computable : array (p,) of bool
        Whether all photos see the place.
    """

    kind: PhotoPointObservations
    state: BlockState
    rays: IntArray
    points: FloatArray
    partials: FloatArray
    residuals: FloatArray
    computable: BoolArray

    def costs(self, kept: BoolArray, limit: float) -> FloatArray:
        """Return what the rays cost (p,), those coordinates that are kept (p, 2 k) as squares; infinite if unseen."""
        residuals = np.abs(self.residuals)
        costs = np.where(kept, residuals**2 / 2.0, danish_costs(residuals, limit)).sum(axis=1)
        return np.where(self.computable & np.isfinite(costs), costs, np.inf)

    def after_least_squares(self, kept: BoolArray) -> RaysAtPlaces:
        """Return the rays to the places of least squares of the coordinates that are kept (p, 2 k), photos held."""
        of_points = PointRays(self.partials[:, :, POINT_PARTIALS], self.residuals)
        moved = self.points + of_points.least_squares(weight_factors(kept))
        return rays_at_places(self.kind, self.state, self.rays, moved)

    def other_place(self, place: int, kept: BoolArray, unknowns: Unknowns) -> OtherPlace:
        """Return one of the places, of which some coordinates (2 k,) are kept."""
        rays = self.rays[place]
        point = int(self.kind.point[rays[0]])
        return OtherPlace(
            columns=unknowns.points[point],
            move=self.points[place] - self.state.points[point],
            rows=rows_of_rays(rays),
            weights=weight_factors(kept),
            reduced=self._by_reduced(place, point, unknowns),
            own=self.partials[place][:, POINT_PARTIALS],
            residual=self.residuals[place],
        )

    def _by_reduced(self, place: int, point: int, unknowns: Unknowns) -> FloatArray:
        """Return the partials (2 k, m) of the rays to a place of a point by the reduced unknowns."""
        size = unknowns.layout.reduced
        columns = np.asarray(_at(self.kind, self.rays[place], point).columns(), dtype=np.int64)
        partials, columns = chained(self.partials[place], columns, unknowns.rigs, self.state.partials_of_rigs())
        design = np.zeros((len(columns), size + 1))
        rows = np.arange(len(columns))[:, None]
        design[rows, np.where((columns == CONSTANT) | (columns >= size), size, columns)] = partials
        return np.asarray(design[:, :size])


def rays_at_places(kind: PhotoPointObservations, state: BlockState, rays: IntArray, points: FloatArray) -> RaysAtPlaces:
    """Return the rays (p, k) to places (p, 3)."""
    places, count = rays.shape
    of_rays = rays.ravel()
    at_places = _at(kind, of_rays, np.repeat(np.arange(places), count))
    found = at_places.linearise_with_partials(replace(state, points=points))
    error = kind.rows.error.reshape(-1, 2)[of_rays].ravel()
    return RaysAtPlaces(
        kind,
        state,
        rays,
        points,
        (found.partials / error[:, None]).reshape(places, 2 * count, -1),
        (found.residual / error).reshape(places, 2 * count),
        np.asarray(found.computable.reshape(places, -1).all(axis=1)),
    )


def weight_factors(kept: BoolArray) -> FloatArray:
    """Return the weight factors of coordinates that are kept or not."""
    return np.where(kept, 1.0, LEAST_WEIGHT)


def rows_of_rays(rays: IntArray) -> IntArray:
    """Return the rows (..., 2 k) of rays (..., k)."""
    return np.asarray((2 * rays[..., None] + np.arange(2)).reshape(*rays.shape[:-1], -1))


def _at(kind: PhotoPointObservations, rays: IntArray, point: IntArray | int) -> PhotoPointObservations:
    """Return rays (n,) as observations of other points, one of each, or of one of all."""
    return replace(
        kind,
        photo=kind.photo[rays],
        point=np.broadcast_to(point, rays.shape),
        camera=kind.camera[rays],
        xy=kind.xy[rays],
        at_measured=kind.at_measured[rays],
        is_equidistant=kind.is_equidistant[rays],
    )


# Of three photos in a row any one may be wrong if they contradict each other along the base. The point then lies far
# from where it is, and whether that is better shows only in the other coordinates, and in those of the photos' other
# points. Places are computed with the photos held, for each few coordinates that may be wrong.

_FEWEST_RAYS, _MOST_RAYS = 2, 6
"""Rays of a point: many leave no doubt about a wrong one."""

_FEW_RAYS, _MOST_WRONG = 4, 3
"""Points of up to so many rays may have three wrong coordinates, those of more two, and those of two rays one: any may
be that, and the one with the smallest residual costs least."""

_MOST_PLACES = 6
"""Places of a point that are proposed, those with the lowest robust cost as long as the photos are held."""

_MOST_NUMBERS = 4_000_000
"""Partials that are kept: of large blocks the places of so many points only, the first ones."""

_LESS = 0.002
"""Part of the square of the limit."""

_STEPS = 2
"""Repetitions of where the rays meet by their directions, and then corrections to the place of least squares."""


def other_places(
    block: Block,
    unknowns: Unknowns,
    kind: PhotoPointObservations,
    state: BlockState,
    equations: Equations,
    weights: FloatArray,
    limit: float,
) -> list[OtherPlace]:
    """Return other places of points of which a coordinate has lost weight, with the weights of their rays there.

    Parameters
    ----------
    kind : PhotoPointObservations
        All photo points of the block, whose equations are the first ones.
    equations : Equations
        At the state.
    weights : array (n,)
        Weight factors.
    limit : float
        Standard residual up to which an observation has full weight.
    """
    rays = len(kind.point)
    active = equations.active[: 2 * rays].reshape(-1, 2).all(axis=1)
    reduced = (weights[: 2 * rays] < 1.0).reshape(-1, 2).any(axis=1)
    doubtful = np.zeros(len(state.points), dtype=bool)
    doubtful[kind.point[reduced & active]] = True
    doubtful &= points_by_photos_alone(block, unknowns) & ~state.left_out
    most = _MOST_NUMBERS // (2 * _MOST_RAYS * _MOST_PLACES * max(unknowns.layout.reduced, 1))
    doubtful[np.flatnonzero(doubtful)[most:]] = False
    chosen = np.flatnonzero(active & doubtful[kind.point])
    if not len(chosen):
        return []
    vectors, at = image_vectors(block), poses_of_rays(block, state, slice(None))
    order = chosen[np.argsort(kind.point[chosen], kind="stable")]
    _, starts, counts = np.unique(kind.point[order], return_index=True, return_counts=True)
    found: list[OtherPlace] = []
    for count in np.intersect1d(counts, np.arange(_FEWEST_RAYS, _MOST_RAYS + 1)):
        of_points = order[starts[counts == count][:, None] + np.arange(count)]
        places = _places_of_points(unknowns, kind, state, of_points, vectors, at, weights, limit)
        found += places if count > _FEWEST_RAYS else [place for place in places if _is_nearer(place, equations, limit)]
    return found


def _is_nearer(place: OtherPlace, equations: Equations, limit: float) -> bool:
    """Return whether the wrong coordinate of a point of two rays costs less at another place: nothing else does."""
    here, there = (
        float(danish_costs(np.abs(residual), limit).sum())
        for residual in (equations.residual[place.rows], place.residual)
    )
    return there < here + _LESS * limit**2


def _places_of_points(
    unknowns: Unknowns,
    kind: PhotoPointObservations,
    state: BlockState,
    of_points: IntArray,
    vectors: FloatArray,
    at: Poses,
    weights: FloatArray,
    limit: float,
) -> list[OtherPlace]:
    """Return the places of q points of k rays each, `of_points` (q, k)."""
    kept = _kept(of_points.shape[1])
    rays, kept = np.repeat(of_points, len(kept), axis=0), np.tile(kept, (len(of_points), 1))
    points = _where_directions_meet(Poses(at.centres[rays], at.rotations[rays]), vectors[rays], weight_factors(kept))
    costs = rays_at_places(kind, state, rays, points).costs(kept, limit)
    # not the place where the coordinates are wrong that have lost weight already
    costs[(kept == (weights[rows_of_rays(rays)] >= 1.0)).all(axis=1)] = np.inf
    likely = _lowest(costs, len(of_points), 2 * _MOST_PLACES)
    if not len(likely):  # all are behind a photo
        return []
    rays, kept, points = rays[likely], kept[likely], points[likely]
    there = rays_at_places(kind, state, rays, points)
    for _ in range(_STEPS):
        there = there.after_least_squares(kept)
    costs = there.costs(kept, limit)
    # nor a place where a wrong one fits
    costs[(~kept & (np.abs(there.residuals) <= limit)).any(axis=1)] = np.inf
    by_place = kind.point[rays[:, 0]]
    chosen = [place for point in np.unique(by_place) for place in _cheapest(np.flatnonzero(by_place == point), costs)]
    return [there.other_place(place, kept[place], unknowns) for place in chosen]


def _lowest(costs: FloatArray, points: int, most: int) -> IntArray:
    """Return the places of lowest cost, as many of each of the points, whose places follow each other."""
    order = np.argsort(costs.reshape(points, -1), axis=1, kind="stable")[:, :most]
    chosen = (order + len(costs) // points * np.arange(points)[:, None]).ravel()
    return np.asarray(chosen[np.isfinite(costs[chosen])])


def _cheapest(places: IntArray, costs: FloatArray) -> list[int]:
    """Return the places of a point that are proposed."""
    order = places[np.argsort(costs[places], kind="stable")[:_MOST_PLACES]]
    return [place for place in order.tolist() if np.isfinite(costs[place])]


def _kept(rays: int) -> BoolArray:
    """Return which coordinates (c, 2 k) of k rays are kept: all but up to three, or but two of many."""
    most = 1 if rays == _FEWEST_RAYS else _MOST_WRONG if rays <= _FEW_RAYS else _MOST_WRONG - 1
    wrong = [chosen for count in range(most + 1) for chosen in combinations(range(2 * rays), count)]
    kept = np.ones((len(wrong), 2 * rays), dtype=bool)
    for row, chosen in enumerate(wrong):
        kept[row, list(chosen)] = False
    return kept


def _where_directions_meet(at: Poses, vectors: FloatArray, factors: FloatArray) -> FloatArray:
    """Return the points (p, 3) nearest to planes: each coordinate of a ray gives one through the projection centre.

    `at` (p, k), `vectors` (p, k, 3) in the photo system and the weights `factors` (p, 2 k).
    """
    x, y, z = np.moveaxis(vectors, 2, 0)
    nothing = np.zeros_like(x)
    normals = np.stack([np.stack([z, nothing, -x], axis=2), np.stack([nothing, z, -y], axis=2)], axis=2)
    normals = normals / np.linalg.norm(vectors, axis=2)[:, :, None, None]
    centres = at.centres
    middle = centres.mean(axis=1)
    planes = np.einsum("pkij,pkcj->pkci", at.rotations, normals).reshape(len(vectors), -1, 3)
    offset = -np.einsum("pri,pri->pr", planes, np.repeat(centres - middle[:, None], 2, axis=1))
    points = middle + PointRays(planes, offset).least_squares(factors)
    for _ in range(_STEPS):
        # angles, not distances
        distances = np.linalg.norm(points[:, None] - centres, axis=2)
        nearer: FloatArray = np.repeat((distances.mean(axis=1)[:, None] / distances) ** 2, 2, axis=1)
        points = middle + PointRays(planes, offset).least_squares(factors * nearer)
    return np.asarray(points)
