"""How the block is drawn: which direction is up, and whether it is seen from above or from the front.

Up is Z, or in a network without given coordinates what the photos tell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.records.coded_names import coded
from orip.report.report_input import ReportInput

_FEWEST = 3
_FLAT = 0.15
"""Projection centres that reach less far across than this part of their length are on a line, and have no plane."""


_FRONT = 0.5
"""Photos whose axes are this far from the vertical (cosine), and this much in one direction, make a front view."""


class Vertical(NamedTuple):
    """The axes of drawings: rows (3, 3) are right, up on paper, and vertical, unit vectors of the ground system.

    `note` says where the vertical comes from; it is empty where it is Z.
    """

    axes: FloatArray
    note: str = ""


def vertical(given: ReportInput) -> Vertical:
    """Return the vertical: Z if coordinates were given to anything, else the normal of a mean plane.

    The plane is that of the projection centres or, where these lie on a line, that of the points. Up is where the
    photos are seen from the points.
    """
    solution = given.solution
    has_given = coded(solution.point_kinds).where("tie".__ne__).any() or bool(solution.exposures)
    if given.bundle.datum != "free" or has_given or given.bundle.datum_points:
        return Vertical(np.eye(3))
    centres, points = _known(solution.photos.values[:, :3]), _known(solution.points.values)
    normals = {"projection centres": _normal(centres), "points": _normal(points)}
    found = [(what, normal) for what, normal in normals.items() if normal is not None]
    if not found:
        return Vertical(np.eye(3))
    what, normal = found[0]
    side = float((centres.mean(axis=0) - points.mean(axis=0)) @ normal) if len(centres) and len(points) else normal[2]
    where = f"the normal of the mean plane of the {what}"
    note = f"No coordinates were given, so Z is not vertical: up is {where}."
    return Vertical(_axes(normal if side >= 0.0 else -normal), note)


class BlockSide(NamedTuple):
    """The plane that the block is drawn in.

    `axes` (3, 3) are right and up on paper, and towards the reader; `names` those of the first two, `third` what
    lengths along the third one are.
    """

    title: str
    axes: FloatArray
    names: tuple[str, str]
    third: str


def side_of_block(up: Vertical, looking: FloatArray) -> BlockSide:
    """Return the plan or, where the photos look sideways in about one direction, a view from the front.

    Parameters
    ----------
    up : Vertical
    looking : array (n, 3)
        The directions in which the photos look.
    """
    known = _known(looking)
    mean = known.mean(axis=0) if len(known) else -up.axes[2]
    level = mean - (mean @ up.axes[2]) * up.axes[2]
    if np.linalg.norm(level) > _FRONT and abs(mean @ up.axes[2]) < _FRONT:
        towards = -level / np.linalg.norm(level)
        axes = np.stack([np.cross(up.axes[2], towards), up.axes[2], towards])
        return BlockSide(
            "View of the block from the front", axes, (_name(axes[0], "across"), _name(axes[1], "up")), "depth"
        )
    return BlockSide("Plan of the block", up.axes, (_name(up.axes[0], "across"), _name(up.axes[1], "along")), "height")


def _name(axis: FloatArray, otherwise: str) -> str:
    """Return the name of a coordinate axis, or other words for a direction between them."""
    place = int(np.argmax(np.abs(axis)))
    return "XYZ"[place] if axis[place] > 1.0 - 1e-9 else otherwise


def _known(places: FloatArray) -> FloatArray:
    return np.asarray(places[np.isfinite(places).all(axis=1)])


def _normal(places: FloatArray) -> FloatArray | None:
    """Return the normal of the mean plane of places; None where they are too few, or on a line."""
    if len(places) < _FEWEST:
        return None
    _, sizes, directions = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)
    return np.asarray(directions[2]) if sizes[1] > _FLAT * sizes[0] else None


def _axes(normal: FloatArray) -> FloatArray:
    """Return right, up on paper and the normal; right is as near to X, or where that is the normal to Y, as can be."""
    along = np.eye(3)[0 if abs(normal[0]) < 0.9 else 1]
    right = along - (along @ normal) * normal
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(normal, right), normal])
