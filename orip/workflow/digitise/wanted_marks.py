"""Which marks of a template or photo are visited: all, those digitised before, or some that are named."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from orip.errors import InputError, UsageError
from orip.multimodel.state import Position
from orip.records.names import near_names
from orip.records.observations.measurement import MeasuredMarks
from orip.records.project.camera import Mark


class MarkChoice(NamedTuple):
    """A mark that is meant; one that the record does not have comes with its given coordinates, mm."""

    name: str
    xy: Position | None = None


class WantedMarks(NamedTuple):
    """Which marks are visited: all, those digitised before, or chosen ones."""

    again: bool
    chosen: Sequence[MarkChoice]

    @property
    def keeps(self) -> bool:
        """Return whether marks that are not visited stay."""
        return self.again or bool(self.chosen)


def marks_to_visit(
    title: str, record: Iterable[Mark], before: MeasuredMarks, given: np.ndarray, wanted: WantedMarks
) -> tuple[tuple[Mark, ...], tuple[str, ...]]:
    """Return all marks there may be, and the names of those to visit."""
    of_record = {mark.name: mark for mark in record}
    measured = {name: Mark(name, x, y) for name, (x, y) in zip(before.names, given.tolist(), strict=True)}
    if wanted.chosen:
        known = {**of_record, **measured}
        found = [_chosen_mark(title, known, choice) for choice in wanted.chosen]
        every = {**measured, **{mark.name: mark for mark in found}}
        return tuple(every.values()), tuple(dict.fromkeys(mark.name for mark in found))
    if not wanted.again:
        return tuple(of_record.values()), tuple(of_record)
    if not before.names:
        message = f"{title} has no marks to digitise again; leave --again out"
        raise InputError.single(message)
    return tuple(measured.values()), tuple(measured)


def _chosen_mark(title: str, known: Mapping[str, Mark], choice: MarkChoice) -> Mark:
    mark = known.get(choice.name)
    if mark is None:
        if choice.xy is None:
            near = near_names(choice.name, known)
            message = f"{title} has no mark {choice.name}; {near}; a new one has its coordinates: {choice.name},X,Y"
            raise UsageError(message)
        return Mark(choice.name, *choice.xy)
    if choice.xy not in (None, (mark.x, mark.y)):
        message = f"mark {mark.name} of {title} has the coordinates {mark.x:g}, {mark.y:g}; take another name"
        raise UsageError(message)
    return mark
