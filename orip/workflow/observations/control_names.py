"""The control texts edited by commands, and the names in them that the project does not know."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from orip.errors import ProjectWarning
from orip.files.control.editing import FORMS, ControlKind, ControlLines
from orip.files.text.shown import shown_token
from orip.records.names import record_key
from orip.workflow.project.state import ProjectState

_POINT_FIELDS: dict[ControlKind, tuple[str, ...]] = {
    "points": ("name",),
    "preliminary": ("name",),
    "distances": ("from", "to"),
    "directions": ("station", "target"),
    "figures": ("point",),
}


class _Known(Struct, frozen=True):
    """The names of the project; record names as keys."""

    measured: frozenset[str]
    given: frozenset[str]
    cameras: frozenset[str]
    photos: frozenset[str]
    sets: frozenset[str]


def unknown_name_warnings(
    state: ProjectState, kind: ControlKind, shown: str, lines: ControlLines, numbers: Iterable[int]
) -> tuple[ProjectWarning, ...]:
    """Warn of names in some lines that are neither measured nor otherwise known; nothing measured yet: no warnings."""
    wanted = set(numbers)
    if not wanted:
        return ()
    known, form = _known(state), FORMS[kind]
    return tuple(
        ProjectWarning("unused-name", f"{shown}:{line.number}", text)
        for line in form.records(lines)
        if line.number in wanted
        for text in _unknown(kind, dict(zip(form.keys, form.fields_of(line), strict=True)), known)
    )


def _known(state: ProjectState) -> _Known:
    control = state.texts.control.value
    return _Known(
        frozenset(point for found in state.measured.observations.values() for point in found.points),
        frozenset(point.name for point in control.points),
        frozenset(state.records.cameras),
        frozenset(state.records.photos),
        frozenset(direction.set for direction in control.directions),
    )


def _unknown(kind: ControlKind, fields: dict[str, str | None], known: _Known) -> Iterator[str]:
    if kind == "elements":
        yield from _unknown_element(fields["name"] or "", (fields["group"] or "").upper(), known)
        return
    if kind == "stations":
        yield from _unknown_element(fields["photo"] or "", "PHOTO", known)
        return
    if kind == "differences":
        yield from _unknown_element(fields["first"] or "", "PHOTO", known)
        yield from _unknown_element(fields["second"] or "", "PHOTO", known)
        return
    if not known.measured:
        return
    given = known.given if kind in {"distances", "directions", "figures"} else frozenset()
    for key in _POINT_FIELDS[kind]:
        name = fields[key] or ""
        if name not in known.measured and name not in given:
            yield f"point '{shown_token(name)}' is not measured in any photo"


def _unknown_element(name: str, group: str, known: _Known) -> Iterator[str]:
    shown = shown_token(name)
    if group == "CAMERA" and known.cameras and record_key(name) not in known.cameras:
        yield f"there is no camera '{shown}'"
    if group == "PHOTO" and known.photos and record_key(name) not in known.photos:
        yield f"there is no photo '{shown}'"
    if group == "POINT" and known.measured and name not in known.measured | known.given:
        yield f"point '{shown}' is not measured in any photo"
    if group == "THEODOLITE" and name not in known.sets:
        yield f"there is no set '{shown}' of directions"
