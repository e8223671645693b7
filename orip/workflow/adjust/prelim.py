"""`orip prelim`: the whole chain, its listing, and the values where adjustments start from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.files.control.preliminary_text import preliminary_text, read_preliminary
from orip.files.listings.preliminary import preliminary_listing
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.text.lines import read_lines
from orip.prelim.ground import orientations_in_project, points_in_project
from orip.records.control import PreliminaryPoint
from orip.records.ground import GroundSystem
from orip.records.names import COMMENT_MARKS, record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo
from orip.records.preliminary import PreliminaryValues
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN
from orip.workflow.adjust.prelim_steps import PrelimInput, prelim_input, values_of
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import EditedText, TextOutput, digest_of_text
from orip.workflow.project.run_id import run_id
from orip.workflow.project.state import ProjectState, StoredParts
from orip.workflow.project.texts import raise_complaints

_REMEDY = "the file is unchanged"


class PreliminaryText(Struct, frozen=True):
    """BUNDLE.PRE as it was read; `digest` is None where there is none, `owner` names project and user."""

    path: Path
    digest: str | None
    comments: tuple[str, ...]
    points: tuple[PreliminaryPoint, ...]
    owner: str = ""

    def edited(self, points: Sequence[PreliminaryPoint], ground_unit: str) -> EditedText:
        """Return the file with other points; the comments that it begins with stay."""
        return EditedText(self.path, self.digest, self._with(points, ground_unit), _REMEDY)

    def output(self, points: Sequence[PreliminaryPoint], ground_unit: str) -> TextOutput:
        """Return the file with other points, to be written after the stores."""
        return TextOutput(self.path, lambda: [self._with(points, ground_unit)], _REMEDY)

    def _with(self, points: Sequence[PreliminaryPoint], ground_unit: str) -> str:
        comments: Sequence[str] = self.comments
        if not any(line.strip() for line in comments):
            comments = [f"! Preliminary coordinates, {ground_unit}: name X Y Z [sX sY sZ]{self.owner}"]
        return "".join(f"{line}\n" for line in comments) + preliminary_text(points)


def read_preliminary_text(project: ProjectFolder, bundle: str) -> PreliminaryText:
    """Read BUNDLE.PRE; one that is missing has no points.

    Raises
    ------
    InputError
        With everything that is wrong in it.
    """
    path = project.preliminary(bundle)
    shown, digest = project.shown(path), digest_of_text(path)
    found = read_preliminary(path, shown)
    raise_complaints(found.complaints)
    lines = read_lines(path, shown, may_be_absent=True).value
    comments = takewhile(lambda line: not line.strip() or line.strip().startswith(COMMENT_MARKS), lines)
    owner = f"; {project.owner}"
    return PreliminaryText(path, digest, tuple(comments), tuple(found.value), owner)


_DIGITS = 3
"""Significant digits of a standard deviation in BUNDLE.PRE; coordinates have as many decimals as it."""


class ListedValues(Struct, frozen=True):
    """Preliminary values as files have them: project coordinates, degrees.

    Parameters
    ----------
    values : PreliminaryValues
        Its absolute orientation lists control as the project has it.
    orientations : array (number of photos, 6)
        X0 Y0 Z0 OMEGA PHI KAPPA; NaN where not found.
    """

    values: PreliminaryValues
    orientations: FloatArray
    points: tuple[PreliminaryPoint, ...]


def listed_values(values: PreliminaryValues, ground: GroundSystem) -> ListedValues:
    """Transform what the chain found to the project's coordinates; its absolute orientation is in them already."""
    return ListedValues(
        values,
        orientations_in_project(values.photos, ground),
        tuple(_rounded(point) for point in points_in_project(values.points, ground)),
    )


def _rounded(point: PreliminaryPoint) -> PreliminaryPoint:
    """Return a point without insignificant digits."""
    known = [deviation for deviation in point.deviations or () if deviation > 0.0]
    if point.deviations is None or not known:
        return point
    decimals = _DIGITS - 1 - math.floor(math.log10(min(known)))
    x, y, z, sx, sy, sz = (round(number, decimals) for number in (*point.coordinates, *point.deviations))
    return PreliminaryPoint(point.name, (x, y, z), (sx, sy, sz))


def preliminary_output(project: ProjectFolder, bundle: str, found: ListedValues) -> TextOutput:
    """Return PRELIM_RESULT.OUT of a bundle."""
    definition = project.definition
    orientations = found.orientations.tolist()

    def listing() -> list[str]:
        text = preliminary_listing(
            found.values,
            orientations,
            found.points,
            definition.ground_unit,
            (("Project", definition.name), ("User", definition.user), ("Bundle", bundle)),
            run_id("prelim", orientations),
        )
        return [text]

    return TextOutput(project.preliminary_listing(bundle), listing, "remove the cause, then repeat the command")


_SAME = 1e-6
"""Part of the distance from photos to points, and radians: values that differ by less were only found a second time."""


class PrelimOutcome(Struct, frozen=True):
    """What `orip prelim` found and changed.

    Parameters
    ----------
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
