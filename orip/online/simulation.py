"""A simulated session: a block of vertical photos, measured photo by photo, in which a few measurements are wrong.

Its figures are those of published on-line blocks: c 152.7 mm, 23 cm, 60 % overlap along and across, a base of 920 m.
Points lie at the places where photos overlap three by three, and every photo that looks at a place shows its points.
Two blocks have published sizes: that of the Simplon, whose datum its first seven elements of orientation give, and that
of Echallens (Kersten, Holm and Gruen 1992, *On-line point positioning with single frame camera data*).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.assemble import BlockInput
from orip.geometry.plane import IDENTITY
from orip.geometry.rotation import rotation_from_angles
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior
from orip.online.block.measurements import Measurement
from orip.records.camera import Camera
from orip.records.control import Control, ControlElement, ControlPoint
from orip.records.definition import BundleDefinition, Precision
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo

_PRINCIPAL_DISTANCE = 152.7
_FRAME = 230.0
_BASE = 920.0
_HEIGHT = 1527.0
_PRECISION_MM = 0.005
_CONTROL_ERROR = 0.05
_BESIDE = 90.0
"""Metres between two points of a place."""

_PLACE_SPREAD = 15.0, 15.0, 30.0
_CENTRE_SPREAD = 20.0, 20.0, 15.0
_ANGLE_SPREAD = 0.4, 0.4, 0.8
"""Standard deviations of places and projection centres, metres, and of omega, phi and kappa, degrees."""

_CENTRE_ERROR, _ANGLE_ERROR = 0.05, 0.0005
"""A-priori errors of observed elements of orientation: metres and degrees."""

_FIRST_MODEL = 6
"""Points that the first two photos of the Simplon have been oriented by."""


class Blunder(Struct, frozen=True):
    """A wrong measurement: which one, and by how much, mm."""

    photo: str
    point: str
    error: tuple[float, float]


class SimulatedSession(Struct, frozen=True):
    """What is measured, in order, and which of it is wrong.

    Parameters
    ----------
    inputs : BlockInput
        Cameras, photos and control; nothing is measured.
    measurements : tuple of (photo, point, (x, y))
    """

    inputs: BlockInput
    measurements: tuple[Measurement, ...]
    blunders: tuple[Blunder, ...]


class _Design(NamedTuple):
    """A block before it is measured: photos with their orientations (n, 6), and points with their coordinates (3,)."""

    names: list[str]
    orientations: FloatArray
    points: dict[str, FloatArray]


def simulated_session(
    strips: int, photos_a_strip: int, blunders: int, seed: int = 1, points_a_place: int = 2
) -> SimulatedSession:
    """Return a session of strips of photos, some of whose measurements are wrong by 10 to 60 times their precision.

    Control points lie in the first photos, as one begins, and along the edges.
    """
    random = np.random.default_rng(seed)
    places = _places(strips, photos_a_strip)
    design = _design(strips, photos_a_strip, dict.fromkeys(places, points_a_place), random)
    measured = _measured(design, random)
    return _with_blunders(design, _control(design, strips, photos_a_strip, random), measured, blunders, random)


def simplon_like_session(blunders: int, seed: int = 1) -> SimulatedSession:
    """Return a session of 4 strips of 6 photos, 102 points and 468 rays, whose datum seven elements give.

    The first model, two photos with six points each, comes first: 31 observations of 30 unknowns.
    """
    random = np.random.default_rng(seed)
    places = _places(4, 6)
    # where three photos look at, and at two where four do: 14 points with 44 rays
    third = [(north, east) for north in (-1, 4) for east in range(1, 5)]
    third += [(north, east) for north in (1, 2) for east in (-1, 6)] + [(0, 0), (3, 5)]
    design = _design(4, 6, {place: 3 if place in third else 2 for place in places}, random)
    measured = _measured(design, random)
    first, second = ({point for photo, point, _ in measured if photo == name} for name in design.names[:2])
    # one at each place that both photos show
    model = sorted(point for point in first & second if point.endswith("1"))[:_FIRST_MODEL]
    measured.sort(key=lambda one: one[0] not in design.names[:2] or one[1] not in model)
    return _with_blunders(design, _first_seven_elements(design, random), measured, blunders, random)


def _places(strips: int, photos: int) -> list[tuple[int, int]]:
    """Return the places: below each photo, and one base beyond the photos on every side, where two or more look at."""
    return [
        (north, east)
        for north in range(-1, strips + 1)
        for east in range(-1, photos + 1)
        if north in range(strips) or east in range(photos)
    ]


def _point_name(place: tuple[int, int], number: int) -> str:
    north, east = place
    return str(1000 * (north + 2) + 10 * (east + 2) + number)


def _design(strips: int, photos: int, points_of: Mapping[tuple[int, int], int], random: np.random.Generator) -> _Design:
    names = [f"P{100 * (strip + 1) + row + 1}" for strip in range(strips) for row in range(photos)]
    east, north = np.meshgrid(_BASE * np.arange(photos), _BASE * np.arange(strips))
    orientations = np.zeros((len(names), 6))
    orientations[:, 0], orientations[:, 1], orientations[:, 2] = east.ravel(), north.ravel(), _HEIGHT
    orientations += random.normal(size=orientations.shape) * [*_CENTRE_SPREAD, *np.radians(_ANGLE_SPREAD)]
    points: dict[str, FloatArray] = {}
    for place, count in points_of.items():
        middle = np.array([_BASE * place[1], _BASE * place[0], 0.0]) + random.normal(size=3) * _PLACE_SPREAD
        for number in range(count):
            beside = _BESIDE * (number - 0.5 * (count - 1))
            points[_point_name(place, number + 1)] = middle + np.array([beside, 0.0, 0.0])
    return _Design(names, orientations, points)


def _measured(design: _Design, random: np.random.Generator) -> list[Measurement]:
    """Return the measurements without blunders, photo by photo."""
    rotations = rotation_from_angles(design.orientations[:, 3:])
    places, found = np.array(list(design.points.values())), list[Measurement]()
    for name, centre, rotation in zip(design.names, design.orientations[:, :3], rotations, strict=True):
        rays = (places - centre) @ rotation
        image = -_PRINCIPAL_DISTANCE * rays[:, :2] / rays[:, 2:] + _PRECISION_MM * random.normal(size=(len(rays), 2))
        shown = (np.abs(image) < _FRAME / 2.0).all(axis=1)
        found += [
            (name, point, (float(x), float(y)))
            for point, (x, y), is_shown in zip(design.points, image, shown, strict=True)
            if is_shown
        ]
    return found


def _with_blunders(
    design: _Design, control: Control, measured: list[Measurement], count: int, random: np.random.Generator
) -> SimulatedSession:
    planted = _planted(measured, count, random)
    errors = {(one.photo, one.point): one.error for one in planted}
    measurements = tuple(
        (photo, point, (x + errors.get((photo, point), (0.0, 0.0))[0], y + errors.get((photo, point), (0.0, 0.0))[1]))
        for photo, point, (x, y) in measured
    )
    return SimulatedSession(_inputs(design.names, control), measurements, planted)


def _planted(measured: list[Measurement], count: int, random: np.random.Generator) -> tuple[Blunder, ...]:
    """Return blunders in measurements that two or more earlier ones of their points check, one a photo."""
    rays: dict[str, int] = {}
    eligible: list[tuple[str, str]] = []
    for photo, point, _ in measured:
        rays[point] = rays.get(point, 0) + 1
        if rays[point] > 2:
            eligible.append((photo, point))
    chosen = random.choice(len(eligible), size=min(count, len(eligible)), replace=False)
    found = []
    for place in sorted(chosen.tolist()):
        size, angle = _PRECISION_MM * random.uniform(10.0, 60.0), random.uniform(0.0, 2.0 * np.pi)
        error = (float(size * np.cos(angle)), float(size * np.sin(angle)))
        photo, point = eligible[place]
        found.append(Blunder(photo, point, error))
    return tuple(found)


def _control(design: _Design, strips: int, photos: int, random: np.random.Generator) -> Control:
    """Return full control in the first photos and along the edges."""
    places = sorted({(-1, 0), (-1, 1), (1, -1), (1, 1), (strips, 0), (-1, photos - 1), (strips, photos - 1)})
    errors = (_CONTROL_ERROR,) * 3
    return Control(
        tuple(
            ControlPoint(name, tuple((design.points[name] + _CONTROL_ERROR * random.normal(size=3)).tolist()), errors)
            for name in (_point_name(place, 1) for place in places)
        )
    )


def _first_seven_elements(design: _Design, random: np.random.Generator) -> Control:
    """Return the elements of the first photo, and X0 of the second one, as observed."""
    observed = [(0, kind) for kind in PHOTO_PARAMETERS] + [(1, "X0")]
    elements = []
    for row, kind in observed:
        value = float(design.orientations[row, PHOTO_PARAMETERS.index(kind)])
        is_angle = PHOTO_PARAMETERS.index(kind) >= 3
        value, error = (float(np.degrees(value)), _ANGLE_ERROR) if is_angle else (value, _CENTRE_ERROR)
        elements.append(ControlElement(design.names[row], "PHOTO", kind, value + error * random.normal(), error))
    return Control((), tuple(elements))


def _inputs(names: list[str], control: Control) -> BlockInput:
    camera = Camera("RC10", (_PRINCIPAL_DISTANCE, *[0.0] * 12), frame=(_FRAME, _FRAME))
    photo_records = {record_key(name): Photo(name, camera.name) for name in names}
    definitions = Definitions({record_key(camera.name): camera}, {}, {}, photo_records, {})
    identities = dict.fromkeys((record_key(name) for name in names), IDENTITY)
    interior = Interior((), {}, identities, {}, (), ())
    definition = BundleDefinition("DEMO", Precision(_PRECISION_MM))
    return BlockInput(definition, definitions, Measured(), interior, control)
