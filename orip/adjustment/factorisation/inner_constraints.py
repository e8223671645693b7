"""Inner constraints of a free network, and the S-transformation of cofactors to them (Baarda 1973).

G (u, d) are the movements of all u unknowns that nothing determines, combined so that B^T G = I; B is G in the rows of
the coordinates that define the datum, and zero elsewhere. The unknowns x of a solution with any d of them held contain
the amounts t = B^T x of the movements; x - G t meets the inner constraints. Its cofactors are S Q S^T, S = I - G B^T,
of which only those elements are formed that are asked for:

    Q - G Z^T - Z G^T,  Z = Q_xt - G Q_tt / 2,  Q_xt = Q B,  Q_tt = B^T Q B

A point p that is eliminated, with the rows H and C = H N_pr of the triangular factor, has Q_pt = H^T (H B_p - C Q_rt)
with the reduced unknowns r: neither Q B of all points nor another solution is needed. Residuals and leverages of
observations do not depend on the datum.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace


class PointMovements(Struct, frozen=True):
    """d movements of b eliminated points: each changes a coordinate by a linear function of homogeneous coordinates.

    Parameters
    ----------
    homogeneous : array (b, 4)
    coefficients : array (3, d, 4)
        Of each coordinate.
    free, defining : arrays (b, 3) of bool
        Which coordinates are unknowns, and which of these define the datum.
    """

    homogeneous: FloatArray
    coefficients: FloatArray
    free: BoolArray
    defining: BoolArray

    def of(self, points: IntArray) -> PointMovements:
        """Return the movements of some points (k,)."""
        return replace(
            self, homogeneous=self.homogeneous[points], free=self.free[points], defining=self.defining[points]
        )

    def combined(self, combinations: FloatArray) -> PointMovements:
        """Return combinations (d, e) of the movements."""
        return replace(self, coefficients=np.einsum("adh,de->aeh", self.coefficients, combinations))

    def rows(self) -> FloatArray:
        """Return the rows (b, 3, d) of G."""
        moved = np.stack([self.homogeneous @ table.T for table in self.coefficients], axis=1)
        return np.asarray(np.where(self.free[:, :, None], moved, 0.0))

    def defining_rows(self) -> FloatArray:
        """Return the rows (b, 3, d) of B."""
        return np.asarray(np.where(self.defining[:, :, None], self.rows(), 0.0))


class InnerConstraints(Struct, frozen=True):
    """G and B of a free network.

    Parameters
    ----------
    reduced, reduced_defining : arrays (m, d)
        Rows of the reduced unknowns in G and B.
    points : PointMovements
    """

    reduced: FloatArray
    reduced_defining: FloatArray
    points: PointMovements

    def defining_rows(self) -> FloatArray:
        """Return B (m + 3 b, d)."""
        d = self.reduced.shape[1]
        return np.vstack([self.reduced_defining, self.points.defining_rows().reshape(-1, d)])


class MovementSums(NamedTuple):
    """What eliminated points contribute to the amounts of d movements.

    Attributes
    ----------
    reduced : array (m, d)
        C^T H B_p.
    own : array (d, d)
        B_p^T H^T H B_p.
    """

    reduced: FloatArray
    own: FloatArray


class Amounts(Struct, frozen=True):
    """Cofactors of the amounts of d movements, combined so that these have no covariances.

    Parameters
    ----------
    reduced : array (m, d)
        Rows of the reduced unknowns in G.
    points : PointMovements
    with_reduced : array (m, d)
        Q_rt.
    own : array (d,)
        The diagonal of Q_tt.
    """

    reduced: FloatArray
    points: PointMovements
    with_reduced: FloatArray
    own: FloatArray

    def of(self, reduced: IntArray, points: IntArray) -> Amounts:
        """Return those with some of the reduced unknowns and of the points."""
        return Amounts(self.reduced[reduced], self.points.of(points), self.with_reduced[reduced], self.own)

    def transform_blocks(self, blocks: FloatArray, half: FloatArray, coupling: csr_array) -> None:
        """Transform cofactors (b, 3, 3) of the points, in place, with H (b, 3, 3) and C (3 b, m)."""
        moved = self.points.rows()
        with_amounts = half @ self.points.defining_rows() - (coupling @ self.with_reduced).reshape(moved.shape)
        z = np.swapaxes(half, 1, 2) @ with_amounts - moved * self.own / 2.0
        product = moved @ np.swapaxes(z, 1, 2)
        blocks -= product
        blocks -= np.swapaxes(product, 1, 2)

    def factors_of_reduced(self) -> tuple[FloatArray, FloatArray]:
        """Return L and R (m, 2 d): the transformed cofactors of the reduced unknowns are Q_rr - L R^T."""
        z = self.with_reduced - self.reduced * self.own / 2.0
        return np.hstack([self.reduced, z]), np.hstack([z, self.reduced])


def movement_sums(points: PointMovements, half: FloatArray, coupling: csr_array) -> MovementSums:
    """Return what points contribute, with H (b, 3, 3) and C (3 b, m)."""
    rows = half @ points.defining_rows()
    flat = rows.reshape(-1, rows.shape[2])
    return MovementSums(np.asarray(coupling.T @ flat), flat.T @ flat)
