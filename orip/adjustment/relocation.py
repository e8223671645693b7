"""Relocation: whether the robust cost is lower with a block at another place, where others of its observations fit.

The observations of a block act on the reduced unknowns by the combinations C of their rows that are free of it: with
weighted rows R of reduced unknowns and B of the block, C = Q^T R and c = Q^T v, where the columns of Q span what is
orthogonal to B. At another place these are others. With U both of them below each other, s = -1 for the old ones and 1
for the new ones, and H = U N^-1 U^T, the square sum changes by

    c^T s c - d^T (H - H (s + H)^-1 H) d,  d = s c

(Sherman, Morrison and Woodbury). Exact where the reduced unknowns are linear; the block itself may move anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from orip.adjustment.equations import Equations, Layout, OtherPlace
from orip.adjustment.normals import SolvedNormals
from orip.adjustment.weights import danish_costs
from orip.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Relocation:
    """A block at another place.

    Parameters
    ----------
    place : OtherPlace
    change : float
        Of the robust cost.
    correction : array (m + 3 b,)
        That leads there, with what remains of the other unknowns.
    """

    place: OtherPlace
    change: float
    correction: FloatArray


@dataclass(frozen=True, slots=True)
class Relocations:
    """Blocks at other places.

    Parameters
    ----------
    single : sequence of Relocation
    remaining : array (m + 3 b,)
        The correction without them.
    """

    single: Sequence[Relocation]
    remaining: FloatArray

    def by_cost(self, most: float) -> list[Relocation]:
        """Return those by which the cost changes by less than `most`, the lowest first."""
        return sorted((one for one in self.single if one.change < most), key=attrgetter("change"))

    def of_different_blocks(self, most: float) -> list[Relocation]:
        """Return the best one of each block by which the cost changes by less than `most`."""
        best = {one.place.columns.tobytes(): one for one in reversed(self.by_cost(most))}
        return list(best.values())

    def correction(self) -> FloatArray:
        """Return the correction (m + 3 b,) of all together."""
        moved = self.remaining.copy()
        for one in self.single:
            moved += one.correction - self.remaining
        return moved

    def changed(self, weights: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the observations that get full weight, and those that lose theirs, of the weights (n,)."""
        rows = np.concatenate([one.place.rows for one in self.single])
        there = np.concatenate([one.place.weights for one in self.single])
        return rows[(there >= 1.0) & (weights[rows] < 1.0)], rows[(there < 1.0) & (weights[rows] >= 1.0)]


def relocations(
    places: Sequence[OtherPlace],
    equations: Equations,
    weights: FloatArray,
    normals: SolvedNormals,
    layout: Layout,
    limit: float,
) -> Relocations:
    """Return what becomes of the robust cost with blocks at other places.

    Parameters
    ----------
    places : sequence of OtherPlace
    equations : Equations
        With the design matrix of the normal equations.
    weights : array (n,)
        Of the normal equations.
    normals : SolvedNormals
    layout : Layout
    limit : float
        Standard residual up to which an observation has full weight.
    """
    right = equations.design.T @ (np.where(equations.active, weights, 0.0) * equations.residual)
    remaining = -normals.solve(right[:, None])[:, 0]
    single = [_relocation(place, equations, weights, normals, layout, limit, remaining) for place in places]
    return Relocations(single, remaining)


def _relocation(
    place: OtherPlace,
    equations: Equations,
    weights: FloatArray,
    normals: SolvedNormals,
    layout: Layout,
    limit: float,
    remaining: FloatArray,
) -> Relocation:
    rows = place.rows
    old = _freed(equations.design[rows].toarray(), equations.residual[rows], weights[rows], place, layout, remaining)
    new = _freed(place.design, place.residual, place.weights, place, layout, remaining)
    sign = np.repeat([-1.0, 1.0], [len(old.residual), len(new.residual)])
    residual, both = np.concatenate([old.residual, new.residual]), np.vstack([old.rows, new.rows])
    spread = normals.solve(np.vstack([both.T, np.zeros((3 * layout.blocks, len(both)))]))
    effect = both @ spread[: layout.reduced]
    pull = sign * residual
    along = effect @ pull
    inner = np.linalg.solve(np.diag(sign) + effect, along)
    square_sum = float(sign @ residual**2 - pull @ along + along @ inner)
    correction = remaining - spread @ (pull - inner)
    correction[place.columns] = 0.0
    there = place.residual + place.design @ correction
    root = np.sqrt(place.weights)
    own = place.design[:, place.columns] * root[:, None]
    moved, *_ = np.linalg.lstsq(own, -root * there, rcond=None)
    correction[place.columns] = place.move + moved
    # there what keeps its weight has to fit
    none, before = place.weights < 1.0, equations.residual[rows]
    more = _beyond_squares(place.residual[none], place.weights[none], limit)
    return Relocation(place, square_sum / 2.0 + more - _beyond_squares(before, weights[rows], limit), correction)


@dataclass(frozen=True, slots=True)
class _Freed:
    """Combinations of observations that are free of their block: rows (k - 3, m) and residuals (k - 3,)."""

    rows: FloatArray
    residual: FloatArray


def _freed(
    design: FloatArray,
    residual: FloatArray,
    weights: FloatArray,
    place: OtherPlace,
    layout: Layout,
    remaining: FloatArray,
) -> _Freed:
    """Return the weighted combinations free of the block, after the correction that remains to be made."""
    root = np.sqrt(weights)
    reduced = design[:, : layout.reduced]
    complete, _ = np.linalg.qr(design[:, place.columns] * root[:, None], mode="complete")
    free = (complete[:, 3:] * root[:, None]).T
    rows = free @ reduced
    return _Freed(rows, free @ residual + rows @ remaining[: layout.reduced])


def _beyond_squares(residual: FloatArray, weights: FloatArray, limit: float) -> float:
    """Return what residuals (k,) cost beyond half of their weighted square sum."""
    return float(np.sum(danish_costs(np.abs(residual), limit) - weights * residual**2 / 2.0))
