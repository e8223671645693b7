"""What an edit names, and what to measure again as a measurement file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.listings.observations import todo_text
from orip.files.text.regular_file import natural_key
from orip.interior.definitions import Definitions
from orip.interior.replay import replay
from orip.records.interior import ListedObservation, Pair, PointToMeasure, WhyAgain
from orip.records.measurement import EditRecord, LogRecord, Measured, PhotoObservations
from orip.records.names import near_names, record_key
from orip.records.photo import Photo, Template
from orip.workflow.observations.listed import (
    NOWHERE,
    Places,
    PredictedPlace,
    listed_observations,
    outdated_warnings,
    require_observations,
)
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.outputs import TextOutput, require_replaceable
from orip.workflow.project.texts import is_measurement_file, raise_complaints

ALL = "*"


class Named(NamedTuple):
    """What is edited (points, marks or ticks), their bundle if they are points, and their photo or template."""

    what: Literal["POINT", "MARK", "TICK"]
    bundle: str | None
    owner: str

    @property
    def noun(self) -> str:
        """Return the noun for a single one in messages."""
        return self.what.lower()


def edited_owner(what: Literal["POINT", "MARK", "TICK"], owner: str, definitions: Definitions) -> str:
    """Return the name of a photo (of a tick: template) as it is defined, or ``*``.

    Raises
    ------
    InputError
        If there is none, with the most similar names.
    """
    if owner == ALL:
        return owner
    kind = "template" if what == "TICK" else "photo"
    records: Mapping[str, Photo | Template] = definitions.templates if what == "TICK" else definitions.photos
    record = records.get(record_key(owner))
    if record is None:
        near = near_names(owner, (record.name for record in records.values()))
        message = f"{kind} {owner} is not defined; {near} ('*' in quotes: all {kind}s)"
        raise InputError.single(message)
    return record.name


def chosen_names(
    action: Literal["DISREGARD", "INCLUDE", "KILL"],
    named: Named,
    names: Sequence[str],
    log: Sequence[LogRecord],
    definitions: Definitions,
    measured: Measured,
) -> list[str]:
    """Return the names for which an edit changes anything.

    Raises
    ------
    InputError
        If names are not measured: all of them at once, each with the most similar names.
    """
    flags = _disregarded(named, measured)
    missing = [name for name in names if name not in (ALL, *flags)]
    killed = _killed_by_edits(named, log, definitions) if missing else {}
    complaints = [
        Complaint(_not_measured(named, name, flags, killed))
        for name in missing
        if name not in killed or action != "KILL"
    ]
    if complaints:
        raise InputError(complaints)
    return [name for name in dict.fromkeys(names) if _changes(action, flags, name)]


def _changes(action: str, flags: Mapping[str, list[bool]], name: str) -> bool:
    of_name = [flag for flagged, found in flags.items() if name in (ALL, flagged) for flag in found]
    return bool(of_name) if action == "KILL" else (action == "INCLUDE") in of_name


def _not_measured(named: Named, name: str, measured: Iterable[str], killed: Mapping[str, EditRecord]) -> str:
    where = {"POINT": "any photo", "MARK": "any photo", "TICK": "any template"}[named.what]
    owner = {"POINT": "photo", "MARK": "photo", "TICK": "template"}[named.what]
    place = where if named.owner == ALL else f"{owner} {named.owner}"
    of_bundle = f" of bundle {named.bundle}" if named.bundle else ""
    if name in killed:
        line = killed[name].place
        return (
            f"{named.noun} {name}{of_bundle} is killed in {place} by {line.path}:{line.line}; take that line out and "
            "run 'orip measure', or measure it again ('orip observations remeasure FILE')"
        )
    return f"{named.noun} {name}{of_bundle} is not measured in {place}; {near_names(name, measured)}"


def _killed_by_edits(named: Named, log: Sequence[LogRecord], definitions: Definitions) -> dict[str, EditRecord]:
    """Return the names that would be measured there if they had not been killed, with the last edit that did it."""
    kills = [
        record
        for record in log
        if isinstance(record, EditRecord) and record.action == "KILL" and record.what == named.what
    ]
    if not kills:
        return {}
    alive = replay(without_kills(log), definitions, Measured()).measured
    keys = {ALL, record_key(named.owner)}
    mine = [
        kill
        for kill in kills
        if (named.owner == ALL or record_key(kill.owner) in keys)
        and (kill.bundle is None or record_key(kill.bundle) == record_key(named.bundle or ""))
    ]
    return {name: kill for name in _disregarded(named, alive) for kill in mine if kill.name in (ALL, name)}


def without_kills(log: Iterable[LogRecord]) -> Iterator[LogRecord]:
    """Yield the records of a log that kill nothing."""
    return (record for record in log if not (isinstance(record, EditRecord) and record.action == "KILL"))


def _disregarded(named: Named, measured: Measured) -> dict[str, list[bool]]:
    """Return whether each name is disregarded, in each of its photos or templates."""
    flags: dict[str, list[bool]] = {}
    for owner, name, disregarded in _rows(named, measured):
        if named.owner == ALL or record_key(owner) == record_key(named.owner):
            flags.setdefault(name, []).append(disregarded)
    return flags


def _rows(named: Named, measured: Measured) -> Iterator[tuple[str, str, bool]]:
    if named.what == "POINT":
        found = measured.observations.get(record_key(named.bundle or ""))
        if found is not None:
            yield from zip(found.photos, found.points, found.disregarded.tolist(), strict=True)
        return
    orientations = measured.templates if named.what == "TICK" else measured.photos
    for key, orientation in orientations.items():
        for name, disregarded in zip(orientation.marks.names, orientation.marks.disregarded.tolist(), strict=True):
            yield key, name, disregarded


class Todo(Struct, frozen=True):
    """What to measure again, and the measurement file that asks for it; `file` is None where none is written."""

    bundle: str
    points: tuple[PointToMeasure, ...]
    text: str
    file: Path | None
    warnings: tuple[ProjectWarning, ...]


def measure_again(bundle: BundleState, output: Path | None = None, *, overwrite: bool = False) -> Change[Todo]:
    """Return the points of a bundle that need a new measurement, and the file to write if one is named.

    These are points that are down-weighted, disregarded or killed, and points in a single photo: they are to be
    measured in the photos that form a model with it or, by the last adjustment, show them.

    Parameters
    ----------
    bundle : BundleState
        With `orip.workflow.observations.listed.LISTED_FROM`.
    output : Path or None
        Relative to the project folder.
    overwrite : bool
        Replace a file that is there.

    Raises
    ------
    UsageError
        If the file already exists and may not be replaced.
    InputError
        If nothing is measured, or a measurement file is at fault.
    """
    require_observations(bundle)
    path = None if output is None else bundle.project.folder / output
    if path is not None:
        require_replaceable(bundle.project, path, force=overwrite, is_text=True)
    points = _points_to_measure(bundle)
    title = bundle.project.title
    text = todo_text(points, title, bundle.name, bundle.solution.run if bundle.solution else None)
    warnings = outdated_warnings(bundle)
    if path is None:
        return Change(bundle.state, Todo(bundle.name, points, text, None, warnings))
    todo = Todo(bundle.name, points, text, path, (*warnings, *_would_be_replayed(bundle, path)))
    return Change(bundle.state, todo, outputs=(TextOutput(path, lambda: [text], "choose another file"),))


def _would_be_replayed(bundle: BundleState, path: Path) -> Iterator[ProjectWarning]:
    if is_measurement_file(bundle.project, path):
        text = (
            "its name matches measurement_files, so 'orip measure' and 'orip run' report errors until its coordinates "
            "are filled in; use another extension to avoid this"
        )
        yield ProjectWarning("unfinished-measurements", bundle.project.shown(path), text)


def _points_to_measure(bundle: BundleState) -> tuple[PointToMeasure, ...]:
    places = Places(bundle)
    again = _killed(bundle, places)
    again += [point for row in listed_observations(bundle) for point in _of_observation(bundle, row, places)]
    order = {key: place for place, key in enumerate(bundle.records.photos)}
    # one line for each point and photo: what is wrong there is more important than that the point has a single ray
    again.sort(key=lambda point: point.why != "single ray")
    first = {(record_key(point.photo), point.point): point for point in again}

    def place(point: PointToMeasure) -> tuple[object, ...]:
        return order[record_key(point.photo)], natural_key(point.point), point.point

    return tuple(sorted(first.values(), key=place))


def _of_observation(bundle: BundleState, row: ListedObservation, places: Places) -> Iterator[PointToMeasure]:
    key = record_key(row.photo)
    why: WhyAgain | None = "disregarded" if row.disregarded else "down-weighted" if row.is_down_weighted else None
    before = places.measured(key, row.measured).log_xy
    if why is not None:
        predicted = _predicted(places, key, row.point)
        yield PointToMeasure(row.photo, row.point, why, before, predicted, row.residual, row.weight_factor)
    if row.rays != 1 or row.disregarded:
        return
    others = [
        other
        for other in bundle.photos
        if other != key
        and (
            row.point in places.predicted(other)
            or (other in bundle.models_of_photos.get(key, {}) and not places.can_predict(other, row.point))
        )
    ]
    for other in others:
        predicted = _predicted(places, other, row.point)
        yield PointToMeasure(bundle.photos[other], row.point, "single ray", NOWHERE, predicted, NOWHERE, NOWHERE)
    if not others:
        yield PointToMeasure(
            row.photo, row.point, "single ray", before, _predicted(places, key, row.point), NOWHERE, NOWHERE
        )


def _predicted(places: Places, photo: str, point: str) -> Pair:
    return places.predicted(photo).get(point, PredictedPlace(NOWHERE, NOWHERE)).log_xy


def _killed(bundle: BundleState, places: Places) -> list[PointToMeasure]:
    """Return the points that the measurement files would leave measured if nothing in them were killed."""
    log = bundle.state.texts.log
    raise_complaints(log.complaints)
    alive = replay(without_kills(log.value.records), bundle.records, Measured()).measured
    found = alive.observations.get(record_key(bundle.name))
    if found is None:
        return []
    there = set(_names(bundle.observations))
    rows = zip(_names(found), found.measured.tolist(), strict=True)
    killed = [(key, point, (x, y)) for (key, point), (x, y) in rows if (key, point) not in there]
    return [
        PointToMeasure(
            bundle.records.photos[key].name, point, "killed",
            before=places.measured(key, xy).log_xy if not np.isnan(xy).any() else NOWHERE,
            predicted=_predicted(places, key, point),
            residual=NOWHERE, weight_factor=NOWHERE,
        )
        for key, point, xy in killed
    ]  # fmt: skip


def _names(observations: PhotoObservations) -> Iterator[tuple[str, str]]:
    return zip(map(record_key, observations.photos), observations.points, strict=True)
