"""What points lie on: lines, planes, cylinders and levels, their unknowns and what is said of them; terrain models.

A figure has an origin among its points and three axes. The third is the direction of a line, the normal of a plane, the
axis of a cylinder, and Z of a level (points of equal height); the first two are at right angles to it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Annotated, Final

from msgspec import Struct

from orip.records.control import FigureKind, FigurePoint
from orip.records.fields import GROUND_UNIT, Field

FIGURE_PARAMETERS: Final = ("SHIFT1", "SHIFT2", "SHIFT3", "TILT1", "TILT2", "RADIUS")
"""Unknowns: shifts of the origin along the axes, rotations about the first two, and the radius of a cylinder."""

FIGURE_LENGTHS: Final = ("SHIFT1", "SHIFT2", "SHIFT3", "RADIUS")
FIGURE_TILTS: Final = ("TILT1", "TILT2")

UNKNOWNS_OF_FIGURE: Final[Mapping[FigureKind, tuple[str, ...]]] = MappingProxyType(
    {
        "LINE": ("SHIFT1", "SHIFT2", "TILT1", "TILT2"),
        "PLANE": ("SHIFT3", "TILT1", "TILT2"),
        "CYLINDER": ("SHIFT1", "SHIFT2", "TILT1", "TILT2", "RADIUS"),
        "HEIGHT": ("SHIFT3",),
    }
)
"""What is unknown of a figure of each kind."""

LEAST_POINTS: Final[Mapping[FigureKind, int]] = MappingProxyType({"LINE": 3, "PLANE": 4, "CYLINDER": 6, "HEIGHT": 2})
"""Points with which a figure of each kind begins to say something: fewer lie on one wherever they are."""


class FigureTable(Struct, frozen=True):
    """The figures of a block, in the order in which their points come.

    Parameters
    ----------
    row : tuple of int
        The figure of each point.
    """

    names: tuple[str, ...]
    kinds: tuple[FigureKind, ...]
    row: tuple[int, ...]


def figures_in(points: tuple[FigurePoint, ...]) -> FigureTable:
    """Return the figures that points lie on."""
    kinds = {point.figure: point.kind for point in points}
    place = {name: row for row, name in enumerate(kinds)}
    return FigureTable(tuple(kinds), tuple(kinds.values()), tuple(place[point.figure] for point in points))


def points_that_count(points: Iterable[FigurePoint], names: Collection[str]) -> tuple[FigurePoint, ...]:
    """Return the points of figures that are among some names; none of a figure that as few lie on anyway."""
    known = [point for point in points if point.point in names]
    number = Counter(point.figure for point in known if point.error > 0.0)
    return tuple(point for point in known if number[point.figure] >= LEAST_POINTS[point.kind])


class FigureEstimate(Struct, frozen=True):
    """An adjusted figure, in the project's coordinates and ground unit.

    Parameters
    ----------
    points : int
        In use.
    X, Y, Z : float
        A place on it: on the line, the plane or the axis. Of a level Z is the common height.
    dX, dY, dZ : float
        Direction of the line or the axis, or the normal of the plane, of length 1; NaN of a level.
    radius : float
        Of a cylinder; else NaN.
    sd_place : float
        Standard deviation of the place, along the normal of a plane, in the worst direction across a line or axis, of
        the height of a level.
    sd_direction : float
        Of the direction, where it is known least, degrees; NaN of a level.
    rms : float
        Of the residuals of its points in use.
    """

    name: str
    kind: FigureKind
    points: int
    X: float
    Y: float
    Z: float
    dX: float
    dY: float
    dZ: float
    radius: float
    sd_place: float
    sd_direction: float
    sd_radius: float
    rms: float


class Terrain(Struct, frozen=True):
    """A terrain model whose heights are observations of points: a table ``[[terrain]]`` of orip.toml.

    Parameters
    ----------
    file : str
        GeoTIFF in the project's system, relative to the project folder.
    error : float
        A-priori error of a height.
    plan_error : float
        A-priori error of the model's place; on a slope it adds to that of the height.
    points : tuple of str
        Names of points that lie on it, ``*`` and ``?`` standing for any letters; empty: all of the bundle.
    disregard : tuple of str
        Names of points among these that are only compared with it.
    """

    name: Annotated[str, Field(example='"DTM"')]
    file: Annotated[str, Field(shortest=1, example='"terrain.tif"')]
    error: Annotated[float, Field(least=1e-7, most=1e6, units=(GROUND_UNIT,), example="0.15")]
    plan_error: Annotated[float, Field(least=0, most=1e6, units=(GROUND_UNIT,), example="0.5")] = 0.0
    points: Annotated[tuple[str, ...], Field(example='["G*"]')] = ()
    disregard: Annotated[tuple[str, ...], Field(example='["G17"]')] = ()

    def has(self, point: str) -> bool:
        """Tell whether a point is said to lie on it."""
        return not self.points or any(fnmatchcase(point, pattern) for pattern in self.points)

    def disregards(self, point: str) -> bool:
        """Tell whether a point is only compared with it."""
        return any(fnmatchcase(point, pattern) for pattern in self.disregard)
