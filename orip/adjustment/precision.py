"""Precision and reliability: cofactors of all unknowns, redundancy numbers, sigma0.

Assumes uncorrelated observations with a-priori errors, and the normal equations factored at the solution with its final
weights. Cofactors are for sigma0 = 1; a standard deviation is sigma0 times the root of a cofactor.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.equations import Equations
from orip.adjustment.factorisation.cholesky import Symmetric, scale_matrix, subtract_product
from orip.adjustment.factorisation.null_space import InnerConstraints
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray, parts
from orip.set_aside import set_aside


class Cofactors(Struct, frozen=True):
    """Cofactors (sigma0 = 1) with zero rows and columns for fixed and removed unknowns.

    Parameters
    ----------
    reduced : array, BandMatrix or DissectedMatrix (m, m)
    blocks : array (b, 3, 3)
    leverage : array (n,)
        h_i = a_i Q a_i^T of every observation equation, disregarded ones included.
    """

    reduced: Symmetric
    blocks: FloatArray
    leverage: FloatArray


class VarianceOfUnitWeight(Struct, frozen=True):
    """The figures that judge the adjustment as a whole.

    Parameters
    ----------
    sigma0 : float
        From the observations with weight factor 1, on `redundancy_used`; NaN without redundancy.
    sigma0_all : float
        From all active observations, on `redundancy`; NaN without redundancy.
    redundancy : int
        n - u + removed.
    redundancy_used : float
        Sum of the redundancy numbers of observations with weight factor 1.
    redundancy_numbers : array (n,)
        r_i = 1 - wf_i h_i; NaN for inactive observations.
    """

    sigma0: float
    sigma0_all: float
    redundancy: int
    redundancy_used: float
    redundancy_numbers: FloatArray


def cofactors(equations: Equations, normals: SolvedNormals, inner: InnerConstraints | None = None) -> Cofactors:
    """Return the cofactors of all unknowns, with inner constraints if there are any, and of all computed observations.

    With the points' rows B of the triangular factor and Q the inverse of the reduced system, a point block's cofactor
    is H^T (I + B Q B^T) H, and an observation's a Q a^T follows from its row freed of the point: a_r - a_p H^T B. Exact
    constraints touch reduced unknowns alone: with these bound, all that follows from them is.
    """
    inverse: Symmetric = normals.factor.inverse()
    scale_matrix(inverse, 1.0 / normals.scale)
    constraints = normals.constraints
    if constraints is not None:
        constraints.bind(inverse)
    amounts = None if inner is None else normals.amounts(inner)
    found = equations.rows.precision(normals.blocks, normals.coupling, inverse, amounts)
    if constraints is not None:
        found.leverage[equations.exact & equations.active] = constraints.leverage
    if amounts is not None:
        subtract_product(inverse, *amounts.factors_of_reduced())
    return Cofactors(inverse, found.blocks, set_aside(found.leverage))


def variance_of_unit_weight(
    equations: Equations, weight_factors: FloatArray, leverage: FloatArray, effective_unknowns: int
) -> VarianceOfUnitWeight:
    """Return sigma0 and the redundancy numbers.

    Parameters
    ----------
    equations : Equations
        At the solution.
    weight_factors, leverage : arrays (n,)
    effective_unknowns : int
        u without the removed ones.
    """
    active = equations.active
    numbers = 1.0 - weight_factors * leverage
    numbers[~active] = np.nan
    redundancy = int(np.count_nonzero(active)) - effective_unknowns
    used = squares_used = squares = 0.0
    for part in parts(len(numbers)):
        full = active[part] & (weight_factors[part] >= 1.0)
        of_part = np.where(equations.exact[part], 0.0, equations.residual[part] ** 2)
        used += float(np.sum(numbers[part][full]))
        squares_used += float(np.sum(of_part[full]))
        squares += float(np.sum(of_part[active[part]]))
    return VarianceOfUnitWeight(
        sigma0=_root_of_mean(squares_used, used),
        sigma0_all=_root_of_mean(squares, redundancy),
        redundancy=redundancy,
        redundancy_used=used,
        redundancy_numbers=set_aside(numbers),
    )


def residual_cofactor(redundancy_number: FloatArray, weight_factor: FloatArray) -> FloatArray:
    """Return var(v) / σ² of residuals, for sigma0 = 1.

    By propagation of errors of variance σ² through v = (A Q A^T W - I) e it is 1 + h - 2 wf h - wf (1 - wf) h² with
    h = (1 - r) / wf, which is r (r + h): r for an observation with full weight, more for a down-weighted one. What
    other down-weighted observations subtract from it, wf (1 - wf) times the square of what they share, is neglected.

    Parameters
    ----------
    redundancy_number, weight_factor : arrays (n,)
        r and wf.

    Returns
    -------
    array (n,)
        NaN where one of the two is NaN, or where the weight factor is not positive.
    """
    found = 1.0 - redundancy_number
    # the figures of an adjustment that diverged may overflow; they are printed as they are
    with np.errstate(over="ignore", invalid="ignore"):
        np.maximum(found, 0.0, out=found)
        found /= np.where(weight_factor > 0.0, weight_factor, np.nan)
        found += redundancy_number
        found *= redundancy_number
    return found


def _root_of_mean(square_sum: float, redundancy: float) -> float:
    # a redundancy that is zero within rounding gives no information about the observations
    return float(np.sqrt(square_sum / redundancy)) if redundancy > 1e-6 else float("nan")
