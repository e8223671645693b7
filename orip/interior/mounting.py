"""Mountings: films as they lay on the stage, with the marks that were measured on them there.

A later edit may still take a mark away from a mounting, and with it change where everything measured in that mounting
is. So a replay keeps plate coordinates and the number of their mounting until the log has ended; only then are they
taken to the coordinates that are stored.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Generic, TypeVar

import numpy as np
from msgspec import Struct

from orip.records.names import record_key
from orip.records.observations.measurement import (
    EditRecord,
    MeasuredMarks,
    PhotoOrientation,
    TemplateOrientation,
    TextPlace,
)
from orip.structs import replace

STORED = -1
"""Number of the mounting of what the stores hold already: nothing has to be done to its coordinates."""

Orientation = TypeVar("Orientation", TemplateOrientation, PhotoOrientation)


class Mounting(Struct, Generic[Orientation], frozen=True):
    """One mounting of a template or photo.

    Parameters
    ----------
    history : tuple of (orientation, place)
        The orientation as measured and after each edit, with the record it comes from; None: from the stores. Marks
        are in plate mm; those that the stores hold for a photo on a template in template mm.
    template_mounting : int
        Of a photo on a template: the mounting of the template in which the marks were measured.
    ended_by : TextPlace or None
        The edit that killed the last of its marks: the film is no longer oriented. What was measured in the mounting
        before stays where it is on the film; the orientation is the one that it had until then.
    """

    history: tuple[tuple[Orientation, TextPlace | None], ...]
    template_mounting: int = STORED
    ended_by: TextPlace | None = None

    @property
    def orientation(self) -> Orientation:
        """Return the orientation after all edits."""
        return self.history[-1][0]

    def edited(self, record: EditRecord, names: Collection[str]) -> Mounting[Orientation]:
        """Return the mounting with some of its marks edited; killing all of them ends it."""
        if record.action == "KILL" and len(names) == len(self.orientation.marks.names):
            return replace(self, ended_by=record.place)
        marks = _edited_marks(self.orientation.marks, record, names)
        orientation = replace(self.orientation, marks=marks)
        return replace(self, history=self.history + ((orientation, record.place),))  # noqa: RUF005  (mypy: a TypeVar)


class FilmMountings(Generic[Orientation]):
    """The mountings of all templates, or of all photos, by `record_key`; each list in the order of the log."""

    def __init__(self, stored: Mapping[str, Orientation]) -> None:
        self._mountings: dict[str, list[Mounting[Orientation]]] = {
            key: [Mounting(((orientation, None),))] for key, orientation in stored.items()
        }

    def of(self, key: str) -> list[Mounting[Orientation]]:
        """Return the mountings of one film; none where its marks were never measured."""
        return self._mountings.get(key, [])

    def mount(self, key: str, mounting: Mounting[Orientation]) -> None:
        """Add a mounting."""
        self._mountings.setdefault(key, []).append(mounting)

    def mount_only(self, key: str, mounting: Mounting[Orientation]) -> None:
        """Put a mounting in the place of all earlier ones."""
        self._mountings[key] = [mounting]

    def in_force(self, key: str) -> Mounting[Orientation] | None:
        """Return the mounting that orients a film; None where its marks were never measured, or all were killed."""
        mountings = self.of(key)
        return mountings[-1] if mountings and mountings[-1].ended_by is None else None

    def edit(self, record: EditRecord) -> list[str]:
        """Edit marks where they were last measured; return the films that have such marks."""
        keys = list(self._mountings) if record.owner == "*" else [record_key(record.owner)]
        return [key for key in keys if self.in_force(key) is not None and self._edit_film(self.of(key), record)]

    def _edit_film(self, mountings: list[Mounting[Orientation]], record: EditRecord) -> bool:
        if record.action == "KILL" and record.name == "*":
            mountings[-1] = mountings[-1].edited(record, mountings[-1].orientation.marks.names)
            return True
        found = False
        measured_later: set[str] = set()
        for number in reversed(range(len(mountings))):
            if mountings[number].ended_by is not None:
                break  # marks of before are no longer listed
            marks = mountings[number].orientation.marks
            chosen = {name for name in marks.names if record.name in ("*", name)} - measured_later
            if chosen:
                mountings[number] = mountings[number].edited(record, chosen)
                found = True
            measured_later.update(marks.names)
        return found


def _edited_marks(marks: MeasuredMarks, record: EditRecord, names: Collection[str]) -> MeasuredMarks:
    chosen = np.array([name in names for name in marks.names], dtype=bool)
    if record.action == "KILL":
        return chosen_marks(marks, np.flatnonzero(~chosen))
    return replace(marks, disregarded=np.where(chosen, record.action == "DISREGARD", marks.disregarded))


def chosen_marks(marks: MeasuredMarks, rows: Iterable[int]) -> MeasuredMarks:
    """Return some of the marks."""
    kept = np.array(list(rows), dtype=np.int64)
    names = tuple(marks.names[row] for row in kept)
    return MeasuredMarks(names, marks.measured[kept], marks.disregarded[kept], marks.given[kept])


def joined_marks(first: MeasuredMarks, second: MeasuredMarks) -> MeasuredMarks:
    """Return the marks of both."""
    return MeasuredMarks(
        first.names + second.names,
        np.vstack([first.measured, second.measured]),
        np.append(first.disregarded, second.disregarded),
        np.vstack([first.given, second.given]),
    )
