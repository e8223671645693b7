"""A free network: its datum is fixed by inner constraints against small movements of the whole block."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.sparse import csr_array

from orip.adjustment.equations import Equations
from orip.adjustment.factorisation.null_space import InnerConstraints, PointMovements
from orip.arrays import FloatArray, IntArray
from orip.bundle.datum.movements import Movements, movements_of_block
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.errors import InputError
from orip.records.block import Block
from orip.structs import replace

_DETERMINED = 1e-8
"""An observation determines a movement if that changes it by more than this part of what its partials allow."""


class FreeDatum(Struct, frozen=True):
    """The datum of a free network.

    Parameters
    ----------
    movements : array (7, d)
        Combinations of the seven movements (three shifts, three rotations, scale) that nothing determines.
    held : array (d,) of int
        Unknowns held while solving.
    points : array of int
        Points whose sum of squared corrections is least.
    """

    movements: FloatArray
    held: IntArray
    points: IntArray

    def transformed(self, correction: FloatArray, state: BlockState, unknowns: Unknowns) -> FloatArray:
        """Return corrections S c of all unknowns (m + 3 b,) or (m + 3 b, k) that meet the inner constraints."""
        free = movements_of_block(state, unknowns).combined(self.movements)
        sums = free.transposed_at(self.points, correction)
        amounts = np.asarray(np.linalg.solve(free.squares_at(self.points), sums), dtype=np.float64)
        return np.asarray(correction - free.times(amounts))

    def transposed(self, vectors: FloatArray, state: BlockState, unknowns: Unknowns) -> FloatArray:
        """Return S^T v of vectors (m + 3 b, k), with S = I - G B^T; see `InnerConstraints`."""
        orthonormal = self._orthonormal(state, unknowns)
        sums = orthonormal.dense().T @ vectors
        return np.asarray(vectors - self._inner_constraints(orthonormal, unknowns).defining_rows() @ sums)

    def inner_constraints(self, state: BlockState, unknowns: Unknowns) -> InnerConstraints:
        """Return the constraints that cofactors are transformed to."""
        return self._inner_constraints(self._orthonormal(state, unknowns), unknowns)

    def _orthonormal(self, state: BlockState, unknowns: Unknowns) -> Movements:
        """Return the free movements G, combined so that G^T G over the datum points is the unit matrix."""
        free = movements_of_block(state, unknowns).combined(self.movements)
        squares, directions = np.linalg.eigh(free.squares_at(self.points))
        return free.combined(directions / np.sqrt(squares))

    def _inner_constraints(self, movements: Movements, unknowns: Unknowns) -> InnerConstraints:
        m, eliminated = unknowns.layout.reduced, unknowns.names.eliminated
        free = ~unknowns.names.fixed.reshape(-1, 3)
        of_datum = np.zeros(len(unknowns.points), dtype=bool)
        of_datum[self.points] = True
        points = PointMovements(
            movements.homogeneous[eliminated], movements.coefficients, free, free & of_datum[eliminated, None]
        )
        of_datum[eliminated] = False
        columns = unknowns.points[of_datum]
        columns = columns[columns != CONSTANT]
        reduced = movements.rows_of_reduced(m, eliminated)
        defining = np.zeros_like(reduced)
        defining[columns] = reduced[columns]
        return InnerConstraints(reduced, defining, points)


def free_datum(
    block: Block, state: BlockState, unknowns: Unknowns, equations: Equations, on_the_ground: NDArray[np.bool_]
) -> FreeDatum | None:
    """Find what is free in a network.

    Parameters
    ----------
    state : BlockState
        The starting state.
    equations : Equations
        At the starting state.
    on_the_ground : array (n,) of bool
        Observations other than photo points: they may determine movements.

    Returns
    -------
    FreeDatum or None
        None: observations and constants determine every movement.

    Raises
    ------
    InputError
        If a datum point is not in the block, or the datum points do not suffice.
    """
    movements = movements_of_block(state, unknowns)
    free = free_movements(state, unknowns, equations.design[on_the_ground & equations.active])
    if not free.shape[1]:
        return None
    moving = unknowns.photos if unknowns.rigs is None else np.vstack([unknowns.photos, unknowns.rigs.exposures])
    photo_columns = np.sort(moving[moving != CONSTANT])
    length = np.isin(photo_columns, moving[:, :3])
    scaled = (movements.rows_of(photo_columns) / np.where(length, movements.size, 1.0)[:, None]) @ free
    datum = FreeDatum(free, photo_columns[_pivots(scaled.T)[: free.shape[1]]], _datum_points(block))
    _require_enough_points(datum, state, unknowns)
    return datum


def _pivots(matrix: FloatArray) -> IntArray:
    """Return the order (m,) of the columns of a matrix (d, m), each with the most beyond those before it."""
    work = int(lapack.dgeqp3(matrix, lwork=-1)[3][0])
    _, order, _, _, _ = lapack.dgeqp3(matrix, lwork=work)
    return np.asarray(order, dtype=np.int64) - 1


def free_movements(state: BlockState, unknowns: Unknowns, design: csr_array) -> FloatArray:
    """Return the combinations (7, d) of movements that neither observations nor constants determine.

    Parameters
    ----------
    design : sparse array (n, m + 3 b)
        Of the observations that may determine them.
    """
    columns = np.unique(design.indices)
    generator, own = movements_of_block(state, unknowns).rows_of(columns), design[:, columns]
    allowed = abs(own) @ np.abs(generator).max(axis=1, initial=0.0)
    scale = np.where(allowed > 0.0, allowed, 1.0)[:, None]
    by_observations = _beyond_unknowns((own @ generator) / scale, design, scale, unknowns)
    determined = np.vstack([by_observations, _held_by_constants(state, unknowns), np.zeros((1, 7))])
    # only the square matters: n rows would make a needlessly large decomposition
    triangle = np.linalg.qr(determined, mode="r")
    _, values, movements = np.linalg.svd(np.vstack([triangle, np.zeros((7, 7))]))
    return np.asarray(movements[int(np.count_nonzero(values > _DETERMINED)) :].T)


_EXACTLY = 1e12
"""Information on movements that constants hold: standard deviations of a millionth."""


def information_on_movements(
    state: BlockState, unknowns: Unknowns, design: csr_array, weights: FloatArray
) -> FloatArray:
    """Return the information (7, 7), inverse to covariances, that observations and constants have on the movements.

    It is that on a block whose shape is exactly known: the true one is not larger.

    Parameters
    ----------
    design : sparse array (n, m + 3 b)
        Of the observations that may determine them, divided by their a-priori errors.
    weights : array (n,)
        Their weight factors.
    """
    root = np.sqrt(weights)[:, None]
    columns = np.unique(design.indices)
    own = root * (design[:, columns] @ movements_of_block(state, unknowns).rows_of(columns))
    beyond = _beyond_unknowns(own, design, 1.0 / np.maximum(root, 1e-300), unknowns)
    held = _held_by_constants(state, unknowns)
    return np.asarray(beyond.T @ beyond + _EXACTLY * held.T @ held)


def _beyond_unknowns(
    by_observations: FloatArray, design: csr_array, scale: FloatArray, unknowns: Unknowns
) -> FloatArray:
    """Return the part of the changes (n, 7) of observations that unknown antennas and figures do not absorb."""
    tables = (unknowns.antennas, unknowns.shifts, unknowns.drifts, unknowns.figures)
    columns = np.concatenate([table.ravel() for table in tables])
    columns = columns[columns != CONSTANT]
    if not len(columns) or not len(by_observations):
        return by_observations
    absorbing = design[:, columns].toarray() / scale
    left, values, _ = np.linalg.svd(absorbing, full_matrices=False)
    left = left[:, values > _DETERMINED * values.max(initial=0.0)]
    return by_observations - left @ (left.T @ by_observations)


def _held_by_constants(state: BlockState, unknowns: Unknowns) -> FloatArray:
    """Return how the movements would change constant photo elements and points: they are not free to."""
    rigs = unknowns.rigs
    tables = [unknowns.elements, unknowns.points, *([] if rigs is None else [rigs.mountings])]
    constant = np.concatenate([table.ravel() for table in tables]) == CONSTANT
    if not constant.any():
        return np.empty((0, 7))
    ends = np.cumsum([table.size for table in tables])
    size = int(ends[-1])
    numbered = [np.arange(end - table.size, end).reshape(table.shape) for table, end in zip(tables, ends, strict=True)]
    if rigs is not None:
        rigs = replace(rigs, mountings=numbered[2], exposures=np.full_like(rigs.exposures, CONSTANT))
    as_unknown = replace(
        unknowns,
        photos=numbered[0],
        points=numbered[1],
        rigs=rigs,
        theodolites=np.full_like(unknowns.theodolites, CONSTANT),
        figures=np.full_like(unknowns.figures, CONSTANT),
        layout=replace(unknowns.layout, reduced=size, blocks=0, fixed=np.zeros(size, dtype=bool)),
    )
    rows = movements_of_block(state, as_unknown).rows_of(np.flatnonzero(constant))
    return np.asarray(rows / np.maximum(np.abs(rows).max(axis=1, keepdims=True, initial=0.0), 1e-300))


def _datum_points(block: Block) -> IntArray:
    if not block.definition.datum_points:
        return np.arange(len(block.point_names))
    place = block.point_index()
    missing = [name for name in block.definition.datum_points if name not in place]
    if missing:
        message = f"datum point {', '.join(missing)} of bundle {block.definition.name} is not measured in any photo"
        raise InputError.single(message)
    return np.array([place[name] for name in block.definition.datum_points])


def _require_enough_points(datum: FreeDatum, state: BlockState, unknowns: Unknowns) -> None:
    generator = movements_of_block(state, unknowns).combined(datum.movements).dense()
    columns = unknowns.points[datum.points]
    rows = generator[columns[columns != CONSTANT]]
    if len(rows) < rows.shape[1] or np.linalg.svd(rows, compute_uv=False)[-1] < _DETERMINED * np.abs(rows).max():
        message = (
            f"{len(datum.points)} datum points do not determine the free network's {rows.shape[1]} movements; "
            "name at least three that are not on one line, or none to use all points"
        )
        raise InputError.single(message)
