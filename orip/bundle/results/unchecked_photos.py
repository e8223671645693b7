"""Photos whose orientation nothing checks: three points determine one, and always fit.

Errors of their points are taken up by the orientation in full, so that no residual shows them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.results.ground import undetermined_photos
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.records.coded_names import coded
from orip.records.results.solution import Diagnosis
from orip.wording import agreeing, counted, first_names

UNCHECKED = "unchecked-photo"
"""Code of the diagnosis that names them."""

_NONE = 0.05
"""Redundancy number that is none: of an error a twentieth is seen, found from 18 a-priori errors on (Baarda 1968)."""

_NAMED = 3


class UncheckedPhoto(Struct, frozen=True):
    """A photo, or an exposure of a rig, all observations of which have no redundancy.

    Parameters
    ----------
    where : str
        What it is called: "photo P12", or "exposure E3" where several of its photos show points.
    photos : tuple of int
        Rows of its photos that show points.
    points : int
        Points that they show, each counted once.
    """

    where: str
    photos: tuple[int, ...]
    points: int


def unchecked_photos(solved: SolvedBlock) -> tuple[UncheckedPhoto, ...]:
    """Return the photos that are determined, but checked by nothing; none of a block without redundancy.

    What counts are all observations that are of the photo alone: its points, its station, its elements.
    """
    if solved.variance.redundancy <= 0:
        return ()
    points = solved.block.photo_points
    exposures, names = _exposures(solved)
    largest = _largest_redundancy(solved, exposures, len(names))
    unknown: BoolArray = (solved.problem.unknowns.elements != CONSTANT).any(axis=1)
    determined = unknown & ~undetermined_photos(solved).any(axis=1)
    found = []
    for row in np.flatnonzero(np.isfinite(largest) & (largest < _NONE)).tolist():
        rays = np.flatnonzero((exposures[points.photo] == row) & points.partly_in_use)
        photos = np.unique(points.photo[rays])
        if len(rays) and determined[photos].all():
            where = names[photos[0]] if len(photos) == 1 else names[row]
            found.append(UncheckedPhoto(where, tuple(photos.tolist()), len(np.unique(points.point[rays]))))
    return tuple(found)


def unchecked_diagnosis(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the photos that nothing checks, those of as many points together."""
    found = unchecked_photos(solved)
    for count in sorted({photo.points for photo in found}):
        names = [photo.where for photo in found if photo.points == count]
        where = first_names(names, _NAMED)
        text = f"{counted(count, 'point')} determine {where}, and nothing checks {agreeing(len(names), 'it', 'them')}"
        yield Diagnosis(UNCHECKED, where, text, "measure more points there: a wrong point would not be noticed")


def _exposures(solved: SolvedBlock) -> tuple[IntArray, list[str]]:
    """Return which exposure each photo (n,) belongs to, one of its own if it is on no rig; and their names."""
    photos = solved.block.photos
    exposures, names = np.arange(len(photos)), [f"photo {photo.name}" for photo in photos]
    rigs = solved.problem.unknowns.rigs
    if rigs is not None:
        exposures[rigs.photo] = len(photos) + rigs.exposure
        names += [f"exposure {name}" for name in solved.block.places_on_rigs().exposures]
    return exposures, names


def _largest_redundancy(solved: SolvedBlock, exposures: IntArray, count: int) -> FloatArray:
    """Return the largest redundancy number (count,) of the observations of each exposure, -inf without any."""
    numbers, first = solved.variance.redundancy_numbers, 0
    place = {photo.name: row for photo, row in zip(solved.block.photos, exposures.tolist(), strict=True)}
    largest = np.full(count, -np.inf)
    for kind in solved.problem.observations:
        of_kind = coded(kind.rows.photo).places(place)
        some = np.flatnonzero(of_kind >= 0)
        np.fmax.at(largest, of_kind[some], numbers[first + some])
        first += len(of_kind)
    return largest
