"""Fiducial and tick marks measured in the image of a photo: what there is, what it gives, and its lines in the log."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from msgspec import Struct

from orip.errors import UsageError
from orip.files.log.writing import DECIMALS, measurement_line, photo_header, template_header
from orip.geometry.plane import IDENTITY, MARKS_NEEDED, PlaneTransformation
from orip.interior.in_force import drive_photo, drive_template, stored_to_log
from orip.records.camera import Mark
from orip.records.interior import MarkAdjustment
from orip.records.measurement import MeasuredMarks, PhotoOrientation, TemplateOrientation, TransformationKind
from orip.records.names import record_key
from orip.records.photo import Photo, Template
from orip.structs import replace
from orip.wording import counted, listed_names
from orip.workflow.observations.films import MountedFilms, Position, plate_of_log, position

MarkKind = Literal["MARK", "TICK"]
MarkEdit = Literal["KILL", "DISREGARD", "INCLUDE"]

_MICROMETRES = 1000.0
_WORDS = {"removed": "not measured any more", "excluded": "left out"}


class FilmMarks(Struct, frozen=True):
    """The fiducial marks of a photo, or the tick marks of its template.

    Parameters
    ----------
    what : {"MARK", "TICK"}
    owner : str
        Photo or template.
    header : str
        Of their block in the log.
    kind : {"A", "C", "W"}
    given : tuple of Mark
        Of the record.
    before : MeasuredMarks
        As in the log; also too few of them for an orientation.
    expected : PlaneTransformation or None
        Given coordinates to those of the log; None: nothing tells.
    adjustment : MarkAdjustment or None
        None: too few are measured.
    """

    what: MarkKind
    owner: str
    header: str
    kind: TransformationKind
    given: tuple[Mark, ...]
    before: MeasuredMarks
    expected: PlaneTransformation | None
    adjustment: MarkAdjustment | None

    @property
    def title(self) -> str:
        """Return whose marks they are."""
        return f"{'template' if self.what == 'TICK' else 'photo'} {self.owner}"

    def missing(self, without: str = "") -> int:
        """Return how many more marks the orientation needs, if one of them is taken away."""
        used = [name for name, off in zip(self.before.names, self.before.disregarded, strict=True) if not off]
        return max(0, MARKS_NEEDED[self.kind] - len([name for name in used if name != without]))

    def place(self, name: str) -> Position | None:
        """Return where a mark was measured, as in the log."""
        if name not in self.before.names:
            return None
        x, y = self.before.measured[self.before.names.index(name)].tolist()
        return x, y

    def lines(self, name: str, xy: Position) -> Iterator[str]:
        """Yield the lines of the log's block with one mark measured, or measured again."""
        before = self.before
        for known, at, off, own in zip(before.names, before.measured, before.disregarded, before.given, strict=True):
            given = None if np.isnan(own).any() else (float(own[0]), float(own[1]))
            if known == name:
                yield measurement_line(name, xy, given)
            else:
                yield measurement_line(known, (float(at[0]), float(at[1])), given, is_disregarded=bool(off))
        if name not in before.names:
            yield measurement_line(name, xy)

    def residual(self, name: str) -> tuple[float, float] | None:
        """Return VX, VY of a mark, mm."""
        if self.adjustment is None or name not in self.adjustment.marks.names:
            return None
        vx, vy = self.adjustment.residuals[self.adjustment.marks.names.index(name)].tolist()
        return vx, vy

    def told(self) -> str:
        """Return what the marks give, as a sentence."""
        if self.adjustment is None:
            more = counted(max(1, self.missing()), "more mark")
            return f"{self.title} has {counted(len(self.before.names), 'mark')}: measure {more} to orient it"
        s0, redundancy = self.adjustment.summary.s0 * _MICROMETRES, self.adjustment.summary.redundancy
        fit = f"s0 {s0:.1f} µm" if redundancy else "no redundancy, measure one more mark"
        mirrored = ", mirrored: are the marks named as they are on the film?" if self.adjustment.mirrored else ""
        return f"{self.title} is oriented by {counted(len(self.before.names), 'mark')}, {fit}{mirrored}"

    def state(self, name: str) -> Literal["included", "excluded", "waiting", "removed"]:
        """Return the state of a mark, as a photo point has one."""
        if name not in self.before.names:
            return "removed"
        if self.before.disregarded[self.before.names.index(name)]:
            return "excluded"
        return "waiting" if self.adjustment is None else "included"

    def answer(self, name: str) -> str:
        """Return the answer to a measurement or edit of a mark."""
        found = self.residual(name)
        fit = "" if found is None else f", residual {found[0] * _MICROMETRES:z.1f}, {found[1] * _MICROMETRES:z.1f} µm"
        return f"mark {name} is {_WORDS.get(self.state(name), 'measured')}{fit}; {self.told()}"

    def shown(self) -> dict[str, Any]:
        """Return the marks with their places as in the log and their residuals, mm."""
        names = [mark.name for mark in self.given]
        expected = {} if self.expected is None else {m.name: position(self.expected, (m.x, m.y)) for m in self.given}
        marks = [
            {"name": name, "measured": self.place(name), "expected": expected.get(name),
             "residual": self.residual(name), "state": self.state(name)}
            for name in dict.fromkeys([*names, *self.before.names])
        ]  # fmt: skip
        return {"what": self.what, "owner": self.owner, "text": self.told(), "marks": marks}


def marks_of(films: MountedFilms, photo: Photo) -> list[FilmMarks]:
    """Return the marks that can be measured in the image of a photo: ticks of its template, then its fiducial marks."""
    template, camera = films.definitions.template_of(photo), films.definitions.camera_of(photo)
    found = []
    if template is not None and template.scan is not None:
        found.append(_ticks(films, template))
    if camera.fiducials and camera.sensor is None and films.scan_of(photo) is not None:
        to_log = stored_to_log(photo, films.definitions, films.interior.to_template)
        if to_log is not None:
            found.append(_fiducials(films, photo, to_log))
    return found


def chosen(films: MountedFilms, photo: str, what: str, name: str) -> FilmMarks:
    """Return the marks of which one is meant.

    Raises
    ------
    UsageError
        If there is no such mark.
    """
    record = films.photo(photo)
    for marks in marks_of(films, record):
        if marks.what == what:
            known = dict.fromkeys([*(mark.name for mark in marks.given), *marks.before.names])
            if name not in known:
                message = f"{marks.title} has no mark {name[:60]}; it has {listed_names(known)}"
                raise UsageError(message)
            return marks
    if what == "MARK" and record.template is not None and films.definitions.camera_of(record).fiducials:
        message = f"template {record.template} of photo {record.name} is not oriented; measure its tick marks first"
    else:
        message = f"photo {record.name} has no {'tick' if what == 'TICK' else 'fiducial'} marks in its image"
    raise UsageError(message)


def require_dispensable(films: MountedFilms, marks: FilmMarks, name: str, edit: MarkEdit) -> None:
    """Raise a UsageError if a mark is not measured, or taking it away leaves without orientation what needs one."""
    if name not in marks.before.names:
        message = f"mark {name[:60]} of {marks.title} is not measured"
        raise UsageError(message)
    if edit == "INCLUDE" or not marks.missing(without=name):
        return
    if edit == "KILL" and not _is_measured_in(films, marks):
        return
    message = (
        f"{marks.title} would have too few marks for its orientation without {name}; measure more marks first, or this "
        "one again"
    )
    raise UsageError(message)


def _is_measured_in(films: MountedFilms, marks: FilmMarks) -> bool:
    """Tell whether anything has its place on the film by the orientation of these marks."""
    owner = record_key(marks.owner)
    photos = (
        {owner}
        if marks.what == "MARK"
        else {key for key, one in films.definitions.photos.items() if record_key(one.template or "") == owner}
    )
    if marks.what == "TICK" and photos & films.measured.photos.keys():
        return True
    return any(record_key(name) in photos for found in films.measured.observations.values() for name in found.photos)


def _kind(known: TemplateOrientation | PhotoOrientation | None, given: tuple[Mark, ...]) -> TransformationKind:
    if known is not None:
        return known.transformation
    return "A" if len(given) >= MARKS_NEEDED["A"] else "C"


def _ticks(films: MountedFilms, template: Template) -> FilmMarks:
    key, ticks = record_key(template.name), films.definitions.temtick_of(template).ticks
    known, stored = films.measured.templates.get(key), films.interior.to_template.get(key)
    kind, to_plate = _kind(known, ticks), plate_of_log(template.scan)
    stage, before = (known.stage if known else None) or template.stage, films.ticks_on_plate(template)
    driving = drive_template(TemplateOrientation(template.name, kind, stage, before), ticks, stored).transformation
    return FilmMarks(
        "TICK", template.name, template_header(template.name, kind, stage), kind, ticks, _in_log(before, to_plate),
        driving.after(to_plate).inverse() if stored or before.names else None,
        _adjustment(films, "templates", template.name),
    )  # fmt: skip


def _fiducials(films: MountedFilms, photo: Photo, stored_in_log: PlaneTransformation) -> FilmMarks:
    key, camera = record_key(photo.name), films.definitions.camera_of(photo)
    known, stored = films.measured.photos.get(key), films.interior.to_photo.get(key)
    kind, to_stored = _kind(known, camera.fiducials), stored_in_log.inverse()
    before = _in_log(films.fiducials_on_plate(photo), plate_of_log(films.scan_of(photo)))
    in_stored = replace(before, measured=to_stored.apply(before.measured))
    driving = drive_photo(PhotoOrientation(photo.name, kind, in_stored), camera, stored).transformation
    return FilmMarks(
        "MARK", photo.name, photo_header(photo.name, kind), kind, camera.fiducials, before,
        driving.after(to_stored).inverse() if stored or before.names else None,
        _adjustment(films, "photos", photo.name),
    )  # fmt: skip


def _in_log(marks: MeasuredMarks, to_plate: PlaneTransformation = IDENTITY) -> MeasuredMarks:
    return replace(marks, measured=to_plate.inverse().apply(marks.measured).round(DECIMALS))


def _adjustment(films: MountedFilms, group: str, name: str) -> MarkAdjustment | None:
    found = (one for one in films.interior.adjustments if (one.summary.group, one.summary.name) == (group, name))
    return next(found, None)
