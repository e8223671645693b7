"""Observed angles of photos that contradict the block: exchanged, of opposite sign, of another zero, unit or kind."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_between, rotation_from_angles, rotation_from_navigation
from orip.mistakes.hypothesis import Misfit, fit_of_adjustment, is_good
from orip.mistakes.mistake import STATIONS_OFF, declare
from orip.mistakes.other_units import ANGLE_UNITS
from orip.records.block import Block
from orip.records.control import NOT_GIVEN, Station
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN
from orip.wording import joined

CODE = declare(
    "station-angles", "the angles of the stations are not OMEGA, PHI and KAPPA in degrees, as the photos have them",
    STATIONS_OFF,
)  # fmt: skip

_KINDS = PHOTO_PARAMETERS[3:]

_FEWEST = 5
"""Least number of photos with observed angles."""

_OFF = 5.0
"""Median of what angles are off by, in their a-priori errors, from which they are not what they should be."""

_REMAINS = 0.2
"""Part of it that remains at most where they are read as they were meant: mounts are turned by a degree or two."""

_EQUALLY = 1.5
"""Ratio up to which two readings fit equally: then it is the first of them."""

_LEAST = float(np.radians(0.5))
"""Radians that they are off by at least."""


_BEST, _ERRORS_ALIKE = float(np.radians(0.003)), 4.0
"""Radians: errors of angles that no inertial unit has; and the ratio within which they are those that angles show."""


class _Angles(Struct, frozen=True):
    """Angles (n, 3) as observed, radians, their mean errors (n,), rows of their photos, and the file."""

    photo: IntArray
    given: FloatArray
    error: FloatArray
    file: str


def misread_angles(misfit: Misfit) -> list[ProjectWarning]:
    """Return what all observed angles of a file were taken for, if the photos are turned otherwise without them."""
    solved, readjuster = misfit.solved, misfit.readjuster
    block = readjuster.block
    angles = _observed(block)
    if angles is None or not readjuster.is_worthwhile or _fits(angles, solved, block):
        return []
    without = readjuster.adjust(_without_angles(block))
    if without is None or not is_good(fit_of_adjustment(without)):
        return []
    as_given = _off(angles, angles.given, without, block)
    if found := _errors_in_radians(angles, as_given):
        return found
    if as_given < max(_LEAST, _OFF * float(np.median(angles.error))):
        return []
    read = [(_off_rotations(angles, rotations, without, block), text) for text, rotations in _readings(angles)]
    least = min(off for off, _ in read)
    if least > _REMAINS * as_given:
        return []
    text = next(text for off, text in read if off <= _EQUALLY * least)
    return [ProjectWarning(CODE, "exposure stations", f"their OMEGA, PHI and KAPPA in the {angles.file} file {text}")]


def _errors_in_radians(angles: _Angles, off: float) -> list[ProjectWarning]:
    """Return that the errors of angles are in radians: no instrument is so good, and in degrees they fit."""
    usual = float(np.median(angles.error))
    meant = np.degrees(usual)
    if not (0.0 < usual < _BEST and meant / _ERRORS_ALIKE < off < meant * _ERRORS_ALIKE):
        return []
    given = np.degrees(usual)
    text = (
        f"their OMEGA, PHI and KAPPA in the {angles.file} file are right, but not their a-priori errors: these, "
        f"usually {given:.2g} degrees, seem to be in radians; write degrees: multiply them by {DEGREES_PER_RADIAN:.6g}"
    )
    return [ProjectWarning(CODE, "exposure stations", text)]


def _observed(block: Block) -> _Angles | None:
    """Return the angles of the .STA file; without any, those of the .ELE file."""
    rows = {record_key(photo.name): row for row, photo in enumerate(block.photos)}
    places = {
        rows[record_key(station.photo)]: (station.angles, float(np.mean(station.angle_error)))
        for station in block.stations
        if station.has_angles and min(station.angle_error) > 0.0 and record_key(station.photo) in rows
    }
    file = ".STA" if places else ".ELE"
    places = places or _of_elements(block, rows)
    if len(places) < _FEWEST:
        return None
    photo = sorted(places)
    given, error = zip(*(places[row] for row in photo), strict=True)
    return _Angles(np.array(photo, dtype=np.int64), np.array(given), np.array(error), file)


def _of_elements(block: Block, rows: dict[str, int]) -> dict[int, tuple[tuple[float, float, float], float]]:
    values: dict[int, dict[str, tuple[float, float]]] = {}
    for element in block.elements:
        if element.group == "PHOTO" and element.error > 0.0 and record_key(element.name) in rows:
            angle, error = np.radians([element.value, element.error]).tolist()  # elements are in degrees
            values.setdefault(rows[record_key(element.name)], {})[element.kind] = (angle, error)
    return {
        row: ((of["OMEGA"][0], of["PHI"][0], of["KAPPA"][0]), float(np.mean([of[kind][1] for kind in _KINDS])))
        for row, of in values.items()
        if set(_KINDS) <= set(of)
    }


def _fits(angles: _Angles, solved: SolvedBlock, block: Block) -> bool:
    return _off(angles, angles.given, solved, block) < _OFF * float(np.median(angles.error))


def _off(angles: _Angles, given: FloatArray, solved: SolvedBlock, block: Block) -> float:
    return _off_rotations(angles, rotation_from_angles(given), solved, block)


def _off_rotations(angles: _Angles, rotations: FloatArray, solved: SolvedBlock, block: Block) -> float:
    """Return the median angle between rotations in the project and those of the photos, radians."""
    place = {record_key(photo.name): row for row, photo in enumerate(solved.block.photos)}
    rows = [place[record_key(block.photos[row].name)] for row in angles.photo.tolist()]
    axes = np.swapaxes(block.ground.axes_at(block.ground.to_project(solved.state.centres[rows])), 1, 2)
    in_frame = axes @ rotations
    return float(np.median(angles_between(in_frame, solved.state.rotations[rows])))


_LINE = "write 'ANGLES ROLL PITCH HEADING' as a line before the first station"


def _readings(angles: _Angles) -> Iterator[tuple[str, FloatArray]]:
    """Yield what the angles may have been meant as, with the rotations (n, 3, 3) that they are then."""
    given = angles.given
    yield "fit when OMEGA and PHI are exchanged; exchange the two", rotation_from_angles(given[:, [1, 0, 2]])
    for places in ((2,), (0,), (1,), (0, 1), (0, 2), (1, 2), (0, 1, 2)):
        names = joined([_KINDS[place] for place in places])
        signs = np.where(np.isin(np.arange(3), places), -1.0, 1.0)
        text = f"fit with the opposite sign of {names}; reverse the sign of {names}"
        yield text, rotation_from_angles(given * signs)
    for turn in (180, 90, -90):
        text = f"fit when KAPPA is turned by {turn}° (it is 0 where the right side of the picture points along X); add"
        yield f"{text} {turn} to KAPPA", rotation_from_angles(given + np.radians([0.0, 0.0, turn]))
    if angles.file == ".STA":
        yield f"fit as roll, pitch and heading of the aircraft; {_LINE}", rotation_from_navigation(given)
        text = f"fit as pitch, roll and heading of the aircraft; exchange pitch and roll, and {_LINE}"
        yield text, rotation_from_navigation(given[:, [1, 0, 2]])
        for turn in (0, 90, -90, 180):
            text = "fit as roll, pitch and heading of a gimbal, whose pitch is -90 where the camera looks down: "
            text += f"add 90 to the pitch{f' and {turn} to the heading' if turn else ''}, and {_LINE}"
            for order, how in (([0, 1, 2], ""), ([1, 0, 2], ", in the order roll, pitch, heading")):
                yield text + how, rotation_from_navigation(given[:, order] + np.radians([0.0, 90.0, turn]))
    for factor, unit in ANGLE_UNITS.items():
        text = f"fit when they are in {unit}, but angles have to be in degrees; multiply them by {factor:.6g}"
        yield text, rotation_from_angles(given * factor)
    text = "fit as those of the transposed rotation, from ground to photo axes; convert them"
    yield text, np.swapaxes(rotation_from_angles(given), 1, 2)


def _without_angles(block: Block) -> Block:
    """Return a block without observed angles, and without the orientations that they give."""
    stations = tuple(_without_angle(station) for station in block.stations)
    elements = tuple(element for element in block.elements if not (element.group == "PHOTO" and element.kind in _KINDS))
    oriented = {record_key(station.photo) for station in block.stations if station.has_angles}
    oriented |= {record_key(element.name) for element in block.elements if element not in elements}
    rows = [record_key(photo.name) in oriented and not photo.constant for photo in block.photos]
    orientation = np.where(np.array(rows)[:, None], np.nan, block.photo_orientation)
    return replace(block, stations=stations, elements=elements, photo_orientation=orientation)


def _without_angle(station: Station) -> Station:
    return replace(station, angles=NOT_GIVEN, angle_error=NOT_GIVEN)
