"""Covariances between any two records of an adjusted block, in the project's units and axes.

The stored cofactors are those of unknowns with observations in common. Any other block of the inverse is solved for
with the factor of the normal equations when it is asked for: Q E = N^-1 E, with unit vectors E. In a free network it is
S Q S^T E, with the S-transformation of its datum (see `orip.bundle.datum.free_datum`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray, along_diagonal
from orip.bundle.results.ground import rotation_partials, undetermined_points
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT, set_names
from orip.threads import limited_threads
from orip.units import DEGREES_PER_RADIAN

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
    columns, partials = _dependence(solved, photo)
    shown = along_diagonal(ground.project_with_partials(centre).by_local[0], turns[photo] * DEGREES_PER_RADIAN)
    touched = along_diagonal(ground.dependence.astype(np.float64), np.eye(3)) @ (partials != 0.0)
    return Figures(columns, shown @ partials, touched @ _removed(solved, columns) > 0.0)


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


def _removed(solved: SolvedBlock, columns: IntArray) -> BoolArray:
    return np.asarray((columns != CONSTANT) & solved.normals.removed[columns])
