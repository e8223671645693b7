"""Velocities along a trajectory: the given ones, if they are those of its positions, else of a curve through these."""

from __future__ import annotations

from typing import Literal

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.ground_ellipsoid import metres_per_radian
from orip.records.observations.epochs import Epochs
from orip.structs import replace

WGS84 = (6_378_137.0, 6_356_752.314245)
"""Half axes; another ellipsoid changes what is interpolated over some seconds of flight by less than a micrometre."""

_STRETCH = 10.0
"""Seconds over which the way by the velocities is compared with that between the positions: the errors of neighbouring
positions hardly matter over it."""

_LARGEST_PART, _LARGEST_DIFFERENCE = 0.1, 0.5
"""Part of the way, and metres, by which velocities may miss the positions at the end of a stretch. Velocities in other
axes, or in other units, miss them by as much as the way itself."""


def without_contradicting_velocities(trajectory: Epochs) -> tuple[Epochs, tuple[ProjectWarning, ...]]:
    """Return a trajectory without the velocities that are not those of its positions, and what is said of them.

    Programs write velocities along different axes: of the wander frame, of the vehicle, of the map.
    """
    known = np.flatnonzero(np.isfinite(trajectory.velocity).all(axis=1))
    if len(known) < 2:
        return trajectory, ()
    time, velocity = trajectory.time[known], trajectory.velocity[known]
    step = min(max(round(_STRETCH / float(np.median(np.diff(time)))), 1), len(known) - 1)
    by_velocity = np.vstack([np.zeros(3), 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, None]]).cumsum(axis=0)
    place = trajectory.place[known]
    ends = np.arange(0, len(known), step)
    way = np.diff(place[ends], axis=0) * _metres_per_unit(trajectory, place[ends[:-1]])
    missed = np.linalg.norm(np.diff(by_velocity[ends], axis=0) - way, axis=1)
    length = np.linalg.norm(way, axis=1)
    if np.median(missed) <= max(_LARGEST_PART * np.median(length), _LARGEST_DIFFERENCE):
        return trajectory, ()
    worst = int(np.argmax(missed - _LARGEST_PART * length))
    first, last = (int(trajectory.line[known[ends[place]]]) for place in (worst, worst + 1))
    text = (
        f"by the velocities, the position of {last} would be {missed[worst]:.1f} m from where it is: they are along "
        "other axes or in another unit; positions are interpolated without them"
    )
    without = replace(trajectory, velocity=np.full_like(trajectory.velocity, np.nan))
    return without, (ProjectWarning("velocities", f"{trajectory.shown}:{first}", text),)


def velocities(trajectory: Epochs) -> FloatArray:
    """Return the rates (n, 3) of the places: given ones, else those of parabolas through three epochs."""
    order: Literal[1, 2] = 2 if len(trajectory) > 2 else 1
    rates = [np.gradient(column, trajectory.time, edge_order=order) for column in trajectory.place.T]
    given = trajectory.velocity / _metres_per_unit(trajectory, trajectory.place)
    return np.where(np.isnan(given), np.column_stack(rates), given)


def _metres_per_unit(trajectory: Epochs, place: FloatArray) -> FloatArray:
    """Return metres (n, 3) per unit of each coordinate of places."""
    return metres_per_radian(place, WGS84) if trajectory.is_geographic else np.ones_like(place)
