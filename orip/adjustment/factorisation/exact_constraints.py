"""Precision of unknowns that exact constraints bind.

In the normal equations a constraint c x = 0 has a moderate weight, and its value is met by iterating. Cofactors of the
unknowns with constraints C (k, m) that have an infinite weight follow from any finite one: Q - S (C S)^-1 S^T with
S = Q C^T, as the weight drops out of the projection onto the null space of C (Koch 1999, section 3.2.7).
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.factorisation.symmetric import Symmetric, subtract_product
from orip.arrays import FloatArray, IntArray
from orip.structs import replace

_DEPENDENT = 1e-10
"""Constraints whose cofactors have eigenvalues below this part of the largest repeat each other."""


class ExactConstraints(Struct, frozen=True):
    """k constraints of m + 3 b unknowns, of which those of eliminated blocks take no part.

    Parameters
    ----------
    spread : array (m + 3 b, k)
        S = Q C^T, with Q from normal equations in which the constraints have any weight.
    inverse : array (k, k)
        Pseudo-inverse of C S.
    leverage : array (k,)
        Unknowns that each constraint determines: 1, less where constraints repeat each other.
    """

    spread: FloatArray
    inverse: FloatArray
    leverage: FloatArray

    def bound(self, vectors: FloatArray, right: FloatArray) -> FloatArray:
        """Return Q_c r (m + 3 b, k), with the constraints met, from the vectors Q r and the right-hand sides r."""
        return np.asarray(vectors - self.spread @ (self.inverse @ (self.spread.T @ right)))

    def at(self, columns: IntArray) -> ExactConstraints:
        """Return the constraints for vectors and right-hand sides that have only some of the unknowns (c,)."""
        return replace(self, spread=self.spread[columns])

    def bind(self, cofactor: Symmetric) -> None:
        """Subtract what the constraints determine from the cofactors of the reduced unknowns (m, m), in place."""
        spread = self.spread[: len(cofactor)]
        subtract_product(cofactor, spread @ self.inverse, spread)


def exact_constraints(design: FloatArray, spread: FloatArray) -> ExactConstraints:
    """Return constraints from their rows C (k, m + 3 b) of the design matrix and S (m + 3 b, k)."""
    cofactor = design @ spread
    symmetric = (cofactor + cofactor.T) / 2.0
    inverse = np.asarray(np.linalg.pinv(symmetric, rcond=_DEPENDENT, hermitian=True), dtype=np.float64)
    return ExactConstraints(spread, inverse, np.einsum("ij,ji->i", inverse, cofactor))
