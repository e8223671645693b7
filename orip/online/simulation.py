"""A simulated session: a block of vertical photos, measured photo by photo, in which a few measurements are wrong.

Its size and figures are those of published on-line blocks: c 152.7 mm, 23 cm, 60 % overlap along and across, a base of
920 m. Two points lie at each place where photos overlap three by three.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orip.bundle.assemble import BlockInput
from orip.geometry.plane import IDENTITY
from orip.geometry.rotation import rotation_from_angles
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior
from orip.online.measurements import Measurement
from orip.records.names import record_key
from orip.records.observations.control import Control, ControlPoint
from orip.records.observations.measurement import Measured
from orip.records.project.camera import Camera
from orip.records.project.definition import BundleDefinition, Precision
from orip.records.project.photo import Photo

_PRINCIPAL_DISTANCE = 152.7
_FRAME = 230.0
_BASE = 920.0
_HEIGHT = 1527.0
_PRECISION_MM = 0.005
_CONTROL_ERROR = 0.05
_BESIDE = 90.0
"""Metres between two points of a place."""


@dataclass(frozen=True, slots=True)
class Blunder:
    """A wrong measurement: which one, and by how much, mm."""

    photo: str
    point: str
    error: tuple[float, float]


@dataclass(frozen=True, slots=True)
class SimulatedSession:
    """What is measured, in order, and which of it is wrong.

    Parameters
    ----------
    inputs : BlockInput
        Cameras, photos and control; nothing is measured.
    measurements : tuple of (photo, point, (x, y))
    blunders : tuple of Blunder
    """

    inputs: BlockInput
    measurements: tuple[Measurement, ...]
    blunders: tuple[Blunder, ...]


def simulated_session(
    strips: int, photos_a_strip: int, blunders: int, seed: int = 1, points_a_place: int = 2
) -> SimulatedSession:
    """Return a session of strips of photos, some of whose measurements are wrong by 10 to 60 times their precision."""
    random = np.random.default_rng(seed)
    names, orientations = _photos(strips, photos_a_strip, random)
    points = _points(strips, photos_a_strip, points_a_place, random)
    measured = _measured(names, orientations, points, random)
    planted = _planted(measured, blunders, random)
    errors = {(one.photo, one.point): one.error for one in planted}
    measurements = tuple(
        (photo, point, (x + errors.get((photo, point), (0.0, 0.0))[0], y + errors.get((photo, point), (0.0, 0.0))[1]))
        for photo, point, (x, y) in measured
    )
    return SimulatedSession(_inputs(names, points, strips, photos_a_strip, random), measurements, planted)


def _photos(strips: int, photos: int, random: np.random.Generator) -> tuple[list[str], np.ndarray]:
    names = [f"P{100 * (strip + 1) + row + 1}" for strip in range(strips) for row in range(photos)]
    east, north = np.meshgrid(_BASE * np.arange(photos), _BASE * np.arange(strips))
    found = np.zeros((len(names), 6))
    found[:, 0], found[:, 1], found[:, 2] = east.ravel(), north.ravel(), _HEIGHT
    spread = [20.0, 20.0, 15.0, *np.radians([1.0, 1.0, 2.0])]
    return names, found + random.normal(size=found.shape) * spread


def _points(strips: int, photos: int, points: int, random: np.random.Generator) -> dict[str, np.ndarray]:
    """Return the points by name: some at each place, one base beyond the photos on every side as well."""
    found: dict[str, np.ndarray] = {}
    for north in range(-1, strips + 1):
        for east in range(-1, photos + 1):
            place = np.array([_BASE * east, _BASE * north, 0.0]) + random.normal(size=3) * [40.0, 40.0, 60.0]
            for number in range(1, points + 1):
                name = str(1000 * (north + 2) + 10 * (east + 2) + number)
                found[name] = place + np.array([_BESIDE * (number - 1), 0.0, 0.0])
    return found


def _measured(
    names: list[str], orientations: np.ndarray, points: dict[str, np.ndarray], random: np.random.Generator
) -> list[Measurement]:
    """Return the measurements without blunders, photo by photo."""
    rotations = rotation_from_angles(orientations[:, 3:])
    places, found = np.array(list(points.values())), list[Measurement]()
    for name, centre, rotation in zip(names, orientations[:, :3], rotations, strict=True):
        rays = (places - centre) @ rotation
        image = -_PRINCIPAL_DISTANCE * rays[:, :2] / rays[:, 2:] + _PRECISION_MM * random.normal(size=(len(rays), 2))
        shown = (np.abs(image) < _FRAME / 2.0).all(axis=1)
        found += [
            (name, point, (float(x), float(y)))
            for point, (x, y), is_shown in zip(points, image, shown, strict=True)
            if is_shown
        ]
    return found


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


def _inputs(
    names: list[str], points: dict[str, np.ndarray], strips: int, photos: int, random: np.random.Generator
) -> BlockInput:
    camera = Camera("RC10", (_PRINCIPAL_DISTANCE, *[0.0] * 11), frame=(_FRAME, _FRAME))
    photo_records = {record_key(name): Photo(name, camera.name) for name in names}
    definitions = Definitions({record_key(camera.name): camera}, {}, {}, photo_records, {})
    # as one begins: full control in the first photos, and along the edges
    places = {(1, 1), (1, 3), (3, 1), (3, 3), (strips + 2, 1), (1, photos + 2), (strips + 2, photos + 2)}
    errors = (_CONTROL_ERROR,) * 3
    known = [str(1000 * north + 10 * east + 1) for north, east in sorted(places)]
    control = tuple(
        ControlPoint(name, tuple((points[name] + _CONTROL_ERROR * random.normal(size=3)).tolist()), errors)
        for name in known
    )
    identities = dict.fromkeys((record_key(name) for name in names), IDENTITY)
    interior = Interior((), {}, identities, {}, (), ())
    definition = BundleDefinition("DEMO", Precision(_PRECISION_MM))
    return BlockInput(definition, definitions, Measured(), interior, Control(control))
