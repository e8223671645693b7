"""Redundancy numbers, normalised residuals and reliability of observations with correlated errors.

The equations of such observations are decorrelated, and belong to no single one. With T what takes residuals of the
observations to those of the equations, weight factors W and H = A Q A^T of the equations, the redundancy numbers are
the diagonal of T^-1 (I - H W) T, which for full weights is that of Qvv P. An error of one unit of an observation is d
= T e in the equations: its test is d^T v over the root of d^T K d, with K the cofactor of the residuals v; for full
weights that is P v over the root of the diagonal of P Qvv P (Baarda 1968, *A testing procedure for use in geodetic
networks*).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.correlated_rows import CorrelatedRows
from orip.bundle.results.reliability import NON_CENTRALITY
from orip.bundle.solve import SolvedBlock
from orip.records.results.solution import CorrelatedReliability

_TESTABLE = 1e-6


class CorrelatedFigures(NamedTuple):
    """Figures of the k observations of a group: their rows among all, redundancy numbers and w, and reliability."""

    rows: IntArray
    redundancy_number: FloatArray
    w: FloatArray
    reliability: tuple[CorrelatedReliability, ...]


def correlated_figures(solved: SolvedBlock) -> Iterator[CorrelatedFigures]:
    """Yield the figures of all observations with correlated errors that are in use."""
    first = 0
    for kind in solved.problem.observations:
        for group in kind.correlations():
            rows = first + group.rows
            used = solved.equations.active[rows]
            if used.any():
                yield _figures(solved, group, rows, np.flatnonzero(used), kind.rows.error[group.rows])
        first += len(kind.rows.error)


def _figures(
    solved: SolvedBlock, group: CorrelatedRows, rows: IntArray, used: IntArray, error: FloatArray
) -> CorrelatedFigures:
    whitening = group.whitening[np.ix_(used, used)]
    rows, error = rows[used], error[used]
    weight, h, unit = solved.weight_factors[rows], _cofactor(solved, rows), np.eye(len(rows))
    redundancy = unit - h * weight
    of_residuals = unit + h - h * weight - weight[:, None] * h - (h * (weight * (1.0 - weight))) @ h
    deviation = np.sqrt(np.maximum(np.einsum("ji,jk,ki->i", whitening, of_residuals, whitening), 0.0))
    response = np.einsum("ji,jk,ki->i", whitening, redundancy, whitening)
    own = np.einsum("ji,ji->i", whitening, whitening)
    tested = response > _TESTABLE * own
    response = np.where(tested, response, np.nan)
    along = np.abs(whitening.T @ solved.equations.residual[rows])
    influence = np.einsum("ji,jk,ki->i", whitening, weight[:, None] * h * weight, whitening)
    inverse = np.linalg.inv(whitening)
    adjusted = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", inverse, h, inverse), 0.0))
    detected = NON_CENTRALITY * deviation / response
    reliability = (detected * error, detected * np.sqrt(np.maximum(influence, 0.0)), adjusted * error)
    return CorrelatedFigures(
        rows,
        np.diag(inverse @ redundancy @ whitening),
        np.where(tested, along / np.where(tested, deviation * solved.deviation_scale, 1.0), np.nan),
        tuple(
            CorrelatedReliability(int(row), float(bias), float(external), float(solved.deviation_scale * sd))
            for row, bias, external, sd in zip(rows, *reliability, strict=True)
        ),
    )


def _cofactor(solved: SolvedBlock, rows: IntArray) -> FloatArray:
    """Return the cofactors (k, k) of the adjusted equations."""
    design = solved.ground_design(rows)
    columns = np.unique(design.indices).astype(np.int64)
    partials = design[:, columns].toarray()
    return np.asarray(partials @ solved.normals.solve_at(columns, np.ascontiguousarray(partials.T)))
