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
from orip.bundle.rigs import RigState
from orip.bundle.state import RADIUS, SHIFTS, TILTS, BlockState, PlacedFigures, entries_at
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.errors import InputError
from orip.geometry.rotation import angle_rates_from_axes_rotation, cross_matrix
from orip.records.block import Block
from orip.structs import replace


class Movements(Struct, frozen=True):
    """The change G (u, d) of all unknowns under d movements of a whole block; rows of points are not stored.

    A movement changes a point by a linear function of its homogeneous coordinates.

    Parameters
    ----------
    size : float
        Of the block: the unit of shifts.
    homogeneous : array (n, 4)
        1, and the coordinates of the points about the centre.
    coefficients : array (3, d, 4)
        Change of each coordinate of a point by its homogeneous coordinates.
    points : array (n, 3) of int
        Unknowns of the points; `CONSTANT` where there is none.
    columns : array (k,) of int
        All other unknowns that move.
    rows : array (k, d)
        Their rows.
    unknowns : int
        u.
    """

    size: float
    homogeneous: FloatArray
    coefficients: FloatArray
    points: IntArray
    columns: IntArray
    rows: FloatArray
    unknowns: int

    def combined(self, combinations: FloatArray) -> Movements:
        """Return combinations (d, e) of the movements."""
        coefficients = np.einsum("adh,de->aeh", self.coefficients, combinations)
        return replace(self, coefficients=coefficients, rows=self.rows @ combinations)

    def dense(self) -> FloatArray:
        """Return G (u, d)."""
        return self.times(np.eye(self.rows.shape[1]))

    def rows_of(self, columns: IntArray) -> FloatArray:
        """Return the rows (k, d) of G of some unknowns (k,), each once."""
        place = np.full(self.unknowns, -1)
        place[columns] = np.arange(len(columns))
        found = np.zeros((len(columns), self.rows.shape[1]))
        others = place[self.columns]
        found[others[others >= 0]] = self.rows[others >= 0]
        of_points = np.where(self.points != CONSTANT, place[self.points], -1)
        point, axis = np.nonzero(of_points >= 0)
        found[of_points[point, axis]] = np.einsum("kdh,kh->kd", self.coefficients[axis], self.homogeneous[point])
        return found

    def rows_of_reduced(self, reduced: int, eliminated: IntArray) -> FloatArray:
        """Return the rows (m, d) of G of the first m unknowns: all but those of the points that are `eliminated`."""
        found = np.zeros((reduced, self.rows.shape[1]))
        found[self.columns] = self.rows
        stays = np.ones(len(self.points), dtype=bool)
        stays[eliminated] = False
        for point in np.flatnonzero(stays):
            free = self.points[point] != CONSTANT
            found[self.points[point, free]] = self.coefficients[free] @ self.homogeneous[point]
        return found

    def times(self, amounts: FloatArray) -> FloatArray:
        """Return G x (u,) or (u, k) for amounts of the movements (d,) or (d, k)."""
        result = np.zeros((self.unknowns, *amounts.shape[1:]))
        result[self.columns] = self.rows @ amounts
        of_points = np.stack([self.homogeneous @ (table.T @ amounts) for table in self.coefficients], axis=1)
        free = self.points != CONSTANT
        every = free.all()
        result[self.points if every else self.points[free]] = of_points if every else of_points[free]
        return result

    def of_points(self, points: IntArray, amounts: FloatArray) -> FloatArray:
        """Return how some points (k,) move (k, 3) by amounts (d,) of the movements, as if all were free."""
        return np.stack([self.homogeneous[points] @ (table.T @ amounts) for table in self.coefficients], axis=1)

    def transposed_at(self, points: IntArray, vectors: FloatArray) -> FloatArray:
        """Return G^T v (d,) or (d, k) for vectors (u,) or (u, k), over the unknowns of some points alone."""
        homogeneous, of_points = self.homogeneous[points], entries_at(vectors, self.points[points])
        found = (table @ (homogeneous.T @ of_points[:, place]) for place, table in enumerate(self.coefficients))
        return np.asarray(sum(found))

    def squares_at(self, points: IntArray) -> FloatArray:
        """Return G^T G (d, d) over the unknowns of some points alone."""
        every = len(points) == len(self.points)
        homogeneous = self.homogeneous if every else self.homogeneous[points]
        free = (self.points if every else self.points[points]) != CONSTANT
        products = [homogeneous.T @ homogeneous] * 3
        if not free.all():
            products = [homogeneous.T @ (free[:, [place]] * homogeneous) for place in range(3)]
        found = (table @ product @ table.T for table, product in zip(self.coefficients, products, strict=True))
        return np.asarray(sum(found))


def movements_of_block(state: BlockState, unknowns: Unknowns) -> Movements:
    """Return the seven movements of a block at a state; shifts are in units of its size."""
    centre, offset, known = _offsets(state.points)
    size = float(np.sqrt(np.vdot(offset, offset) / max(3 * known, 1)) or 1.0)
    homogeneous = np.ones((len(offset), 4))
    homogeneous[:, 1:] = offset
    constant = _positions(np.zeros((1, 3)), size)[0]
    linear = _positions(np.eye(3), size) - constant
    coefficients = np.moveaxis(np.concatenate([constant[None], linear]), 0, 2)

    turns = np.broadcast_to(np.eye(3), state.rotations.shape).copy()
    by_angles = state.turned_by_angles
    if by_angles.any():
        turns[by_angles] = angle_rates_from_axes_rotation(state.angles()[by_angles])
    rotations = np.zeros((len(turns), 3, 7))
    rotations[:, :, 3:6] = turns
    zero_directions = np.zeros((len(unknowns.theodolites), 7))
    # azimuths run clockwise, rotations about Z the other way
    zero_directions[:, 5] = -1.0
    rows = [
        _positions(state.centres - centre, size), rotations, zero_directions,
        _of_figures(state.figures, _positions(state.figures.origins - centre, size)),
    ]  # fmt: skip
    columns = [unknowns.photos[:, :3], unknowns.photos[:, 3:], unknowns.theodolites, unknowns.figures]
    if state.rigs is not None and unknowns.rigs is not None:
        rows += _movements_of_rigs(state.rigs, centre, size)
        columns += [unknowns.rigs.exposures[:, :3], unknowns.rigs.exposures[:, 3:], unknowns.rigs.mountings]
    places = np.concatenate([table.ravel() for table in columns])
    values = np.concatenate([table.reshape(-1, 7) for table in rows])
    free = places != CONSTANT
    return Movements(size, homogeneous, coefficients, unknowns.points, places[free], values[free], unknowns.layout.size)


def _movements_of_rigs(rigs: RigState, centre: FloatArray, size: float) -> list[FloatArray]:
    """Return the changes of centres and rotations of exposures, and of mountings: the scale moves their offsets."""
    rotations, mountings = np.zeros((len(rigs.centres), 3, 7)), np.zeros((len(rigs.offsets), 6, 7))
    rotations[:, :, 3:6] = np.eye(3)
    mountings[:, :3, 6] = rigs.offsets
    return [_positions(rigs.centres - centre, size), rotations, mountings]


def _of_figures(figures: PlacedFigures, moved: FloatArray) -> FloatArray:
    """Return the changes (n, 6, 7) of the parameters of figures, from those (n, 3, 7) of their origins."""
    along = np.swapaxes(figures.axes, 1, 2)
    found = np.zeros((len(moved), 6, 7))
    found[:, SHIFTS] = along @ moved
    found[:, TILTS, 3:6] = along[:, :2]
    found[:, RADIUS, 6] = figures.radii
    return found


def _offsets(points: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """Return the centre of the points (n, 3), their offsets from it, and how many points have coordinates.

    Points whose rays do not meet may have none: their offset is zero.
    """
    centre = np.mean(points, axis=0) if len(points) else np.zeros(3)
    if np.isfinite(centre).all():
        return centre, points - centre, len(points)
    known = np.asarray(np.isfinite(points).all(axis=1))
    centre = points[known].mean(axis=0) if known.any() else np.zeros(3)
    return centre, np.where(known[:, None], points - centre, 0.0), int(np.count_nonzero(known))


def _positions(offset: FloatArray, size: float) -> FloatArray:
    """Return the changes (n, 3, 7) of positions (n, 3) about the centre."""
    result = np.empty((*offset.shape, 7))
    result[:, :, :3] = size * np.eye(3)
    result[:, :, 3:6] = -cross_matrix(offset)
    result[:, :, 6] = offset
    return result


# A similarity transformation of points and photos changes no photo coordinate, so the normal equations have a defect of
# up to seven; distances determine the scale. The system is solved with as many photo unknowns held, and corrections and
# cofactors are then transformed to the inner constraints by an S-transformation (Baarda 1973), which needs no dense
# matrix of all points. The result does not depend on which unknowns are held.

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
    block : Block
    state : BlockState
        The starting state.
    unknowns : Unknowns
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
    state : BlockState
    unknowns : Unknowns
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
    state : BlockState
    unknowns : Unknowns
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
