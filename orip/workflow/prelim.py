"""`orip prelim`: the whole chain, its listing, and the values where adjustments start from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orip.errors import OripError
from orip.files.atomic_text import replace_text
from orip.files.preliminary_listing import preliminary_listing
from orip.files.preliminary_text import read_preliminary
from orip.files.stores.definitions import StoredRecord
from orip.files.stores.transaction import writing
from orip.model.control import PreliminaryPoint
from orip.model.names import record_key
from orip.model.photo import PHOTO_PARAMETERS, Photo
from orip.model.preliminary import PreliminaryValues
from orip.prelim.in_project import orientations_in_project, points_in_project
from orip.workflow.prelim_steps import PrelimInput, open_prelim, values_of
from orip.workflow.project import Project
from orip.workflow.records import read_definitions, write_definitions
from orip.workflow.run_id import run_id
from orip.workflow.texts import raise_complaints
from orip.workflow.update import write_points

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PrelimOutcome:
    """What `orip prelim` found and changed.

    Parameters
    ----------
    given : PrelimInput
    values : PreliminaryValues
    orientations : array (number of photos, 6)
        As in the files; NaN where not found.
    photos, points : tuples of str
        Records and lines that have new values.
    others : int
        Points of BUNDLE.PRE that were not computed; they stay.
    listing : Path
    """

    given: PrelimInput
    values: PreliminaryValues
    orientations: FloatArray
    photos: tuple[str, ...]
    points: tuple[str, ...]
    others: int
    listing: Path


def prelim(folder: Path, bundle: str | None) -> PrelimOutcome:
    """Find preliminary values, list how, and keep them: orientations in the photo store, coordinates in BUNDLE.PRE.

    Of the photos the elements that are not constant take the values; points of BUNDLE.PRE that were not computed stay.

    Raises
    ------
    InputError, UsageError, LockedError
    """
    given = open_prelim(folder, bundle)
    project = given.project
    values = values_of(given)
    orientations = orientations_in_project(values.photos, given.block.ground)
    points = points_in_project(values.points, given.block.ground)
    facts = (("Project", project.definition.name), ("User", project.definition.user), ("Bundle", given.bundle))
    text = preliminary_listing(
        values, orientations.tolist(), project.definition.ground_unit, facts, run_id("prelim", orientations.tolist())
    )
    changed_photos = _update_photos(project, values, orientations)
    changed_points, others = _update_points(given, points)
    listing = project.preliminary_listing(given.bundle)
    _write(project, listing, text)
    return PrelimOutcome(given, values, orientations, changed_photos, changed_points, others, listing)


def _update_photos(project: Project, values: PreliminaryValues, orientations: FloatArray) -> tuple[str, ...]:
    """Give the photo records their new values; each stays bound to the text that it came from."""
    found = {
        record_key(photo.name): row.tolist()
        for photo, row in zip(values.photos, orientations, strict=True)
        if photo.rotation is not None
    }
    with writing(project.record_stores) as stores:
        old = read_definitions(project, stores)
        photos = tuple(_with_values(each, found.get(record_key(each.record.name))) for each in old.photos)
        write_definitions(project, stores, old, replace(old, photos=photos))
    pairs = zip(old.photos, photos, strict=True)
    return tuple(new.record.name for before, new in pairs if new.record != before.record)


def _with_values(stored: StoredRecord[Photo], values: list[float] | None) -> StoredRecord[Photo]:
    if values is None:
        return stored
    photo = stored.record
    orientation = tuple(
        old if kind in photo.constant else new
        for kind, old, new in zip(PHOTO_PARAMETERS, photo.orientation, values, strict=True)
    )
    return replace(stored, record=replace(photo, orientation=orientation))


def _update_points(given: PrelimInput, points: list[PreliminaryPoint]) -> tuple[tuple[str, ...], int]:
    project = given.project
    path = project.preliminary(given.bundle)
    shown = project.shown(path)
    found = read_preliminary(path, shown)
    raise_complaints(found.complaints)
    before = {point.name: point for point in found.records}
    after = {**before, **{point.name: point for point in points}}
    changed = tuple(name for name, point in after.items() if point != before.get(name))
    if changed:
        write_points(path, shown, tuple(after.values()), project.definition.ground_unit)
    return changed, len(set(before) - {point.name for point in points})


def _write(project: Project, path: Path, text: str) -> None:
    try:
        replace_text(path, text)
    except OSError as error:
        message = f"{project.shown(path)} cannot be written: {error.strerror or error}; the values are in the stores"
        raise OripError(message) from error
