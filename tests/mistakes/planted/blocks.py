"""Sound blocks with known truth, in plain arrays, in which mistakes are planted.

Images are computed from the formulas of docs/conventions.md with scipy's rotations, without orip's geometry.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from msgspec import Struct, field
from scipy.spatial.transform import Rotation

import orip
from orip.structs import replace

NOISE_PARTS = 0.8
"""Noise over the a-priori error: people are a little cautious."""


class Planted(Struct):
    """What a user hands over; mistakes change it in place.

    Attributes
    ----------
    cameras : list of dict
        Arguments of `orip.Camera`.
    photo_camera : dict
        Name of the camera by photo.
    orientation : dict
        X0 to KAPPA (degrees) by photo, NaN where not given.
    images : dict
        Coordinates as written (mm, or pixels for a sensor) by photo and point.
    control : dict
        Coordinates (3,) and a-priori errors (3,) by point; negative errors: a check point.
    distances : dict
        Start, end, distance, a-priori error by name.
    settings : dict
        Other arguments of `orip.Block`.
    truth : dict
        True coordinates by point.
    adjusted : dict
        Projection centres by photo, of blocks that are measured and not made.
    """

    scene: str
    cameras: list[dict[str, Any]]
    photo_camera: dict[str, str]
    orientation: dict[str, np.ndarray]
    images: dict[tuple[str, str], np.ndarray]
    control: dict[str, tuple[np.ndarray, np.ndarray]]
    distances: dict[str, tuple[str, str, float, float]] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    truth: dict[str, np.ndarray] = field(default_factory=dict)
    adjusted: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def photos(self) -> list[str]:
        return list(self.photo_camera)

    @property
    def is_oriented(self) -> bool:
        return all(np.isfinite(values).all() for values in self.orientation.values())

    @property
    def has_sensor(self) -> bool:
        return "sensor" in self.cameras[0]

    @property
    def control_names(self) -> list[str]:
        return [name for name, (_, error) in self.control.items() if (error >= 0.0).all()]

    @property
    def check_names(self) -> list[str]:
        return [name for name, (_, error) in self.control.items() if (error < 0.0).all()]

    @property
    def tie_names(self) -> list[str]:
        return [name for name in self.truth if name not in self.control]

    def photos_of(self, point: str) -> list[str]:
        return [photo for photo, name in self.images if name == point]

    def points_of(self, photo: str) -> list[str]:
        return [name for shown, name in self.images if shown == photo]

    def block(self) -> orip.Block:
        """Return it as orip takes it.

        Raises
        ------
        orip.InputError
        """
        photos, points = zip(*self.images, strict=True)
        distances = None
        if self.distances:
            start, end, length, error = zip(*self.distances.values(), strict=True)
            distances = orip.Distances(list(self.distances), start, end, length, error)
        given = np.array(list(self.orientation.values()))
        return orip.Block(
            [orip.Camera(**camera) for camera in self.cameras],
            orip.Photos(self.photos, list(self.photo_camera.values()), given),
            orip.PhotoPoints(photos, points, np.array(list(self.images.values()))),
            orip.ControlPoints(
                list(self.control),
                np.array([xyz for xyz, _ in self.control.values()]),
                np.array([error for _, error in self.control.values()]),
            ),
            distances=distances,
            **self.settings,
        )


class _Layout(Struct, frozen=True):
    """Truth of a scene; `orientation` in ground units and degrees, `frame` in mm, `start` the errors of given values.

    `errors` is the a-priori error of control, ground units; `start` that of given centres and angles.
    """

    c: float
    frame: tuple[float, float]
    orientation: dict[str, np.ndarray]
    points: dict[str, np.ndarray]
    control: list[str]
    checks: list[str]
    errors: float
    start: tuple[float, float]
    precision: float
    sensor: tuple[int, int] | None = None
    distances: int = 0


def planted_block(scene: str, number: int) -> Planted:
    """Return a sound block; the same numbers give the same block.

    Parameters
    ----------
    scene : str
        One of `SCENES`; with the ending " given" its orientations are given as approximations.
    number : int
    """
    random = np.random.default_rng(zlib.crc32(f"{scene.removesuffix(' given')} {number}".encode()))
    layout = _LAYOUTS[scene.removesuffix(" given")](random)
    camera: dict[str, Any] = {"name": "CAM", "c": layout.c}
    if layout.sensor:
        size = dict(zip(("columns", "rows", "width", "height"), (*layout.sensor, *layout.frame), strict=True))
        camera["sensor"] = size
    else:
        camera["frame"] = list(layout.frame)
    images = _images(layout, random)
    seen = [name for name in layout.points if sum(point == name for _, point in images) > 1]
    images = {key: xy for key, xy in images.items() if key[1] in seen}
    given = {
        photo: values + random.uniform(-1.0, 1.0, 6) * np.repeat(layout.start, 3)
        if scene.endswith(" given")
        else np.full(6, np.nan)
        for photo, values in layout.orientation.items()
    }
    control = {
        name: (np.round(layout.points[name] + layout.errors * random.normal(size=3), 4), np.full(3, layout.errors))
        for name in layout.control
        if name in seen
    }
    for name in layout.checks:
        if name in seen:
            xyz = np.round(layout.points[name] + layout.errors * random.normal(size=3), 4)
            control[name] = xyz, np.full(3, -1.0)
    planted = Planted(
        scene,
        [camera],
        dict.fromkeys(layout.orientation, "CAM"),
        given,
        images,
        control,
        settings={"measurement_precision": layout.precision},
        truth={name: layout.points[name] for name in seen},
    )
    ends = planted.control_names
    for row in range(layout.distances):
        start, end = ends[row], ends[-1 - row]
        true = float(np.linalg.norm(layout.points[start] - layout.points[end]))
        length = round(true + 0.3 * layout.errors * random.normal(), 5)
        planted.distances[f"T{row + 1}"] = start, end, length, layout.errors
    return planted


def _images(layout: _Layout, random: np.random.Generator) -> dict[tuple[str, str], np.ndarray]:
    xyz = np.array(list(layout.points.values()))
    images = {}
    for photo, orientation in layout.orientation.items():
        u = (xyz - orientation[:3]) @ Rotation.from_euler("XYZ", orientation[3:], degrees=True).as_matrix()
        xy = -layout.c * u[:, :2] / u[:, 2:]
        shown = (u[:, 2] < 0.0) & (np.abs(xy) < 0.49 * np.array(layout.frame)).all(axis=1)
        xy = xy + NOISE_PARTS * layout.precision * random.normal(size=xy.shape)
        for name, image, is_shown in zip(layout.points, xy, shown, strict=True):
            if is_shown:
                images[photo, name] = _as_written(layout, image)
    return images


def _as_written(layout: _Layout, xy: np.ndarray) -> np.ndarray:
    if layout.sensor is None:
        return np.round(xy, 4)
    columns, rows = layout.sensor
    pixel = layout.frame[0] / columns
    return np.round([xy[0] / pixel + columns / 2.0, rows / 2.0 - xy[1] / pixel], 2)


# --------------------------------------------------------------------------------------------------------------- scenes


def _grid(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> dict[str, np.ndarray]:
    return {str(101 + row): np.array(xyz) for row, xyz in enumerate(zip(x, y, z, strict=True))}


def _aerial(random: np.random.Generator, strips: int, photos: int, relief: float, control: int, checks: int) -> _Layout:
    orientation = {}
    for strip in range(strips):
        for place in range(photos):
            angles = [*random.uniform(-1.5, 1.5, 2), 180.0 * (strip % 2) + random.uniform(-3.0, 3.0)]
            centre = np.array([1000.0 + 800.0 * place, 2000.0 + 1500.0 * strip, 1600.0]) + random.uniform(
                -25.0, 25.0, 3
            )
            orientation[f"P{10 * (strip + 1) + place + 1}"] = np.array([*centre, *angles])
    columns, rows = 2 * photos + 2, 4 * strips + 1 - (strips > 1)
    x, y = np.meshgrid(
        np.linspace(300.0, 200.0 + 800.0 * photos, columns), np.linspace(1050.0, 1450.0 + 1500.0 * strips, rows)
    )
    x, y = (values.ravel() + random.uniform(-60.0, 60.0, values.size) for values in (x, y))
    points = _grid(x, y, 100.0 + random.uniform(-relief, relief, x.size))
    # control at the corners and edges first, then inside
    middle = np.array([x.mean(), y.mean()])
    names = sorted(
        points, key=lambda name: -float(np.abs((points[name][:2] - middle) / np.array([np.ptp(x), np.ptp(y)])).sum())
    )
    chosen = names[:4] + [names[k] for k in np.linspace(5, len(names) - 1, control + checks - 4).astype(int)]
    return _Layout(
        150.0, (230.0, 230.0), orientation, points, chosen[:4] + chosen[4 + checks :], chosen[4 : 4 + checks], 0.03,
        (20.0, 2.0), 0.006,
    )  # fmt: skip


def _strip(random: np.random.Generator) -> _Layout:
    return _aerial(random, 1, 4, 60.0, 8, 4)


def _flat_strip(random: np.random.Generator) -> _Layout:
    return _aerial(random, 1, 4, 1.0, 20, 0)


def _two_strips(random: np.random.Generator) -> _Layout:
    return _aerial(random, 2, 4, 80.0, 10, 5)


def _pair(random: np.random.Generator) -> _Layout:
    layout = _aerial(random, 1, 2, 60.0, 6, 0)
    x, y = np.meshgrid(np.linspace(1080.0, 1720.0, 4), np.linspace(1150.0, 2850.0, 4))
    points = _grid(x.ravel(), y.ravel(), 100.0 + random.uniform(-60.0, 60.0, 16))
    return replace(layout, points=points, control=["101", "104", "109", "112", "113", "116"], errors=0.0, checks=[])


def _looking_at(centre: np.ndarray, target: np.ndarray, roll: float) -> np.ndarray:
    back = (centre - target) / np.linalg.norm(centre - target)
    aside = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 0.95 else np.array([0.0, 1.0, 0.0])
    right = np.cross(aside, back) / np.linalg.norm(np.cross(aside, back))
    axes = (
        np.column_stack([right, np.cross(back, right), back]) @ Rotation.from_euler("Z", roll, degrees=True).as_matrix()
    )
    return np.array([*centre, *Rotation.from_matrix(axes).as_euler("XYZ", degrees=True)])


def _test_field(random: np.random.Generator) -> _Layout:
    orientation = {}
    for number, azimuth in enumerate((0.0, 90.0, 180.0, 270.0, 45.0, 135.0)):
        around = np.radians(azimuth + random.uniform(-8.0, 8.0))
        away = np.array([np.cos(around), np.sin(around), 1.3]) * random.uniform(0.9, 1.0)
        orientation[f"F{number + 1}"] = _looking_at(
            np.array([0.5, 0.5, 0.0]) + away, np.array([0.5, 0.5, 0.0]), 90.0 * (number % 2)
        )
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 7), np.linspace(0.0, 1.0, 7))
    points = _grid(x.ravel(), y.ravel(), random.uniform(-0.002, 0.002, 49))
    return _Layout(
        24.0,
        (36.0, 36.0),
        orientation,
        points,
        ["101", "107", "122", "143", "149", "146"],
        [],
        0.001,
        (0.1, 4.0),
        0.002,
    )


def _object(random: np.random.Generator) -> _Layout:
    middle = np.array([10.0, 20.0, 5.0])
    orientation = {}
    for number in range(8):
        around = np.radians(45.0 * number + random.uniform(-5.0, 5.0))
        away = 4.0 * np.array([np.cos(around), np.sin(around), random.uniform(0.3, 0.7)])
        orientation[f"O{number + 1}"] = _looking_at(middle + away, middle, 90.0 * (number % 2))
    x, y, z = random.uniform(-0.7, 0.7, (3, 36)) + middle[:, None]
    points = _grid(x, y, z)
    extreme = sorted(points, key=lambda name: -float(np.abs(points[name] - middle).sum()))
    return _Layout(
        28.0, (36.0, 24.0), orientation, points, extreme[:6], extreme[6:9], 0.002, (0.2, 4.0), 0.003, (6000, 4000), 3
    )  # fmt: skip


def _facade(random: np.random.Generator) -> _Layout:
    orientation = {}
    for number, east in enumerate((-8.0, -3.5, 0.5, 4.0, 9.0)):
        centre = np.array([500.0 + east, 300.0 + random.uniform(-1.0, 1.0), 41.5 + random.uniform(-0.3, 1.5)])
        target = np.array([500.0 + 0.55 * east, 320.0, 46.0])
        orientation[f"W{number + 1}"] = _looking_at(centre, target, random.uniform(-4.0, 4.0))
    x, z = np.meshgrid(np.linspace(490.0, 510.0, 8), np.linspace(41.0, 52.0, 5))
    depth = 320.0 + random.choice([0.0, 0.6, 1.4], x.size) + random.uniform(-0.1, 0.1, x.size)
    x, z = (values.ravel() + random.uniform(-0.4, 0.4, values.size) for values in (x, z))
    points = _grid(x, depth, z)
    return _Layout(
        24.0, (36.0, 24.0), orientation, points, ["101", "108", "119", "122", "133", "140"], ["111", "126", "130"],
        0.005, (0.6, 4.0), 0.003, (6000, 4000), 3,
    )  # fmt: skip


_LAYOUTS = {
    "strip": _strip,
    "flat strip": _flat_strip,
    "two strips": _two_strips,
    "pair": _pair,
    "test field": _test_field,
    "object": _object,
    "facade": _facade,
}

SCENES = tuple(f"{scene}{given}" for scene in _LAYOUTS for given in ("", " given"))
