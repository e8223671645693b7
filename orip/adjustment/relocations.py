"""Whether the robust cost is lower with a block at another place."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter

import numpy as np
from msgspec import Struct

from orip.adjustment.equations import Equations, Layout, OtherPlace
from orip.adjustment.normals import SolvedNormals
from orip.adjustment.weights import danish_costs
from orip.arrays import FloatArray, IntArray
from orip.structs import replace

# The observations of a block act on the reduced unknowns by the combinations C of their rows that are free of it: with
# weighted rows R of reduced unknowns and B of the block, C = Q^T R and c = Q^T v, where the columns of Q span what is
# orthogonal to B. At another place these are others. With U both of them below each other, s = -1 for the old ones and
# 1 for the new ones, and H = U N^-1 U^T, the square sum changes by
#
#     c^T s c - d^T (H - H (s + H)^-1 H) d,  d = s c
#
# (Sherman, Morrison and Woodbury). Exact where the reduced unknowns are linear; the block itself may move anywhere.


class _Freed(Struct, frozen=True):
    """Combinations of observations that are free of their block: rows (k - 3, m) and residuals (k - 3,)."""

    rows: FloatArray
    residual: FloatArray


class Relocation(Struct, frozen=True):
    """A block at another place.

    Parameters
    ----------
    place : OtherPlace
    change : float
        Of the robust cost.
    """

    place: OtherPlace
    change: float
    old: _Freed
    new: _Freed


class Relocations(Struct, frozen=True):
    """Blocks at other places.

    Parameters
    ----------
    single : sequence of Relocation
    remaining : array (m + 3 b,)
        The correction without them.
    normals : SolvedNormals
    """

    single: Sequence[Relocation]
    remaining: FloatArray
    normals: SolvedNormals

    def by_cost(self, most: float) -> list[Relocation]:
        """Return those by which the cost changes by less than `most`, the lowest first."""
        return sorted((one for one in self.single if one.change < most), key=attrgetter("change"))

    def of_different_blocks(self, most: float) -> list[Relocation]:
        """Return the best one of each block by which the cost changes by less than `most`."""
        best = {one.place.columns.tobytes(): one for one in reversed(self.by_cost(most))}
        return list(best.values())

    def correction(self, chosen: Sequence[Relocation]) -> FloatArray:
        """Return the correction (m + 3 b,) that leads to all of the chosen ones together."""
        moved = self.remaining.copy()
        for one in chosen:
            both = np.vstack([one.old.rows, one.new.rows])
            on_blocks = np.zeros((len(self.remaining) - both.shape[1], len(both)))
            spread = self.normals.solve(np.vstack([both.T, on_blocks]))
            pull, inner = _pulls(one.old, one.new, both @ spread[: both.shape[1]])
            moved -= spread @ (pull - inner)
        for one in chosen:
            place = one.place
            root = np.sqrt(place.weights)
            there = place.residual + place.reduced @ moved[: place.reduced.shape[1]]
            own, *_ = np.linalg.lstsq(place.own * root[:, None], -root * there, rcond=None)
            moved[place.columns] = place.move + own
        return moved


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
    equations : Equations
        With the design matrix of the normal equations, and the groups that the cost has.
    weights : array (n,)
        Of the normal equations.
    limit : float
        Standard residual up to which an observation has full weight.
    """
    right = equations.design.T @ (equations.effective(weights) * equations.residual)
    remaining = -normals.solve(right[:, None])[:, 0]
    reduced, of_reduced = layout.reduced, remaining[: layout.reduced]
    blocks: dict[bytes, tuple[_Freed, float]] = {}
    found = []
    for place in places:
        rows, key = place.rows, place.columns.tobytes()
        if key not in blocks:
            design, before = equations.design[rows].toarray(), equations.residual[rows]
            freed = _freed(design[:, :reduced], design[:, place.columns], before, weights[rows], of_reduced)
            blocks[key] = freed, _beyond_squares(before, weights[rows], _groups(equations, rows), limit)
        old, beyond = blocks[key]
        new = _freed(place.reduced, place.own, place.residual, place.weights, of_reduced)
        # there what keeps its weight has to fit
        none = place.weights < 1.0
        groups = _groups(equations, rows[none])
        more = _beyond_squares(place.residual[none], place.weights[none], groups, limit) - beyond
        found.append(Relocation(place, more, old, new))
    return Relocations(_with_square_sums(found, normals), remaining, normals)


def _with_square_sums(found: Sequence[Relocation], normals: SolvedNormals) -> list[Relocation]:
    """Return relocations whose change of the cost has that of half the square sum, too."""
    rows = np.vstack([part.rows for one in found for part in (one.old, one.new)])
    spread = normals.factor.reduce(rows.T / normals.scale[:, None])
    complete, first = [], 0
    for one in found:
        sign, residual = _both(one.old, one.new)
        own = spread[:, first : first + len(sign)]
        first += len(sign)
        effect = own.T @ own
        pull, inner = _pulls(one.old, one.new, effect)
        square_sum = float(sign @ residual**2 - (effect @ pull) @ (pull - inner))
        complete.append(replace(one, change=one.change + square_sum / 2.0))
    return complete


def _both(old: _Freed, new: _Freed) -> tuple[FloatArray, FloatArray]:
    """Return s and c."""
    sign = np.repeat([-1.0, 1.0], [len(old.residual), len(new.residual)])
    return sign, np.concatenate([old.residual, new.residual])


def _pulls(old: _Freed, new: _Freed, effect: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return d and (s + H)^-1 H d."""
    sign, residual = _both(old, new)
    pull = sign * residual
    return pull, np.asarray(np.linalg.solve(np.diag(sign) + effect, effect @ pull), dtype=np.float64)


def _freed(
    reduced: FloatArray, own: FloatArray, residual: FloatArray, weights: FloatArray, remaining: FloatArray
) -> _Freed:
    """Return the weighted combinations free of the block, after what remains of the reduced unknowns, array (m,)."""
    root = np.sqrt(weights)
    complete, _ = np.linalg.qr(own * root[:, None], mode="complete")
    free = (complete[:, 3:] * root[:, None]).T
    rows = free @ reduced
    return _Freed(rows, free @ residual + rows @ remaining)


def changed_weights(chosen: Sequence[Relocation], weights: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the observations that get full weight, and those that lose theirs, of the weights (n,)."""
    rows = np.concatenate([one.place.rows for one in chosen])
    there = np.concatenate([one.place.weights for one in chosen])
    return rows[(there >= 1.0) & (weights[rows] < 1.0)], rows[(there < 1.0) & (weights[rows] >= 1.0)]


def _groups(equations: Equations, rows: IntArray) -> IntArray:
    """Return in which group each of some observations (k,) loses weight; alone where there are none."""
    alone = np.arange(len(rows))
    if equations.groups is None:
        return alone
    groups = equations.groups[rows]
    _, numbers = np.unique(np.where(groups < 0, -1 - alone, groups), return_inverse=True)
    return np.asarray(numbers)


def _beyond_squares(residual: FloatArray, weights: FloatArray, groups: IntArray, limit: float) -> float:
    """Return what residuals (k,) cost beyond half of their weighted square sum; those of a group together."""
    sizes = np.sqrt(np.bincount(groups, residual**2))
    return float(np.sum(danish_costs(sizes, limit)) - np.sum(weights * residual**2) / 2.0)
