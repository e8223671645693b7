"""How movements of a whole block change its unknowns: three shifts, three rotations and the scale."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.bundle.rigs.starting import RigState
from orip.bundle.state import RADIUS, SHIFTS, TILTS, BlockState, PlacedFigures, entries_at
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rotation import angle_rates_from_axes_rotation, cross_matrix
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
