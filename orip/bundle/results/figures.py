"""Figures of a solution by the names of gates, covariances between its records, predicted photo coordinates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orip.arrays import BoolArray, FloatArray, IntArray, along_diagonal
from orip.bundle.results.ground import rotation_partials, undetermined_points
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT, set_names
from orip.geometry.projection import projected_with_partials
from orip.geometry.rotation import rotation_from_angles
from orip.interior.additional_parameters import PARAMETER_SETS, base_of_camera
from orip.interior.distortion import image_polynomial
from orip.interior.image_coordinates import ImageEquation
from orip.records.coded_names import coded
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.observations.observation_kinds import CONTROL_POINT
from orip.records.project.camera import Camera
from orip.records.results.solution import Solution
from orip.threads import limited_threads
from orip.units import DEGREES_PER_RADIAN, RADIANS_PER_DEGREE


def figure(solution: Solution, name: str) -> float:
    """Return a figure of a solution; see `orip.records.results.result_tests.GATE_FIGURES` for what the names mean.

    NaN where the solution has no such figure, for instance no check points; infinite where the standard deviations
    concerned include that of an unknown that nothing determines.

    Raises
    ------
    KeyError
        If there is no figure of this name.
    """
    return float(_FIGURES[name](solution))


def _largest(values: ArrayLike) -> float:
    known = _known(values)
    return float(known.max()) if known.size else np.nan


def _root_mean_square(values: ArrayLike) -> float:
    known = _known(values)
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan


def _known(values: ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    return array[~np.isnan(array)]


def _count(chosen: NDArray[np.bool_]) -> float:
    return float(np.count_nonzero(chosen))


def _taking_part(solution: Solution) -> NDArray[np.bool_]:
    """Return which components are observations; disregarded ones have no weight factor."""
    return ~np.isnan(solution.residuals.weight_factor)


def _smallest_redundancy_number(solution: Solution) -> float:
    return -_largest(-solution.residuals.redundancy_number[_taking_part(solution)])


def _check_differences(solution: Solution) -> FloatArray:
    """Return dX, dY, dZ (n, 3)."""
    return np.array([(point.dX, point.dY, point.dZ) for point in solution.check_points]).reshape(-1, 3)


def _control_residuals(solution: Solution, components: str) -> FloatArray:
    residuals = solution.residuals
    chosen = coded(residuals.kind).where(CONTROL_POINT.name.__eq__)
    chosen &= coded(residuals.component).where(lambda component: component in components)
    return residuals.residual[chosen & _taking_part(solution)]


_FIGURES: Mapping[str, Callable[[Solution], float]] = {
    "sigma0": lambda solution: solution.sigma0,
    "sigma0_all": lambda solution: solution.sigma0_all,
    "redundancy": lambda solution: solution.redundancy,
    "redundancy_used": lambda solution: solution.redundancy_used,
    "observations": lambda solution: solution.observations,
    "unknowns": lambda solution: solution.unknowns,
    "enp": lambda solution: solution.enp,
    "iterations": lambda solution: len(solution.iterations),
    "down_weighted": lambda solution: _count(solution.residuals.weight_factor < 1.0),
    "singular": lambda solution: len(solution.singular),
    "blunders": lambda solution: len(solution.blunders),
    "diagnosis": lambda solution: len(solution.diagnosis),
    "doubted_groups": lambda solution: sum(group.doubted for group in solution.groups),
    "warnings": lambda solution: len(solution.warnings),
    "max_standard_residual": lambda solution: _largest(solution.residuals.standard_residual[_taking_part(solution)]),
    "max_abs_w": lambda solution: _largest(np.abs(solution.residuals.w)),
    "min_redundancy_number": _smallest_redundancy_number,
    "max_correlation": lambda solution: _largest([abs(pair.r) for pair in solution.correlations if " " not in pair.a]),
    "check_points.count": lambda solution: len(solution.check_points),
    "check_points.rms_xy": lambda solution: _root_mean_square(_check_differences(solution)[:, :2]),
    "check_points.rms_z": lambda solution: _root_mean_square(_check_differences(solution)[:, 2]),
    "check_points.max": lambda solution: _largest(np.abs(_check_differences(solution))),
    "control.count": lambda solution: len(_control_residuals(solution, "XYZ")),
    "control.rms_xy": lambda solution: _root_mean_square(_control_residuals(solution, "XY")),
    "control.rms_z": lambda solution: _root_mean_square(_control_residuals(solution, "Z")),
    "control.max": lambda solution: _largest(np.abs(_control_residuals(solution, "XYZ"))),
    "cameras.count": lambda solution: len(solution.cameras.names),
    "photos.count": lambda solution: len(solution.photos.names),
    "photos.max_sd": lambda solution: _largest(solution.photos.sd[:, :3]),
    "photos.max_angle_sd": lambda solution: _largest(solution.photos.sd[:, 3:]),
    "points.count": lambda solution: len(solution.points.names),
    "points.single_ray": lambda solution: int(np.count_nonzero(solution.point_rays == 1)),
    "points.max_sd": lambda solution: _largest(solution.points.sd),
    "points.rms_sd": lambda solution: _root_mean_square(solution.points.sd),
}


# The stored cofactors are those of unknowns with observations in common. Any other block of the inverse is solved for
# with the factor of the normal equations when it is asked for: Q E = N^-1 E, with unit vectors E. In a free network it
# is S Q S^T E, with the S-transformation of its datum (see `orip.bundle.datum`).

_AT_ONCE = 60
"""Columns of the inverse computed together: limits memory, as each has as many elements as there are unknowns."""


class Figures(NamedTuple):
    """The r figures of a record as functions of k unknowns.

    Attributes
    ----------
    columns : array (k,) of int
        Of the unknowns; `CONSTANT` for what is none.
    partials : array (r, k)
        Of the figures, in the project's units and axes, by the unknowns.
    undetermined : array (r,) of bool
        Figures that depend on what nothing determines.
    """

    columns: IntArray
    partials: FloatArray
    undetermined: BoolArray


def camera_figures(solved: SolvedBlock, camera: int) -> Figures:
    """Return the parameters of a camera: those of `CAMERA_PARAMETERS`, then those of its set."""
    unknowns = solved.problem.unknowns
    count = len(set_names(solved.block.cameras[camera]))
    columns = np.concatenate([unknowns.cameras[camera], unknowns.additional[camera, :count]])
    return Figures(columns, np.eye(len(columns)), _removed(solved, columns))


def photo_figures(solved: SolvedBlock, photo: int) -> Figures:
    """Return X0 Y0 Z0 (ground units) and OMEGA PHI KAPPA (degrees) of a photo.

    Where phi is ±90 degrees the last three are rotations about the axes of the ground, as in the results.
    """
    centre = solved.state.centres[photo : photo + 1]
    ground = solved.block.ground
    turns, _ = rotation_partials(solved)
    columns = solved.problem.unknowns.photos[photo]
    return Figures(
        columns,
        along_diagonal(ground.project_with_partials(centre).by_local[0], turns[photo] * DEGREES_PER_RADIAN),
        along_diagonal(ground.dependence.astype(np.float64), np.eye(3)) @ _removed(solved, columns) > 0.0,
    )


def point_figures(solved: SolvedBlock, point: int) -> Figures:
    """Return X Y Z of a point, ground units."""
    local = solved.state.points[point : point + 1]
    ground = solved.block.ground
    return Figures(
        solved.problem.unknowns.points[point],
        ground.project_with_partials(local).by_local[0],
        ground.dependence @ undetermined_points(solved)[point] > 0.0,
    )


def covariance(solved: SolvedBlock, rows: Sequence[Figures], columns: Sequence[Figures]) -> FloatArray:
    """Return the covariances of figures, those of several records one below the other.

    Parameters
    ----------
    solved : SolvedBlock
    rows, columns : sequences of Figures

    Returns
    -------
    array (all figures of `rows`, all figures of `columns`)
        sigma0² times the cofactors, with sigma0 = 1 where there is no redundancy. Zero for constants, NaN for what
        nothing determines.
    """
    one, other = _joined(rows), _joined(columns)
    starts = range(0, len(other.columns), _AT_ONCE)
    parts = [_rows_of(cofactor_columns(solved, other.columns[at : at + _AT_ONCE]), one.columns) for at in starts]
    cofactors = np.hstack(parts)
    found = solved.deviation_scale**2 * (one.partials @ cofactors @ other.partials.T)
    found[one.undetermined] = np.nan
    found[:, other.undetermined] = np.nan
    return np.asarray(found)


def cofactor_columns(solved: SolvedBlock, columns: IntArray) -> FloatArray:
    """Return columns (m + 3 b, k) of the cofactor matrix of all unknowns; zero for `CONSTANT`."""
    right = np.zeros((solved.problem.layout.size, len(columns)))
    taken = np.flatnonzero(columns != CONSTANT)
    right[columns[taken], taken] = 1.0
    return cofactors_times(solved, right)


def cofactors_times(solved: SolvedBlock, right: FloatArray) -> FloatArray:
    """Return the product (m + 3 b, k) of the cofactor matrix of all unknowns and a matrix of the same shape."""
    state, unknowns, datum = solved.state, solved.problem.unknowns, solved.problem.datum
    if datum is not None:
        right = datum.transposed(right, state, unknowns)
    with limited_threads(None):
        found = solved.normals.solve(right)
    return found if datum is None else datum.transformed(found, state, unknowns)


def _joined(figures: Sequence[Figures]) -> Figures:
    return Figures(
        np.concatenate([part.columns for part in figures]),
        along_diagonal(*(part.partials for part in figures)),
        np.concatenate([part.undetermined for part in figures]),
    )


def _rows_of(matrix: FloatArray, rows: IntArray) -> FloatArray:
    return np.where((rows == CONSTANT)[:, None], 0.0, matrix[rows])


def _removed(solved: SolvedBlock, columns: IntArray) -> BoolArray:
    return np.asarray((columns != CONSTANT) & solved.normals.removed[columns])


def predict_photo_coordinates(
    solution: Solution, photo: str, camera: Camera, xyz: FloatArray, ground: GroundSystem
) -> FloatArray:
    """Return the photo coordinates of ground points by an adjustment's camera and photo.

    Parameters
    ----------
    solution : Solution
    photo : str
        A photo of the solution.
    camera : Camera
        Its camera; parameter values are taken from the solution.
    xyz : array (n, 3)
        Ground points, the project's coordinates.
    ground : GroundSystem
        Of the project; where its origin is does not matter.

    Returns
    -------
    array (n, 2)
        mm; NaN for a point behind the camera, or where the distortion polynomial images nothing.
    """
    cameras = {record_key(name): row for row, name in enumerate(solution.cameras.names)}
    photos = {record_key(name): row for row, name in enumerate(solution.photos.names)}
    parameters = solution.cameras.values[cameras[record_key(camera.name)]]
    orientation = solution.photos.values[photos[record_key(photo)]]
    centre = orientation[None, :3]
    rotation = rotation_from_angles(orientation[None, 3:] * RADIANS_PER_DEGREE)
    rotation = np.swapaxes(ground.axes_at(centre), 1, 2) @ rotation
    image = projected_with_partials(
        ground.to_local(xyz) - ground.to_local(centre),
        np.broadcast_to(rotation, (len(xyz), 3, 3)),
        np.full(len(xyz), parameters[0]),
        np.full(len(xyz), camera.projection == "equidistant"),
    )
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # a point far outside may overflow
        xy = np.stack(_image_equation(solution, camera, parameters).measured(*image.xy.T), axis=1)
    xy[~image.in_front] = np.nan
    return xy


def _image_equation(solution: Solution, camera: Camera, parameters: FloatArray) -> ImageEquation:
    """Return the image equation of a camera with the parameters (12,) and additional parameters of a solution."""
    key = record_key(camera.name)
    values = np.array([found.value for found in solution.additional if record_key(found.camera) == key])
    name, additional = camera.additional_set, None
    if name is not None and len(values) == len(PARAMETER_SETS[name].parameter_names):
        additional = image_polynomial(name, base_of_camera(camera), values)
    x0, y0, *coefficients = parameters[1:].tolist()
    return ImageEquation(x0, y0, tuple(coefficients), camera.distortion_at == "measured", additional)
