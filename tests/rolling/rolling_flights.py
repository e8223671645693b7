"""Flights of rolling shutters, computed without orip's formulas: the camera follows a path, and each row has its time.

The path and the attitude are functions of time, neither of them of uniform motion; the time of a row is found by
iteration, since the row in which a point appears depends on when it is exposed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera, ReadoutDirection, Sensor
from orip.records.control import NOT_GIVEN, ControlPoint, Station, StationMotion
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo

C, WIDTH, HEIGHT, PIXEL, ABOVE = 8.8, 13.2, 8.8, 0.0024, 60.0
NOISE = 0.5 * PIXEL
STRIPS, PHOTOS, POINTS = 3, 6, 160
CONTROL_ERROR, STATION_ERROR = 0.01, 0.02


class Swing(NamedTuple):
    """How the attitude changes: amplitude (degrees) and period, in intervals between exposures."""

    amplitude: float
    intervals: float


ALONG = {"down": (0.0, -1.0), "up": (0.0, 1.0), "right": (1.0, 0.0), "left": (-1.0, 0.0)}
"""In which direction of the image, by its name, rows or columns follow each other."""

STEADY, SWINGING = Swing(1.5, 14.0), Swing(1.0, 2.3)
"""A swing that neighbours show, and one that they do not."""


class Flown(NamedTuple):
    """A block, whose points and photos start at the truth, its readout (seconds), and how far its images move (mm).

    `motion` is the root mean square of each photo, from the first row to the last one.
    """

    block: Block
    readout: float
    motion: np.ndarray


Path = Callable[[np.ndarray], tuple[np.ndarray, Rotation]]
"""From times (n,) to places (n, 3) and rotations."""


def flown(
    seed: int, readout: float, speed: float, *, rtk: bool = True, swing: Swing = STEADY, unknown: tuple[str, ...] = (),
    given: float = 0.0, known: tuple[float, float] | None = None, direction: ReadoutDirection = "down",
    **definition: float,
) -> Flown:  # fmt: skip
    """Return a flight of strips there and back, the camera turning with them.

    Without RTK the stations have times alone, and more control is measured. `given` is the readout of the block,
    `direction` that of the shutter and the block, `known` the standard deviations of velocities and angular rates
    (degrees a second) that stations say; None: none do.
    """
    random = np.random.default_rng(seed)
    base, spacing = 0.3 * HEIGHT / C * ABOVE, 0.5 * WIDTH / C * ABOVE
    points = random.uniform([-20.0, -20.0, 0.0], [2 * spacing + 20.0, 5 * base + 20.0, 8.0], (POINTS, 3))
    interval = base / speed
    times = interval * np.arange(PHOTOS) + random.uniform(-0.1, 0.1, (STRIPS, PHOTOS)) * interval
    photo, point, xy, centres, rotations, motion, moved = [], [], [], [], [], [], []
    of_motions = np.random.default_rng([seed, 1])
    for strip in range(STRIPS):
        path = _path(random, strip, spacing, (PHOTOS - 1) * base, speed, swing, interval)
        for row, time in enumerate(times[strip]):
            image = _exposed(path, time, readout, direction, points)
            inside = np.flatnonzero((np.abs(image) < [WIDTH / 2.0, HEIGHT / 2.0]).all(axis=1))
            photo += [strip * PHOTOS + row] * len(inside)
            point += inside.tolist()
            xy.append(image[inside])
            ends = [_seen(path, time + part * readout, points[inside]) for part in (-0.5, 0.5)]
            motion.append(np.sqrt(np.mean(np.sum((ends[1] - ends[0]) ** 2, axis=1))))
            place, rotation = path(np.array([time]))
            centres.append(place[0])
            rotations.append(rotation.as_euler("XYZ")[0])
            moved.append(None if known is None else _said(path, time, known, of_motions))
    kept = np.flatnonzero(np.bincount(point, minlength=POINTS) >= 3)
    use = np.isin(point, kept)
    observed = np.vstack(xy)[use] + random.normal(scale=NOISE, size=(use.sum(), 2))
    names = tuple(str(number + 1) for number in range(len(kept)))
    control = kept[:: max(1, len(kept) // (6 if rtk else 14))]
    measured = points[control] + random.normal(scale=CONTROL_ERROR, size=(len(control), 3))
    taken = np.array(centres) + random.normal(scale=STATION_ERROR, size=(len(centres), 3))
    photos = tuple(f"P{row + 1}" for row in range(len(centres)))
    sensor = Sensor(round(WIDTH / PIXEL), round(HEIGHT / PIXEL), WIDTH, HEIGHT)
    block = Block(
        definition=BundleDefinition("FLIGHT", Precision(NOISE), **definition),
        cameras=(Camera("CAM", (C, *(0.0,) * 11, given), sensor=sensor, unknown=unknown, readout_direction=direction),),
        photos=tuple(Photo(name, "CAM") for name in photos),
        photo_camera=np.zeros(len(photos), dtype=np.int64),
        photo_orientation=np.hstack([centres, rotations]),
        point_names=names,
        point_start=points[kept],
        photo_points=IndexedPhotoPoints(
            np.array(photo)[use], np.searchsorted(kept, np.array(point)[use]), observed,
            np.full(observed.shape, NOISE), np.ones(observed.shape, dtype=bool),
        ),
        constant_points=np.zeros((len(kept), 3), dtype=bool),
        control_points=tuple(
            ControlPoint(names[place], tuple(xyz), (CONTROL_ERROR,) * 3)
            for place, xyz in zip(np.searchsorted(kept, control).tolist(), measured.tolist(), strict=True)
        ),
        stations=tuple(
            Station(
                name, tuple(xyz) if rtk else NOT_GIVEN, (STATION_ERROR,) * 3 if rtk else NOT_GIVEN,
                time=100.0 * strip + float(times[strip, row]), strip=str(strip), motion=said,
            )
            for name, xyz, strip, row, said in zip(
                photos, taken.tolist(), np.repeat(range(STRIPS), PHOTOS), np.tile(range(PHOTOS), STRIPS), moved,
                strict=True,
            )
        ),
    )  # fmt: skip
    return Flown(block, readout, np.array(motion))


def moving(path: Path, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocity and the angular rate about the ground axes (degrees a second): differences over a moment."""
    moment = 1e-4
    places, rotations = path(np.array([time - moment, time + moment]))
    turn = (rotations[1] * rotations[0].inv()).as_rotvec(degrees=True)
    return (places[1] - places[0]) / (2.0 * moment), turn / (2.0 * moment)


def _said(path: Path, time: float, errors: tuple[float, float], random: np.random.Generator) -> StationMotion:
    velocity, rate = moving(path, time)
    velocity = velocity + random.normal(scale=errors[0], size=3)
    rate = np.radians(rate + random.normal(scale=errors[1], size=3))
    return StationMotion(
        tuple(velocity.tolist()), (errors[0],) * 3, tuple(rate.tolist()), (float(np.radians(errors[1])),) * 3
    )


def _path(
    random: np.random.Generator, strip: int, spacing: float, length: float, speed: float, swing: Swing, interval: float
) -> Path:
    """Return a path along a strip: a little slower and faster, up and down and sideways, turning about all axes."""
    back = strip % 2 == 1
    phases = random.uniform(0.0, 2.0 * np.pi, 6)
    of_path = 2.0 * np.pi / (15.0 * interval)
    of_swing = 2.0 * np.pi / (swing.intervals * interval)

    def path(times: np.ndarray) -> tuple[np.ndarray, Rotation]:
        wave = np.sin(of_path * times[:, None] + phases[:3]) - np.sin(phases[:3])
        along = speed * times + 0.1 * speed / of_path * wave[:, 1]
        places = np.column_stack(
            [spacing * strip + wave[:, 0], length - along if back else along, ABOVE + 0.5 * wave[:, 2]]
        )
        heading = np.array([0.0, 0.0, 180.0 if back else 0.0])
        angles = swing.amplitude * np.sin(of_swing * times[:, None] + phases[3:])
        return places, Rotation.from_euler("XYZ", angles + heading, degrees=True)

    return path


def _exposed(path: Path, time: float, readout: float, direction: ReadoutDirection, points: np.ndarray) -> np.ndarray:
    """Return the images (n, 2) of points, each at the time of its row or column."""
    after = np.zeros(len(points))
    for _ in range(12):
        image = _seen(path, time + after, points)
        after = readout * (image @ np.divide(ALONG[direction], (WIDTH, HEIGHT)))
    return image


def _seen(path: Path, times: np.ndarray | float, points: np.ndarray) -> np.ndarray:
    """Return the images (n, 2) of points at times."""
    places, rotations = path(np.broadcast_to(times, len(points)))
    u = rotations.inv().apply(points - places)
    return -C * u[:, :2] / u[:, 2:]
