"""`orip prelim`: the whole chain, its listing, and the values where adjustments start from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.files.stores.contents.definitions import StoredRecord
from orip.records.names import record_key
from orip.records.observations.control import PreliminaryPoint
from orip.records.project.photo import PHOTO_PARAMETERS, Photo
from orip.records.results.preliminary import PreliminaryValues
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN
from orip.workflow.adjust.prelim_steps import PrelimInput, prelim_input, values_of
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.preliminary_outputs import (
    ListedValues,
    listed_values,
    preliminary_output,
    read_preliminary_text,
)
from orip.workflow.project.state import ProjectState, StoredParts

_SAME = 1e-6
"""Part of the distance from photos to points, and radians: values that differ by less were only found a second time."""


class PrelimOutcome(Struct, frozen=True):
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
    typed : int
        Points of BUNDLE.PRE without standard deviations: a user has typed them; they stay.
    others : int
        Other points of BUNDLE.PRE that were not computed; they stay.
    listing : Path
    """

    given: PrelimInput
    values: PreliminaryValues
    orientations: FloatArray
    coordinates: tuple[PreliminaryPoint, ...]
    photos: tuple[str, ...]
    points: tuple[str, ...]
    typed: int
    others: int
    listing: Path


class FoundValues(Struct, frozen=True):
    """What the whole chain found of a bundle, and from what."""

    given: PrelimInput
    values: PreliminaryValues
    listed: ListedValues


def prelim(bundle: BundleState) -> FoundValues:
    """Find preliminary values of a bundle; see `block_input`."""
    given = prelim_input(bundle)
    values = values_of(given)
    return FoundValues(given, values, listed_values(values, given.block.ground))


def keep_values(found: FoundValues, state: ProjectState) -> Change[PrelimOutcome]:
    """Write preliminary values into a project: orientations into the photo store, coordinates into BUNDLE.PRE.

    The elements of photos that are not constant take the values. Points of BUNDLE.PRE that were not computed stay, and
    so do those without standard deviations: a user has typed them. Unchanged values are not written again.

    Parameters
    ----------
    found : FoundValues
    state : ProjectState
        With definitions; they may have changed since the values were found.
    """
    project, bundle = state.project, found.given.bundle
    orientations, points = found.listed.orientations, found.listed.points
    same = _SAME * _distance(orientations, points)
    before = state.definitions
    photos = _updated_photos(before.photos, found.values, orientations, same)
    pairs = zip(before.photos, photos, strict=True)
    changed_photos = tuple(new.record.name for old, new in pairs if new.record != old.record)
    text = read_preliminary_text(project, bundle)
    known = {point.name: point for point in text.points}
    typed = {point.name for point in text.points if point.deviations is None}
    changed = {
        point.name: point
        for point in points
        if point.name not in typed and not _is_same(point, known.get(point.name), same)
    }
    listing = preliminary_output(project, bundle, found.listed)
    outputs = [listing]
    if changed:
        outputs.insert(0, text.output(tuple({**known, **changed}.values()), project.definition.ground_unit))
    others = len(set(known) - typed - {point.name for point in points})
    outcome = PrelimOutcome(
        found.given,
        found.values,
        orientations,
        points,
        changed_photos,
        tuple(changed),
        len(typed),
        others,
        listing.path,
    )
    return Change(
        state, outcome, StoredParts(replace(before, photos=photos)), project.record_stores, outputs=tuple(outputs)
    )


def _distance(orientations: FloatArray, points: Sequence[PreliminaryPoint]) -> float:
    """Return the usual distance from photos to points, ground units; 0 where there are none."""
    found = np.isfinite(orientations[:, 0])
    if not found.any() or not points:
        return 0.0
    middle = np.median([point.coordinates for point in points], axis=0)
    return float(np.median(np.linalg.norm(orientations[found, :3] - middle, axis=1)))


def _updated_photos(
    photos: Sequence[StoredRecord[Photo]], values: PreliminaryValues, orientations: FloatArray, same: float
) -> tuple[StoredRecord[Photo], ...]:
    """Return the photo records with their new values; each stays bound to the text that it came from."""
    found = {
        record_key(photo.name): row.tolist()
        for photo, row in zip(values.photos, orientations, strict=True)
        if photo.rotation is not None
    }
    return tuple(_with_values(stored, found.get(record_key(stored.record.name)), same) for stored in photos)


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


def _is_same(point: PreliminaryPoint, before: PreliminaryPoint | None, same: float) -> bool:
    if before is None or (before.deviations is None) != (point.deviations is None):
        return False
    return bool((np.abs(np.subtract(point.coordinates, before.coordinates)) <= same).all())
