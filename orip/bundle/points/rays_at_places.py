"""Rays to places of points other than where these are, in the form in which the adjustment tries them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.adjustment.equations import OtherPlace
from orip.adjustment.weights import LEAST_WEIGHT, danish_costs
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.kinds.photo_point import POINT_PARTIALS, PhotoPointObservations
from orip.bundle.points.consensus import PointRays
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
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
        columns = _at(self.kind, self.rays[place], point).columns()
        design = np.zeros((len(columns), size + 1))
        rows = np.arange(len(columns))[:, None]
        design[rows, np.where((columns == CONSTANT) | (columns >= size), size, columns)] = self.partials[place]
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
