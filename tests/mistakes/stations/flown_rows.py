"""Small flights of a drone whose camera exposes its rows one after the other, computed without orip's formulas."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera, Sensor
from orip.records.control import ControlPoint, Station
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo

C, WIDTH, HEIGHT, PIXEL, ABOVE = 8.8, 13.2, 8.8, 0.0024, 60.0
NOISE = 0.5 * PIXEL
STRIPS, PHOTOS = 3, 5


def flight(seed: int, readout: float, speed: float, unknown: tuple[str, ...] = ()) -> Block:
    """Return a block of three strips, flown there and back; the camera turns with them, and RTK has 2 cm.

    `readout` (seconds, upper row first) and `speed` (m/s) are those of the flight; the block knows nothing of them
    but the times of the exposures.
    """
    random = np.random.default_rng(seed)
    base, spacing = 0.3 * HEIGHT / C * ABOVE, 0.5 * WIDTH / C * ABOVE
    strip, place = np.divmod(np.arange(STRIPS * PHOTOS), PHOTOS)
    there = strip % 2 == 0
    along = np.where(there, place, PHOTOS - 1 - place) * base
    centres = np.column_stack([spacing * strip, along, np.full(len(strip), ABOVE)])
    velocity = np.zeros_like(centres)
    velocity[:, 1] = np.where(there, speed, -speed)
    angles = np.column_stack([random.normal(scale=2.0, size=(len(strip), 2)), np.where(there, 0.0, 180.0)])
    rotations = Rotation.from_euler("XYZ", angles, degrees=True)
    count = 160
    points = random.uniform([-20.0, -20.0, 0.0], [2 * spacing + 20.0, 4 * base + 20.0, 8.0], (count, 3))
    photo, point, xy = [], [], []
    for row in range(len(strip)):
        time = np.zeros(count)
        for _ in range(8):  # the row depends on the time, and the time on the row
            u = rotations[row].inv().apply(points - centres[row] - velocity[row] * time[:, None])
            image = -C * u[:, :2] / u[:, 2:]
            time = readout * (0.5 - (image[:, 1] + HEIGHT / 2.0) / HEIGHT)
        inside = np.flatnonzero((np.abs(image) < [WIDTH / 2.0, HEIGHT / 2.0]).all(axis=1))
        photo += [row] * len(inside)
        point += inside.tolist()
        xy.append(image[inside])
    rays = np.bincount(point, minlength=count)
    kept = np.flatnonzero(rays >= 2)
    use = np.isin(point, kept)
    observed = np.vstack(xy)[use] + random.normal(scale=NOISE, size=(use.sum(), 2))
    names = tuple(str(number + 1) for number in range(len(kept)))
    control = kept[:: max(1, len(kept) // 8)]
    given = points[control] + random.normal(scale=0.01, size=(len(control), 3))
    photos = tuple(f"P{row + 1}" for row in range(len(strip)))
    taken = centres + random.normal(scale=0.02, size=centres.shape)
    times = 100.0 * strip + place * base / speed
    orientation = np.hstack([taken, np.radians(angles)])
    return Block(
        definition=BundleDefinition("FLIGHT", Precision(NOISE)),
        cameras=(
            Camera(
                "CAM", (C, *(0.0,) * 12), sensor=Sensor(round(WIDTH / PIXEL), round(HEIGHT / PIXEL), WIDTH, HEIGHT),
                unknown=unknown,
            ),
        ),
        photos=tuple(Photo(name, "CAM") for name in photos),
        photo_camera=np.zeros(len(photos), dtype=np.int64),
        photo_orientation=orientation,
        point_names=names,
        point_start=points[kept],
        photo_points=IndexedPhotoPoints(
            np.array(photo)[use], np.searchsorted(kept, np.array(point)[use]), observed,
            np.full(observed.shape, NOISE), np.ones(observed.shape, dtype=bool),
        ),
        constant_points=np.zeros((len(kept), 3), dtype=bool),
        control_points=tuple(
            ControlPoint(names[place], tuple(xyz), (0.01,) * 3)
            for place, xyz in zip(np.searchsorted(kept, control).tolist(), given.tolist(), strict=True)
        ),
        stations=tuple(
            Station(name, tuple(xyz), (0.02,) * 3, time=float(time), strip=str(number))
            for name, xyz, time, number in zip(photos, taken.tolist(), times, strip.tolist(), strict=True)
        ),
    )  # fmt: skip
