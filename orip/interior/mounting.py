"""Mountings: films as they lay on the stage, marks that were measured on them there, and the fiducial system."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Generic, Literal, TypeVar

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import OrientationError
from orip.geometry.plane import PlaneTransformation
from orip.interior.definitions import Definitions, unknown_record
from orip.records.camera import Camera, Mark
from orip.records.measurement import (
    EditRecord,
    FiducialsRecord,
    MeasuredMarks,
    PhotoOrientation,
    TemplateOrientation,
    TextPlace,
    TicksRecord,
)
from orip.records.names import record_key
from orip.records.photo import Temtick
from orip.structs import replace

# A later edit may still take a mark away from a mounting, and with it change where everything measured in that mounting
# is. So a replay keeps plate coordinates and the number of their mounting until the log has ended; only then are they
# taken to the coordinates that are stored.

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


_ONE_PLACE = 1e-6
"""Marks on opposite sides are apart by the size of the frame, not by a millionth of it."""


def frame_corners(camera: Camera) -> tuple[FloatArray, FloatArray] | None:
    """Return the lower left and the upper right corner, (2,) each in mm of the fiducial system, of a camera's frame.

    A frame or sensor is centred at the fiducial centre; where a camera has neither, its fiducial marks (reseau crosses,
    photo corners) tell how far it reaches. None where it has no marks either.
    """
    if camera.frame is not None:
        half = np.array(camera.frame) / 2.0
        return -half, half
    if camera.sensor is not None:
        half = np.array([camera.sensor.width, camera.sensor.height]) / 2.0
        return -half, half
    marks = np.array([(mark.x, mark.y) for mark in camera.fiducials])
    if len(marks) < 2 or np.ptp(marks, axis=0).min() <= 0.0:
        return None
    return marks.min(axis=0), marks.max(axis=0)


def fiducials_from_plate(marks: MeasuredMarks, arrangement: Literal["corners", "midsides"]) -> tuple[Mark, ...]:
    """Return fiducial marks with the origin at the mean of four of them and the x axis nearest to the plate's.

    Parameters
    ----------
    marks : MeasuredMarks
        Four marks or more that are not disregarded, plate mm. Of more than four (eight fiducial marks, reseau crosses)
        the outermost in the corners, or on the axes, make the system; the others are transformed with them.
    arrangement : {"corners", "midsides"}
        Midsides: the x axis goes through the two marks nearest to the plate's x direction. Corners: through the middles
        of the left and the right side.

    Raises
    ------
    ValueError
        Unless there are at least four marks, four of which lie around their mean.

    Notes
    -----
    The rule of ORIPROGRAM (Dueholm 1989, menu 1.4.1.1); for corners the middle of the sides is this program's reading.
    """
    used = ~marks.disregarded
    plate = marks.measured[used]
    if len(plate) < 4:
        message = f"{len(plate)} marks; at least four are needed, one in each corner or in the middle of each side"
        raise ValueError(message)
    outer = plate if len(plate) == 4 else plate[_outermost(plate, arrangement)]
    centred = plate - outer.mean(axis=0)
    around = outer - outer.mean(axis=0)
    direction = _x_axis(around if arrangement == "midsides" else _middles_of_sides(around))
    cosine, sine = direction / np.hypot(*direction)
    turn = PlaneTransformation(np.array([[cosine, sine], [-sine, cosine]]), np.zeros(2))
    names = [name for name, use in zip(marks.names, used, strict=True) if use]
    return tuple(Mark(name, float(x), float(y)) for name, (x, y) in zip(names, turn.apply(centred), strict=True))


def _outermost(plate: FloatArray, arrangement: Literal["corners", "midsides"]) -> list[int]:
    """Return which of many marks lie farthest out in the four corners, or along the four half axes.

    Holds for films turned by less than 45 degrees (corners), or 20 degrees where marks in the corners could be taken
    for those on the axes.
    """
    x, y = (plate - (plate.min(axis=0) + plate.max(axis=0)) / 2.0).T
    if arrangement == "corners":
        reach = (x + y, y - x, -x - y, x - y)
    else:
        reach = (x - np.abs(y), y - np.abs(x), -x - np.abs(y), -y - np.abs(x))
    found = [int(np.argmax(part)) for part in reach]
    if len(set(found)) < 4:
        message = f"none of the marks lie in the four {arrangement}; digitise those too"
        raise ValueError(message)
    return found


def _around(centred: FloatArray) -> FloatArray:
    """Return the four marks in their order around the mean."""
    return centred[np.argsort(np.arctan2(centred[:, 1], centred[:, 0]), kind="stable")]


def _middles_of_sides(centred: FloatArray) -> FloatArray:
    corners = _around(centred)
    return (corners + np.roll(corners, -1, axis=0)) / 2.0


def _x_axis(midsides: FloatArray) -> FloatArray:
    """Return the direction of the pair of opposite marks nearest to the plate's x direction, pointing right."""
    around = _around(midsides)
    pairs = around[2:] - around[:2]
    lengths = np.hypot(pairs[:, 0], pairs[:, 1])
    if lengths.min() < _ONE_PLACE * np.abs(midsides).max(initial=0.0) or lengths.min() == 0.0:
        message = "the marks do not lie around their mean; digitise one in each corner, or in the middle of each side"
        raise ValueError(message)
    nearest: FloatArray = pairs[np.argmax(np.abs(pairs[:, 0]) / lengths)]
    return nearest if nearest[0] > 0.0 else -nearest


def camera_with_digitised_fiducials(record: FiducialsRecord, definitions: Definitions) -> Camera:
    """Return the camera of a ``FIDUCIALS`` record with its fiducial marks.

    Raises
    ------
    OrientationError
        If the camera is not known or is a digital frame, or the marks do not make a fiducial system.
    """
    camera = definitions.cameras.get(record_key(record.camera))
    if camera is None:
        raise OrientationError(
            unknown_record("camera", record.camera, (camera.name for camera in definitions.cameras.values()))
        )
    if camera.sensor is not None:
        message = (
            f"camera {camera.name} has a sensor, and a digital frame has no fiducial marks; take this FIDUCIALS record "
            "out, or the sensor out of the camera"
        )
        raise OrientationError(message)
    try:
        fiducials = fiducials_from_plate(record.marks, record.arrangement)
    except ValueError as fault:
        message = f"fiducials of camera {camera.name}: {fault}"
        raise OrientationError(message) from None
    return replace(camera, fiducials=fiducials)


def temtick_with_digitised_ticks(record: TicksRecord, definitions: Definitions) -> Temtick:
    """Return the temtick of a ``TICKS`` record with its tick marks, taken as they are.

    Raises
    ------
    OrientationError
        If the temtick is not known.
    """
    temtick = definitions.temticks.get(record_key(record.temtick))
    if temtick is None:
        raise OrientationError(
            unknown_record("temtick", record.temtick, (temtick.name for temtick in definitions.temticks.values()))
        )
    measured = zip(record.marks.names, record.marks.measured.tolist(), strict=True)
    return replace(temtick, ticks=tuple(Mark(name, x, y) for name, (x, y) in measured))
