"""Restituted points, lines and areas, and how vertices snap to those that are there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.records.names import record_key
from orip.records.stereo import FeatureKind
from orip.structs import replace

Triple = tuple[float, float, float]


class Stereo(NamedTuple):
    """Where a vertex was measured: left and right photo, and the y-parallax that it left, mm in the photo."""

    left: str
    right: str
    y_parallax: float


class Vertex(Struct, frozen=True):
    """A restituted vertex.

    Parameters
    ----------
    xyz : tuple (X, Y, Z)
        Ground units, in the project.
    sd : tuple (sX, sY, sZ) or None
        Standard deviations, ground units; None: not known.
    stereo : Stereo or None
        None: it was not measured in photos.
    """

    xyz: Triple
    sd: Triple | None = None
    stereo: Stereo | None = None


class Feature(Struct, frozen=True):
    """A point, line or area; of a point the vertices are points of one name, of an area its outline, not closed.

    Parameters
    ----------
    kind : {"POINT", "LINE", "AREA"}
    code, name : str
        Together they are unique in a file.
    lines : tuple (first, last)
        Where it stands in its file; zeros: not yet.
    """

    kind: FeatureKind
    code: str
    name: str
    vertices: tuple[Vertex, ...]
    lines: tuple[int, int] = (0, 0)

    @property
    def key(self) -> tuple[str, str]:
        """Return what the feature is known by."""
        return record_key(self.code), self.name

    def coordinates(self) -> FloatArray:
        """Return the vertices (n, 3)."""
        return np.array([vertex.xyz for vertex in self.vertices], dtype=np.float64).reshape(-1, 3)

    def outline(self) -> FloatArray:
        """Return the vertices (n, 3), those of an area closed."""
        xyz = self.coordinates()
        return np.vstack([xyz, xyz[:1]]) if self.kind == "AREA" else xyz


def length_of(feature: Feature) -> float:
    """Return the length in space of a line or of the outline of an area, ground units; 0 of a point."""
    if feature.kind == "POINT":
        return 0.0
    return float(np.linalg.norm(np.diff(feature.outline(), axis=0), axis=1).sum())


def area_of(feature: Feature) -> float:
    """Return the area in the XY plane, ground units squared; 0 of what is none."""
    if feature.kind != "AREA":
        return 0.0
    x, y = (feature.outline()[:, :2] - feature.coordinates()[0, :2]).T
    return abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))) / 2.0


def snapped(there: Sequence[Feature], new: Sequence[Feature], within: float) -> tuple[tuple[Feature, ...], int]:
    """Return new features whose vertices take the place of a vertex that is near, and how many do.

    A vertex snaps to the nearest vertex in space of what is there and of the new features before it, and the end of a
    line to its own start. It becomes that vertex, with its standard deviations.

    Parameters
    ----------
    there, new : sequences of Feature
        What has the code and name of a new one is replaced by it, and nothing snaps to it.
    within : float
        Ground units; 0: nothing snaps.
    """
    keys = {feature.key for feature in new}
    known = [vertex for feature in there if feature.key not in keys for vertex in feature.vertices]
    found, count = [], 0
    for feature in new:
        vertices = [_nearest(vertex, known, within) or vertex for vertex in feature.vertices]
        if feature.kind == "LINE" and len(vertices) > 3:
            vertices[-1] = _nearest(vertices[-1], vertices[:1], within) or vertices[-1]
        count += sum(old is not after for old, after in zip(feature.vertices, vertices, strict=True))
        known += vertices
        found.append(replace(feature, vertices=tuple(vertices)))
    return tuple(found), count


def _nearest(vertex: Vertex, known: Sequence[Vertex], within: float) -> Vertex | None:
    if not known or not within > 0.0:
        return None
    distances = np.linalg.norm(np.array([one.xyz for one in known]) - vertex.xyz, axis=1)
    nearest = int(distances.argmin())
    return known[nearest] if distances[nearest] <= within else None
