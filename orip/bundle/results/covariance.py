"""Normal equations with names, covariances between any two records, and predicted photo coordinates, with their units.

The stored cofactors are those of unknowns with observations in common. Any other block of the inverse is solved for
with the factor of the normal equations when it is asked for: Q E = N^-1 E, with unit vectors E. In a free network it is
S Q S^T E, with the S-transformation of its datum (see `orip.bundle.datum.free_datum`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

from orip.arrays import BoolArray, FloatArray, IntArray, along_diagonal
from orip.bundle.results.ground import rotation_partials, undetermined_points
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT, set_names
from orip.geometry.projection import projected_with_partials
from orip.geometry.rotation import rotation_from_angles
from orip.interior.additional_parameters import PARAMETER_SETS, base_of_camera
from orip.interior.distortion import image_polynomial
from orip.interior.image_coordinates import ImageEquation
from orip.records.camera import READOUT, Camera
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.threads import limited_threads
from orip.units import DEGREES_PER_RADIAN, RADIANS_PER_DEGREE

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
    return Figures(columns, np.eye(len(columns)), solved.is_undetermined(columns))


def photo_figures(solved: SolvedBlock, photo: int) -> Figures:
    """Return X0 Y0 Z0 (ground units) and OMEGA PHI KAPPA (degrees) of a photo.

    Where phi is ±90 degrees the last three are rotations about the axes of the ground, as in the results.
    """
    centre = solved.state.centres[photo : photo + 1]
    ground = solved.block.ground
    turns, _ = rotation_partials(solved)
    columns, partials = _dependence(solved, photo)
    shown = along_diagonal(ground.project_with_partials(centre).by_local[0], turns[photo] * DEGREES_PER_RADIAN)
    touched = along_diagonal(ground.dependence.astype(np.float64), np.eye(3)) @ (partials != 0.0)
    return Figures(columns, shown @ partials, touched @ solved.is_undetermined(columns) > 0.0)


def _dependence(solved: SolvedBlock, photo: int) -> tuple[IntArray, FloatArray]:
    """Return the unknowns (k,) of a photo, and the partials (6, k) of its elements by them."""
    unknowns, partials = solved.problem.unknowns, solved.state.partials_of_rigs()
    if unknowns.rigs is not None and partials is not None:
        rows = np.flatnonzero(unknowns.rigs.photo == photo)
        if len(rows):
            return unknowns.rigs.of_photos[rows[0]], partials[rows[0]]
    return unknowns.photos[photo], np.eye(6)


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


class NormalEquations(NamedTuple):
    """N dx = n at the solution, for sigma0 = 1.

    Attributes
    ----------
    names : tuple of n str
        ``camera C35.C``, ``photo 102.X0``, ``point CP3.Z``; without unknowns that are constant.
    matrix : csr_array (n, n)
        A^T W A, where rows of A are divided by their a-priori errors, and W has the weight factors. Lengths are in
        ground units, camera parameters in mm and powers of it. OMEGA, PHI and KAPPA are small rotations about the axes
        X, Y and Z of the adjustment's system, radians; coordinates with a `crs` those of the local frame.
    right : array (n,)
        -A^T W v: nearly zero where the adjustment has converged.
    removed : array (n,) of bool
        Unknowns that nothing determines, and that were held at their values.
    square_sum : float
        v^T W v.
    """

    names: tuple[str, ...]
    matrix: csr_array
    right: FloatArray
    removed: BoolArray
    square_sum: float


def normal_equations(solved: SolvedBlock) -> NormalEquations:
    """Return the normal equations of an adjusted block; exactly met constants are no part of them."""
    equations = solved.equations
    weight = np.where(equations.active & ~equations.exact, solved.weight_factors, 0.0)
    named = [(column, name) for column, name in enumerate(solved.problem.unknowns.names) if name is not None]
    columns = np.array([column for column, _ in named if not solved.problem.layout.fixed[column]], dtype=np.int64)
    names = tuple(
        f"{name.group.lower()} {name.name}.{name.kind}"
        for column, name in named
        if not solved.problem.layout.fixed[column]
    )
    design = csr_array(equations.design[:, columns])
    weighted = diags_array(weight) @ equations.residual
    matrix = csr_array(design.T @ diags_array(weight) @ design)
    return NormalEquations(
        names, matrix, -(design.T @ weighted), solved.normals.removed[columns], float(equations.residual @ weighted)
    )


def predict_photo_coordinates(
    solution: Solution, photo: str, camera: Camera, xyz: FloatArray, ground: GroundSystem
) -> FloatArray:
    """Return the photo coordinates of ground points by an adjustment's camera and photo.

    Parameters
    ----------
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
    x0, y0, *coefficients = parameters[1:READOUT].tolist()
    return ImageEquation(x0, y0, tuple(coefficients), camera.distortion_at == "measured", additional)
