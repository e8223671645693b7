"""Blocks of four kinds, clean or with an error common to one group, and what the first sentence of the result says.

Aerial with exposure stations in strips, aerial with control alone, close range with scale bars, several strips with
observed elements. The camera is held in all of them. An error planted is 4 to 8 times the standard deviation with which
all other observations determine it: it can be found, and hardly more.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from monte_carlo.simulated_blocks import random_numbers, solved
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import CAMERA_PARAMETERS, Camera
from orip.records.control import ControlDistance, ControlElement, ControlPoint, Station
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo
from orip.records.results.solution import Solution
from orip.solving.solve import solve

Kind = Literal["stations", "control", "close range", "elements"]
KINDS: tuple[Kind, ...] = ("stations", "control", "close range", "elements")

_PHOTO_ERROR = 0.005
_SMALLEST, _LARGEST = 4.0, 8.0
_CAMERAS = ("C", "DX", "A3")


class Error(NamedTuple):
    """An error of a group: "stations", "control", "camera", "distance" or "elements"; its component, strip or bar."""

    group: str
    component: str = ""
    of: str = ""


PLANTED: dict[Kind, tuple[Error, ...]] = {
    "stations": (
        *(Error("stations", axis, of) for axis in "XYZ" for of in ("", "1")),
        Error("control", "Z"), Error("control", "XYZ"), Error("camera", "C"),
    ),
    "control": (Error("camera", "C"), Error("camera", "A3")),
    "close range": (
        Error("distance", "XYZ", "BAR1"), Error("camera", "C"), Error("camera", "DX"), Error("camera", "A3"),
    ),
    "elements": (
        *(Error("elements", axis) for axis in ("X0", "Y0", "Z0")), Error("control", "Z"), Error("control", "XYZ"),
        Error("camera", "C"),
    ),
}  # fmt: skip
"""What can be told at all: where nothing but control is on the ground an error of all of it is absorbed."""


class Outcome(Struct, frozen=True):
    """What is said of a block: its kind, what was planted, the sentence, and whether a group is doubted."""

    kind: Kind
    planted: Error | None
    verdict: str
    doubted: bool
    named: bool
    alone: bool

    @property
    def is_silent(self) -> bool:
        return "all observations fit" in self.verdict or "what is weak" in self.verdict


class _Truth(NamedTuple):
    centres: np.ndarray
    angles: np.ndarray
    points: np.ndarray
    strips: tuple[str, ...]
    camera: np.ndarray
    half: float
    ground_error: float


def _aerial(random: np.random.Generator) -> _Truth:
    east, north = np.meshgrid(400.0 * np.arange(5.0), 800.0 * np.arange(3.0))
    centres = np.stack([east.ravel(), north.ravel(), np.full(15, 1000.0)], axis=1)
    cross = np.stack([np.full(3, 800.0), 800.0 * np.arange(3.0), np.full(3, 1060.0)], axis=1)
    centres = np.vstack([centres, cross]) + random.normal(size=(18, 3)) * [15.0, 15.0, 20.0]
    angles = np.radians(random.normal(size=(18, 3)) * [1.5, 1.5, 3.0])
    angles[5:10, 2] += np.pi
    angles[15:, 2] += np.pi / 2.0
    points = np.column_stack([random.uniform(-300.0, 1900.0, 110), random.uniform(-300.0, 1900.0, 110), np.zeros(110)])
    points[:, 2] = random.uniform(-60.0, 60.0, 110)
    strips = tuple(str(row // 5 + 1) for row in range(15)) + ("4",) * 3
    return _Truth(centres, angles, points, strips, np.array([150.0, *np.zeros(12)]), 115.0, 0.08)


def _close_range(random: np.random.Generator) -> _Truth:
    turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    centres = np.stack([4.0 * np.cos(turn), 4.0 * np.sin(turn), np.where(np.arange(12) % 2, 2.5, 4.0)], axis=1)
    centres += 0.2 * random.normal(size=centres.shape)
    points = random.uniform(-1.0, 1.0, (60, 3)) * [1.5, 1.5, 0.7]
    angles = np.empty((12, 3))
    for row, centre in enumerate(centres):
        back = centre / np.linalg.norm(centre)
        side = np.cross([0.0, 0.0, 1.0], back)
        side /= np.linalg.norm(side)
        axes = np.stack([side, np.cross(back, side), back], axis=1)
        roll = Rotation.from_euler("Z", 90.0 * (row % 4), degrees=True)
        angles[row] = (Rotation.from_matrix(axes) * roll).as_euler("XYZ")
    return _Truth(centres, angles, points, ("",) * 12, np.array([35.0, *np.zeros(12)]), 18.0, 0.002)


def _image(truth: _Truth, camera: np.ndarray) -> np.ndarray:
    rotation = Rotation.from_euler("XYZ", truth.angles).as_matrix()
    u = np.einsum("pkj,pik->pij", rotation, truth.points[None] - truth.centres[:, None])
    x = -camera[0] * u[:, :, :2] / u[:, :, 2:]
    a3 = camera[CAMERA_PARAMETERS.index("A3")]
    return camera[1:3] + x * (1.0 + a3 * np.sum(x**2, axis=2, keepdims=True))


@cache
def _truth(kind: Kind, geometry: int) -> _Truth:
    random = random_numbers(f"planted groups, {kind}", geometry)
    return _close_range(random) if kind == "close range" else _aerial(random)


def _block(kind: Kind, geometry: int, noise: np.random.Generator | None, planted: Error | None, size: float) -> Block:
    """Return a block without errors, or with normal ones; and with an error of one group of some size."""
    truth = _truth(kind, geometry)

    def drawn(sd: float, *shape: int) -> np.ndarray:
        return np.zeros(shape) if noise is None else sd * noise.normal(size=shape)

    def off(group: str, component: str, *of: str) -> float:
        if planted is None or planted.group != group or component not in planted.component:
            return 0.0
        if planted.of and planted.of not in of:
            return 0.0
        return size / math.sqrt(3.0) if planted == Error("control", "XYZ") else size

    count = len(truth.centres)
    ideal = _image(truth, truth.camera)
    shown = (np.abs(ideal) < truth.half).all(axis=2)
    seen = shown.sum(axis=0) >= 3
    points, (photo, point) = truth.points[seen], np.nonzero(shown[:, seen])
    xy = ideal[:, seen][photo, point]
    xy = xy + drawn(_PHOTO_ERROR, *xy.shape)
    given = truth.camera.copy()
    for parameter in _CAMERAS:
        given[CAMERA_PARAMETERS.index(parameter)] += off("camera", parameter)
    names = tuple(f"q{row}" for row in range(len(points)))
    photos = [f"P{row}" for row in range(count)]
    sd = truth.ground_error
    known = points + drawn(sd, *points.shape)
    number = {"control": 14, "close range": 4}.get(kind, 8)
    order = np.random.default_rng(geometry).permutation(len(points)).tolist()
    control = [
        ControlPoint(
            names[row], tuple(known[row, at] + off("control", axis) for at, axis in enumerate("XYZ")), (sd,) * 3
        )
        for row in order[:number]
    ]  # fmt: skip
    check = [ControlPoint(names[row], tuple(known[row].tolist()), (-sd,) * 3) for row in order[number : number + 6]]
    if kind == "close range":
        check = []
    observed = truth.centres + drawn(sd, *truth.centres.shape)
    planted_in = [[off("stations", axis, strip) for axis in "XYZ"] for strip in truth.strips]
    stations: tuple[Station, ...] = ()
    elements: tuple[ControlElement, ...] = ()
    if kind == "stations":
        stations = tuple(
            Station(
                name, tuple((observed[row] + planted_in[row]).tolist()), (sd,) * 3,
                time=8.0 * row + 1000.0 * int(truth.strips[row]), strip=truth.strips[row],
            )
            for row, name in enumerate(photos)
        )  # fmt: skip
    if kind == "elements":
        elements = tuple(
            ControlElement(name, "PHOTO", axis, observed[row, at] + off("elements", axis), sd)
            for row, name in enumerate(photos)
            for at, axis in enumerate(("X0", "Y0", "Z0"))
        )
    distances = []
    for bar in range(4 if kind == "close range" else 0):
        start, end = order[-1 - bar], order[-10 - bar]
        true = float(np.linalg.norm(points[end] - points[start]))
        distances.append(
            ControlDistance(
                f"BAR{bar + 1}", names[start], names[end], "XYZ",
                true + float(drawn(0.0005, 1)[0]) + off("distance", "XYZ", f"BAR{bar + 1}"), 0.0005,
            )
        )  # fmt: skip
    orientation = np.hstack([truth.centres, truth.angles])
    return Block(
        definition=BundleDefinition("MAIN", Precision(_PHOTO_ERROR)),
        cameras=(Camera("CAM", tuple(given.tolist()), frame=(2.0 * truth.half, 2.0 * truth.half)),),
        photos=tuple(
            Photo(name, "CAM", orientation=(*row[:3], *np.degrees(row[3:]).tolist()))
            for name, row in zip(photos, orientation.tolist(), strict=True)
        ),
        photo_camera=np.zeros(count, dtype=np.int64),
        photo_orientation=orientation,
        point_names=names,
        point_start=points.copy(),
        photo_points=IndexedPhotoPoints(photo, point, xy, np.full(xy.shape, _PHOTO_ERROR), np.ones(xy.shape, bool)),
        constant_points=np.zeros((len(points), 3), dtype=bool),
        control_points=(*control, *check),
        elements=elements,
        distances=tuple(distances),
        stations=stations,
    )


@cache
def detectable(kind: Kind, geometry: int, planted: Error) -> float:
    """Return the standard deviation with which all other observations determine an error common to a group.

    It is that of one more unknown, found by differences: with the error of a unit the weighted square sum of the
    residuals of a block without other errors grows by the reciprocal of the variance.
    """
    unit = 1e-7 if planted == Error("camera", "A3") else 0.01
    found = solved(_block(kind, geometry, None, planted, unit))
    grown = float(np.sum((found.weight_factors * found.equations.residual**2)[found.equations.active]))
    return unit / math.sqrt(grown)


def block_of(kind: Kind, run: int, planted: Error | None) -> Block:
    """Return the block of a run; ten geometries take turns."""
    random = random_numbers(f"planted groups {kind} {planted}", run)
    size = 0.0
    if planted is not None:
        size = random.uniform(_SMALLEST, _LARGEST) * detectable(kind, run % 10, planted) * random.choice([-1.0, 1.0])
    return _block(kind, run % 10, random, planted, size)


def outcome(case: tuple[Kind, Error | None, int]) -> Outcome:
    """Return what is said of the block of a run."""
    kind, planted, run = case
    found, _ = solve(block_of(kind, run, planted))
    named = planted is not None and (is_named(found.verdict, planted) or _is_explained(found, planted))
    return Outcome(
        kind, planted, found.verdict, any(group.doubted for group in found.groups), named, named and _alone(found)
    )


def is_named(verdict: str, planted: Error) -> bool:
    """Tell whether the sentence names a group, and the strip or the bar."""
    words = {
        "stations": "exposure stations", "elements": "exposure stations", "control": "control points",
        "camera": f"{planted.component} of camera CAM", "distance": "distance",
    }[planted.group]  # fmt: skip
    wanted = [words]
    if planted.group in ("stations", "elements", "control") and len(planted.component) < 3:
        wanted.append(planted.component)
    if planted.group == "stations" and planted.of:
        wanted.append(f"strip {planted.of}")
    if planted.group == "distance":
        wanted.append(planted.of)
    return all(word in verdict for word in wanted)


def _is_explained(found: Solution, planted: Error) -> bool:
    """Tell whether the sentence leads to a warning about the camera that says which value of the parameter fits."""
    if planted.component in ("DX", "DY") and "the principal point of a camera" in found.verdict:
        return True
    said = f"{planted.component} = "
    return (
        planted.group == "camera"
        and "see the warning about camera CAM" in found.verdict
        and any(where == "camera CAM" and text.startswith(said) for _, where, text in found.warnings)
    )


def _alone(found: Solution) -> bool:
    return not any(words in found.verdict for words in ("contradict each other", "cannot be told", ", or "))


def cases(planted_blocks: int, clean_blocks: int) -> list[tuple[Kind, Error | None, int]]:
    """Return so many blocks with a planted error and so many clean ones, of all kinds in turn."""
    every = [(kind, error) for kind in KINDS for error in PLANTED[kind]]
    planted = [(*every[run % len(every)], run // len(every)) for run in range(planted_blocks)]
    return [*planted, *((KINDS[run % len(KINDS)], None, run // len(KINDS)) for run in range(clean_blocks))]
