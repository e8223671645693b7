"""Rival places of points: where as many of their rays meet, nearly, as where they are.

Of six rays of which three are wrong near the epipolar lines, two of these may meet a right one. Which of two such
places is right shows in how well their rays fit when the photos follow, not as long as they are held where the wrong
rays have drawn them. Rays are wrong as wholes here.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from orip.adjustment.equations import Equations, OtherPlace
from orip.adjustment.weights import danish_costs
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.kinds.control_point import ControlPointObservations
from orip.bundle.kinds.observation import Observations
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.points.consensus import points_by_photos_and_control
from orip.bundle.points.other_places import RaysAtPlaces, rays_at_places, rows_of_rays, weight_factors
from orip.bundle.state import BlockState, poses_of_rays
from orip.bundle.unknowns import Unknowns
from orip.geometry.rays import PhotoRays, rival_positions
from orip.interior.image_coordinates import image_vectors
from orip.records.block import Block
from orip.structs import replace

_FEWEST, _MEETING, _MOST_RAYS = 2, 3, 10
"""Rays that have to meet, where no more do so now, and else, as two do by chance; and rays of a point: of many the
right ones outweigh the others."""

_MOST_NUMBERS = 4_000_000
"""Partials that are kept: of large blocks the places of lowest cost."""

_STEPS = 2
"""Corrections to the place of least squares."""


class ControlRows(NamedTuple):
    """Observed coordinates of control points.

    Attributes
    ----------
    rows : array (n,) of int
        Their equations.
    """

    observations: ControlPointObservations
    rows: IntArray


def control_rows(kinds: Sequence[Observations]) -> ControlRows:
    """Return the control points among all kinds of observation of a block, in the order of their equations."""
    ends = np.cumsum([len(kind.rows.error) for kind in kinds]).tolist()
    return next(
        ControlRows(kind, np.arange(end - len(kind.rows.error), end))
        for kind, end in zip(kinds, ends, strict=True)
        if isinstance(kind, ControlPointObservations)
    )


def rival_places(
    block: Block,
    unknowns: Unknowns,
    kind: PhotoPointObservations,
    control: ControlRows,
    state: BlockState,
    equations: Equations,
    weights: FloatArray,
    limit: float,
) -> list[OtherPlace]:
    """Return for points of which a ray has lost weight the best place with such a ray, if it costs hardly more.

    The cost is that with the photos held; it may be higher by less than what one ray costs at most. Of each point there
    is one place.

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
    size = 2 * len(kind.point)
    active = equations.active[:size].reshape(-1, 2).all(axis=1)
    fitting: BoolArray = np.asarray((weights[:size] >= 1.0).reshape(-1, 2).all(axis=1))
    doubtful = np.zeros(len(state.points), dtype=bool)
    doubtful[kind.point[active & ~fitting]] = True
    doubtful &= points_by_photos_and_control(block, unknowns) & ~state.left_out
    chosen = np.flatnonzero(active & doubtful[kind.point])
    if not len(chosen):
        return []
    order = chosen[np.argsort(kind.point[chosen], kind="stable")]
    at, error = poses_of_rays(block, state, order), np.sqrt(np.mean(kind.rows.error.reshape(-1, 2)[order] ** 2, axis=1))
    rays = PhotoRays(at.centres, at.rotations, image_vectors(block)[order], error)
    _, starts, counts = np.unique(kind.point[order], return_index=True, return_counts=True)
    found: list[tuple[float, OtherPlace]] = []
    for count in np.intersect1d(counts, np.arange(_MEETING, _MOST_RAYS + 1)):
        places = starts[counts == count][:, None] + np.arange(count)
        of_points = order[places]
        positions = rival_positions(rays, places, fitting[of_points], limit)
        met: BoolArray = np.asarray(np.isfinite(positions).all(axis=1))
        there = _adjusted(rays_at_places(kind, state, of_points[met], positions[met]), limit)
        found += _of_nearly_the_cost(unknowns, there, fitting[of_points[met]], control, equations, limit)
    most = _MOST_NUMBERS // (2 * _MOST_RAYS * max(unknowns.layout.reduced, 1))
    return [place for _, place in sorted(found, key=itemgetter(0))[:most]]


def _adjusted(there: RaysAtPlaces, limit: float) -> RaysAtPlaces:
    """Return the rays to the places that those determine which nearly fit."""
    for _ in range(_STEPS):
        there = there.after_least_squares(np.repeat(_lengths(there.residuals) <= 2.0 * limit, 2, axis=1))
    return there


def _of_nearly_the_cost(
    unknowns: Unknowns,
    there: RaysAtPlaces,
    fitting: BoolArray,
    control: ControlRows,
    equations: Equations,
    limit: float,
) -> list[tuple[float, OtherPlace]]:
    """Return the places that cost hardly more, and by how much; `fitting` (p, k) are the rays that fit elsewhere."""
    kept = _lengths(there.residuals) <= limit
    # where no more than two rays meet, two others may as well
    enough = kept.sum(axis=1) >= np.clip(fitting.sum(axis=1), _FEWEST, _MEETING)
    likely = np.flatnonzero(there.computable & enough & (kept & ~fitting).any(axis=1))
    points = there.state.points.copy()
    of_places = there.kind.point[there.rays[:, 0]]
    points[of_places[likely]] = there.points[likely]
    of_control = _ControlThere.at(control, replace(there.state, points=points))
    here = equations.residual[rows_of_rays(there.rays)]
    more = danish_costs(_lengths(there.residuals), limit).sum(axis=1) - danish_costs(_lengths(here), limit).sum(axis=1)
    found = []
    for number in likely.tolist():
        place = there.other_place(number, np.repeat(kept[number], 2), unknowns)
        rows = np.flatnonzero((of_control.point == of_places[number]) & equations.active[of_control.rows])
        before = np.abs(equations.residual[of_control.rows[rows]])
        after = np.abs(of_control.residual[rows])
        cost = float(more[number] + (danish_costs(after, limit) - danish_costs(before, limit)).sum())
        if cost < limit**2:
            found.append((cost, of_control.with_rows(place, rows, limit)))
    return found


class _ControlThere(NamedTuple):
    """Observed coordinates with their points (n,) at other places: rows (n,), partials (n, 3) by the points, residuals.

    All divided by the a-priori errors.
    """

    point: IntArray
    rows: IntArray
    own: FloatArray
    residual: FloatArray

    @staticmethod
    def at(control: ControlRows, state: BlockState) -> _ControlThere:
        """Return them at a state."""
        kind = control.observations
        found, error = kind.linearise_with_partials(state), kind.rows.error
        return _ControlThere(kind.point, control.rows, found.partials / error[:, None], found.residual / error)

    def with_rows(self, place: OtherPlace, rows: IntArray, limit: float) -> OtherPlace:
        """Return the other place of a control point with some of the observed coordinates (c,), which are its own."""
        return place._replace(
            rows=np.concatenate([place.rows, self.rows[rows]]),
            weights=np.concatenate([place.weights, weight_factors(np.abs(self.residual[rows]) <= limit)]),
            reduced=np.vstack([place.reduced, np.zeros((len(rows), place.reduced.shape[1]))]),
            own=np.vstack([place.own, self.own[rows]]),
            residual=np.concatenate([place.residual, self.residual[rows]]),
        )


def _lengths(residuals: FloatArray) -> FloatArray:
    """Return the lengths (q, k) of residuals (q, 2 k)."""
    return np.asarray(np.sqrt((residuals**2).reshape(len(residuals), -1, 2).sum(axis=2)))
