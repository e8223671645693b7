"""What an edit names: the photo or template, and the points, marks or ticks that are measured there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from orip.errors import Complaint, InputError
from orip.interior.definitions import Definitions
from orip.interior.replay import replay
from orip.records.names import near_names, record_key
from orip.records.observations.measurement import EditRecord, LogRecord, Measured
from orip.records.project.photo import Photo, Template

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
    killed = _killed(named, log, definitions) if missing else {}
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


def _killed(named: Named, log: Sequence[LogRecord], definitions: Definitions) -> dict[str, EditRecord]:
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
