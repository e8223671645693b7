"""The principal distance of another lens, or in another unit: it is tried as an unknown.

Where the photos' orientations are roughly known, the adjustment starts from the value that follows from points with
given coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.points.starting import given_coordinates
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.geometry.projection import PROJECTIONS
from orip.geometry.rotation import rotation_from_angles
from orip.mistakes.hypotheses.camera_parameters import with_camera, with_unknown
from orip.mistakes.hypotheses.hypothesis import Hypothesis
from orip.mistakes.length_units import millimetres_per_unit
from orip.records.block import Block
from orip.records.project.camera import Camera
from orip.structs import replace

_NEAR_AXIS = 0.02
"""Angle, radians, from the camera's axis below which a point says nothing about the principal distance."""

_DIAGONAL_OF_35_MM_FILM = float(np.hypot(36.0, 24.0))

_ALIKE = 0.15
"""Logarithm of the ratio up to which two principal distances count as the same: the accuracy of an uncalibrated one."""


def other_principal_distance(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield the camera of one row with an unknown principal distance."""
    camera = block.cameras[row]
    if "C" in camera.unknown:
        return
    start = replace(camera, parameters=(principal_distance_seen(block, row), *camera.parameters[1:]))
    changed = with_unknown(with_camera(block, row, start), row, "C")
    yield Hypothesis(changed, partial(_findings, row=row, given=camera.parameters[0]))


def _findings(solved: SolvedBlock, row: int, given: float) -> list[ProjectWarning]:
    camera = solved.block.cameras[row]
    found = float(solved.state.cameras[row, 0])
    if found <= 0.0:
        return []
    column = int(solved.problem.unknowns.cameras[row, 0])
    sd = float(solved.deviation_scale * np.sqrt(solved.cofactors_of(np.array([column]))[0, 0]))
    size = "" if camera.sensor is None else ", or the size of the sensor,"
    unit = _unit_clause(given, found, camera)
    text = (
        f"C = {given:g} mm does not fit the photos, {found:.4g} ± {sd:.1g} mm does{unit}: the "
        f"principal distance{size} is probably that of another lens, zoom or camera; correct it, or let the adjustment "
        'determine it (unknown = ["C"])'
    )
    return [ProjectWarning("principal-distance", f"camera {camera.name}", text)]


def _unit_clause(given: float, found: float, camera: Camera) -> str:
    """Return in which unit a principal distance was probably given, as a clause; "" where none explains it."""
    units = {f"in {unit}": size for unit, size in millimetres_per_unit(camera).items()}
    units["in micrometres"] = 1e-3
    if camera.sensor is not None:
        diagonal = float(np.hypot(camera.sensor.width, camera.sensor.height))
        units["the equivalent for 35 mm film"] = diagonal / _DIAGONAL_OF_35_MM_FILM
    differences = {unit: abs(float(np.log(given * size / found))) for unit, size in units.items()}
    nearest = min(differences, key=differences.__getitem__)
    return f" ({given:g} is probably {nearest})" if differences[nearest] < _ALIKE else ""


def principal_distance_seen(block: Block, camera: int) -> float:
    """Return the median ratio (mm) of photo coordinates to those that given points would have with C = 1.

    Parameters
    ----------
    block : Block
        With orientations of the photos.
    camera : int
        Its index in the block.

    Returns
    -------
    float
        The camera's own principal distance where its photos show no point whose coordinates are given in full.
    """
    own = block.cameras[camera].parameters
    rows, ground = _of_given_points(block, camera)
    photo = block.photo_points.photo[rows]
    orientation = block.photo_orientation[photo]
    u = np.einsum("ni,nij->nj", ground - orientation[:, :3], rotation_from_angles(orientation[:, 3:]))
    projection = PROJECTIONS[block.cameras[camera].projection]
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = np.stack(projection.ideal_coordinates(1.0, *u.T), axis=1)
    size = np.sum(tangents**2, axis=1)
    counted = projection.is_in_front(*u.T) & (size > _NEAR_AXIS**2)
    xy = block.photo_points.xy[rows] - np.array(own[1:3])
    found = np.sum(xy * tangents, axis=1)[counted] / size[counted]
    found = found[found > 0.0]
    return float(np.median(found)) if len(found) else own[0]


def _of_given_points(block: Block, camera: int) -> tuple[IntArray, FloatArray]:
    """Return rows of photo points that show points given in full, and these (n, 3) in the frame of the block."""
    known, points = given_coordinates(block), block.photo_points
    full: BoolArray = np.asarray(np.isfinite(known).all(axis=1))
    rows = np.flatnonzero(full[points.point] & (block.photo_camera[points.photo] == camera) & points.in_use)
    return rows, block.ground.to_local(known[points.point[rows]])
