"""An aerial block of 10 km by 10 km on the curved earth, computed with PROJ alone, and not with orip's ground frame.

Photos are taken in geocentric coordinates: places by PROJ's conversions, rotations from the ellipsoid's normal and
PROJ's meridian convergence at each projection centre. Photo coordinates are free of error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyproj
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.bundle.assemble import BlockInput, gather, with_starting_values
from orip.geometry.plane import PlaneTransformation
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.control import Control, ControlPoint
from orip.records.definition import BundleDefinition, Precision
from orip.records.measurement import Measured, PhotoObservations
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo

CRS = "EPSG:25832"
MIDDLE = np.array([690_000.0, 5_340_000.0, 500.0])
SIDE = 10_000.0
PRINCIPAL_DISTANCE = 150.0
FRAME = 230.0
PHOTOS_IN_A_ROW = 7
POINTS_IN_A_ROW = 11
"""One each km: corners, the middle and the middles of the sides are among them."""

_ALONG = 0.6
"""Overlap of neighbouring photos and of neighbouring strips."""


class AerialBlock(Struct, frozen=True):
    """The truth and what is measured of it.

    Parameters
    ----------
    orientations : array (photos, 6)
        X0, Y0, Z0, and degrees, in the crs.
    points : array (points, 3)
        In the crs; point (row, column) of the raster is number row * POINTS_IN_A_ROW + column.
    photo, point : arrays (n,) of int
    xy : array (n, 2)
        mm.
    """

    orientations: np.ndarray
    points: np.ndarray
    photo: np.ndarray
    point: np.ndarray
    xy: np.ndarray

    @property
    def photo_names(self) -> list[str]:
        return [f"P{row + 1}" for row in range(len(self.orientations))]

    @property
    def point_names(self) -> list[str]:
        return [str(1001 + row) for row in range(len(self.points))]

    @property
    def corners(self) -> list[int]:
        last = POINTS_IN_A_ROW - 1
        return [row * POINTS_IN_A_ROW + column for row in (0, last) for column in (0, last)]

    @property
    def middles_of_the_sides(self) -> list[int]:
        half, last = POINTS_IN_A_ROW // 2, POINTS_IN_A_ROW - 1
        pairs = [(0, half), (last, half), (half, 0), (half, last)]
        return [row * POINTS_IN_A_ROW + column for row, column in pairs]

    @property
    def middle(self) -> int:
        return len(self.points) // 2

    def control(self, errors: Mapping[int, tuple[float, float, float]]) -> list[ControlPoint]:
        """Return true coordinates with the errors given; all other points are check points."""
        return [
            ControlPoint(name, tuple(xyz), errors.get(row, (-0.01,) * 3))
            for row, (name, xyz) in enumerate(zip(self.point_names, self.points.tolist(), strict=True))
        ]

    def assembled(
        self,
        control: Control,
        crs: str | None = CRS,
        constant: Mapping[int, Sequence[str]] | None = None,
        shift: float = 30.0,
        datum: str = "control",
    ) -> Block:
        """Return the block as assembled, photos `shift` metres and 0.01 * shift degrees off; constants are true."""
        random = np.random.default_rng(11)
        start = self.orientations + random.normal(size=self.orientations.shape) * shift * np.repeat([1.0, 0.01], 3)
        held = constant or {}
        for row, kinds in held.items():
            columns = [PHOTO_PARAMETERS.index(kind) for kind in kinds]
            start[row, columns] = self.orientations[row, columns]
        camera = Camera("RMK", (PRINCIPAL_DISTANCE, *[0.0] * 12))
        photos = [
            Photo(name, "RMK", orientation=tuple(row), constant=tuple(held.get(index, ())))
            for index, (name, row) in enumerate(zip(self.photo_names, start.tolist(), strict=True))
        ]
        count = len(self.photo)
        observations = PhotoObservations(
            "MAIN",
            tuple(self.photo_names[row] for row in self.photo),
            tuple(self.point_names[row] for row in self.point),
            self.xy,
            np.full((count, 2), np.nan),
            np.zeros(count, dtype=bool),
        )
        unchanged = PlaneTransformation(np.eye(2), np.zeros(2))
        definition = BundleDefinition("MAIN", Precision(0.005), enp_stop=6.0, datum=datum)
        made = gather(
            BlockInput(
                definition,
                Definitions(
                    {record_key("RMK"): camera}, {}, {}, {record_key(photo.name): photo for photo in photos}, {}
                ),
                Measured(observations={record_key("MAIN"): observations}),
                Interior((), {}, {record_key(photo.name): unchanged for photo in photos}, {}, (), ()),
                control,
                (),
                "m",
                crs,
            )
        )
        return with_starting_values(made)[0]

    def write(self, folder: Path, crs: str | None, control: Sequence[ControlPoint]) -> Path:
        """Write the block as a project folder."""
        folder.mkdir()
        toml = ['[project]\nname = "AERIAL"\nground_unit = "m"', *([f'crs = "{crs}"'] if crs else [])]
        toml += [f'[[camera]]\nname = "RMK"\nc = {PRINCIPAL_DISTANCE}']
        for name, row in zip(self.photo_names, self.orientations.tolist(), strict=True):
            elements = "\n".join(f"{kind} = {value:.2f}" for kind, value in zip(PHOTO_PARAMETERS, row, strict=True))
            toml.append(f'[[photo]]\nname = "{name}"\ncamera = "RMK"\n{elements}')
        toml.append('[[bundle]]\nname = "MAIN"')
        (folder / "orip.toml").write_text("\n".join(toml) + "\n")
        lines = [
            " ".join([point.name, *(f"{value:.4f}" for value in point.coordinates), *(str(e) for e in point.errors)])
            for point in control
        ]
        (folder / "AERIAL.PNT").write_text("\n".join(lines) + "\n")
        log = []
        for row, name in enumerate(self.photo_names):
            log.append(f"POINTS MAIN {name}")
            mine = self.photo == row
            log += [
                f"{self.point_names[point]} {x:.6f} {y:.6f}"
                for point, (x, y) in zip(self.point[mine], self.xy[mine].tolist(), strict=True)
            ]
        (folder / "AERIAL.MEA").write_text("\n".join(log) + "\n")
        return folder


def aerial_block() -> AerialBlock:
    """Return the block: strips to the east, vertical within some degrees, hilly ground."""
    random = np.random.default_rng(5)
    axis = np.linspace(-0.5, 0.5, POINTS_IN_A_ROW) * SIDE
    y, x = np.meshgrid(axis, axis, indexing="ij")
    hills = 60.0 * np.sin(x / 900.0) * np.cos(y / 1300.0)
    # control and the places where the curvature is read stand at one height
    hills[:: POINTS_IN_A_ROW // 2, :: POINTS_IN_A_ROW // 2] = 0.0
    points = MIDDLE + np.stack([x, y, hills], axis=-1).reshape(-1, 3)

    base = SIDE / (PHOTOS_IN_A_ROW - 1)
    height = base / (1.0 - _ALONG) * PRINCIPAL_DISTANCE / FRAME
    axis = np.linspace(-0.5, 0.5, PHOTOS_IN_A_ROW) * SIDE
    y, x = np.meshgrid(axis, axis, indexing="ij")
    centres = MIDDLE + np.stack([x, y, np.full_like(x, height)], axis=-1).reshape(-1, 3)
    centres += 15.0 * random.normal(size=centres.shape)
    angles = random.normal(size=centres.shape) * [1.5, 1.5, 4.0]
    photo, point, xy = _images(centres, angles, points)
    return AerialBlock(np.hstack([centres, angles]), points, photo, point, xy)


def _images(centres: np.ndarray, angles: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    geocentric_points, geocentric_centres = geocentric(points), geocentric(centres)
    grid = grid_axes(centres)
    photo, point, images = [], [], []
    for row, (centre, axes, turned) in enumerate(zip(geocentric_centres, grid, angles, strict=True)):
        in_grid = (geocentric_points - centre) @ axes.T
        u = in_grid @ Rotation.from_euler("XYZ", turned, degrees=True).as_matrix()
        xy = -PRINCIPAL_DISTANCE * u[:, :2] / u[:, 2:]
        shown = np.flatnonzero((np.abs(xy) < FRAME / 2.0).all(axis=1) & (u[:, 2] < 0.0))
        photo.append(np.full(len(shown), row))
        point.append(shown)
        images.append(xy[shown])
    return np.concatenate(photo), np.concatenate(point), np.vstack(images)


def geocentric(xyz: np.ndarray) -> np.ndarray:
    """Return geocentric coordinates (n, 3) of places in the crs."""
    steps = "+proj=pipeline +step +inv +proj=utm +zone=32 +ellps=GRS80 +step +proj=cart +ellps=GRS80"
    return np.stack(pyproj.Transformer.from_pipeline(steps).transform(*xyz.T), axis=1)


def grid_axes(xyz: np.ndarray) -> np.ndarray:
    """Return grid east, grid north and the ellipsoid's normal as rows (n, 3, 3), geocentric."""
    utm = pyproj.Proj("+proj=utm +zone=32 +ellps=GRS80")
    longitude, latitude = utm(xyz[:, 0], xyz[:, 1], inverse=True)
    convergence = np.radians(utm.get_factors(longitude, latitude).meridian_convergence)
    longitude, latitude = np.radians(longitude), np.radians(latitude)
    zero = np.zeros_like(longitude)
    east = np.stack([-np.sin(longitude), np.cos(longitude), zero], axis=1)
    up = np.stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], axis=1
    )
    north = np.cross(up, east)
    sine, cosine = np.sin(convergence)[:, None], np.cos(convergence)[:, None]
    # grid north lies to the east of true north by the convergence
    return np.stack([cosine * east - sine * north, sine * east + cosine * north, up], axis=1)
