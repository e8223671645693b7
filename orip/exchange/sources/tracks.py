"""Rays of a project, point by point, as formats have them that list the rays of a point behind its coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import IntArray
from orip.records.exchanged import ExchangedProject


def tracks(project: ExchangedProject) -> Iterator[tuple[int, IntArray]]:
    """Iterate over the places of points with coordinates and the rows of their rays, those that are left out aside."""
    rays = project.rays
    rows = np.flatnonzero(rays.is_active)
    rows = rows[np.argsort(rays.point[rows], kind="stable")]
    borders = np.searchsorted(rays.point[rows], np.arange(len(project.points.names) + 1))
    known = np.isfinite(project.points.coordinates).all(axis=1)
    for place in np.flatnonzero(known).tolist():
        yield place, rows[borders[place] : borders[place + 1]]


def places_in_photos(project: ExchangedProject) -> IntArray:
    """Return the place (k,) of each ray among the rays of its photo, counted from 0."""
    photo = project.rays.photo
    order = np.argsort(photo, kind="stable")
    first = np.searchsorted(photo[order], photo[order])
    found = np.empty(len(photo), dtype=np.int64)
    found[order] = np.arange(len(photo)) - first
    return found
