"""What is measured in stereo to be restituted: points, lines and areas, each vertex in two photos."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

FeatureKind = Literal["POINT", "LINE", "AREA"]
FEATURE_KINDS: tuple[FeatureKind, ...] = ("POINT", "LINE", "AREA")

LEAST_VERTICES: dict[FeatureKind, int] = {"POINT": 1, "LINE": 2, "AREA": 3}


class StereoVertex(Struct, frozen=True):
    """A vertex measured in two photos.

    Parameters
    ----------
    left, right : str
        Photos.
    left_xy, right_xy : tuple (x, y)
        Pixels of a digital frame, else mm in the photo.
    error : float or None
        A-priori error of each coordinate, in the same unit; None: that of the photo's points in the adjustment.
    line : int
        Where it stands in its file.
    """

    left: str
    left_xy: tuple[float, float]
    right: str
    right_xy: tuple[float, float]
    error: float | None = None
    line: int = 0


class StereoFeature(Struct, frozen=True):
    """A point, line or area as measured; of a point the vertices are points of one name, of an area its outline.

    Parameters
    ----------
    kind : {"POINT", "LINE", "AREA"}
    code : str
        What it is, such as ROAD.
    name : str
        Which one it is: with its code it names the feature in a file.
    line : int
        Where it stands in its file.
    """

    kind: FeatureKind
    code: str
    name: str
    vertices: tuple[StereoVertex, ...]
    line: int = 0
