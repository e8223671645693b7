"""`orip prelim`: the whole chain, its listing, and the values where adjustments start from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.files.control.preliminary_text import read_preliminary
from orip.files.stores.definitions import StoredRecord
from orip.files.stores.transaction import writing
from orip.records.control import PreliminaryPoint
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo
from orip.records.preliminary import PreliminaryValues
from orip.units import DEGREES_PER_RADIAN
from orip.workflow.adjust.prelim_steps import PrelimInput, open_prelim, values_of
from orip.workflow.adjust.update import write_points
from orip.workflow.project.definitions import read_definitions, write_definitions
from orip.workflow.project.folder import Project
from orip.workflow.project.preliminary_outputs import listed_values, write_preliminary_listing
from orip.workflow.project.texts import raise_complaints

_SAME = 1e-6
"""Of the distance from photos to points, and in radians: below it values are the same, found a second time."""


@dataclass(frozen=True, slots=True)
class PrelimOutcome:
    """What `orip prelim` found and changed.

    Parameters
    ----------
    given : PrelimInput
    values : PreliminaryValues
    orientations : array (number of photos, 6)
        As in the files; NaN where not found.
    coordinates : tuple of PreliminaryPoint
        As in BUNDLE.PRE.
    photos, points : tuples of str
        Records and lines that have new values.
    others : int
        Points of BUNDLE.PRE that were not computed; they stay.
    listing : Path
    """

    given: PrelimInput
    values: PreliminaryValues
    orientations: FloatArray
    coordinates: tuple[PreliminaryPoint, ...]
    photos: tuple[str, ...]
    points: tuple[str, ...]
    others: int
    listing: Path


def prelim(folder: Path, bundle: str | None) -> PrelimOutcome:
    """Find preliminary values, list how, and keep them: orientations in the photo store, coordinates in BUNDLE.PRE.

    Of the photos the elements that are not constant take the values; points of BUNDLE.PRE that were not computed stay.
    Values that are there already are not written again.

    Raises
    ------
    InputError, UsageError, LockedError
    """
    given = open_prelim(folder, bundle)
    project = given.project
    values = values_of(given)
    found = listed_values(values, given.block.ground)
    orientations, points = found.orientations, found.points
    same = _SAME * _distance(orientations, points)
    changed_photos = _update_photos(project, values, orientations, same)
    changed_points, others = _update_points(given, points, same)
    listing = write_preliminary_listing(project, given.bundle, found)
    return PrelimOutcome(given, values, orientations, points, changed_photos, changed_points, others, listing)


def _distance(orientations: FloatArray, points: Sequence[PreliminaryPoint]) -> float:
    """Return the usual distance from photos to points, ground units; 0 where there are none."""
    found = np.isfinite(orientations[:, 0])
    if not found.any() or not points:
        return 0.0
    middle = np.median([point.coordinates for point in points], axis=0)
    return float(np.median(np.linalg.norm(orientations[found, :3] - middle, axis=1)))


def _update_photos(
    project: Project, values: PreliminaryValues, orientations: FloatArray, same: float
) -> tuple[str, ...]:
    """Give the photo records their new values; each stays bound to the text that it came from."""
    found = {
        record_key(photo.name): row.tolist()
        for photo, row in zip(values.photos, orientations, strict=True)
        if photo.rotation is not None
    }
    with writing(project.record_stores) as stores:
        old = read_definitions(project, stores)
        photos = tuple(_with_values(each, found.get(record_key(each.record.name)), same) for each in old.photos)
        write_definitions(project, stores, old, replace(old, photos=photos))
    pairs = zip(old.photos, photos, strict=True)
    return tuple(new.record.name for before, new in pairs if new.record != before.record)


def _with_values(stored: StoredRecord[Photo], values: list[float] | None, same: float) -> StoredRecord[Photo]:
    if values is None:
        return stored
    photo = stored.record
    difference = np.array(values) - np.array(photo.orientation, dtype=np.float64)
    difference[3:] = np.remainder(difference[3:] + 180.0, 360.0) - 180.0
    if (np.abs(difference) <= [same] * 3 + [_SAME * DEGREES_PER_RADIAN] * 3).all():
        return stored
    orientation = tuple(
        old if kind in photo.constant else new
        for kind, old, new in zip(PHOTO_PARAMETERS, photo.orientation, values, strict=True)
    )
    return replace(stored, record=replace(photo, orientation=orientation))


def _update_points(given: PrelimInput, points: Sequence[PreliminaryPoint], same: float) -> tuple[tuple[str, ...], int]:
    project = given.project
    path = project.preliminary(given.bundle)
    shown = project.shown(path)
    found = read_preliminary(path, shown)
    raise_complaints(found.complaints)
    before = {point.name: point for point in found.records}
    changed = {point.name: point for point in points if not _is_same(point, before.get(point.name), same)}
    if changed:
        write_points(path, shown, tuple({**before, **changed}.values()), project.definition.ground_unit)
    return tuple(changed), len(set(before) - {point.name for point in points})


def _is_same(point: PreliminaryPoint, before: PreliminaryPoint | None, same: float) -> bool:
    if before is None or (before.deviations is None) != (point.deviations is None):
        return False
    return bool((np.abs(np.subtract(point.coordinates, before.coordinates)) <= same).all())
