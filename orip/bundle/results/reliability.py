"""Reliability: the smallest error that a test detects, its effect; what fits worse than chance explains.

The equations of correlated observations are decorrelated, and belong to no single one. With T what takes residuals of
the observations to those of the equations, weight factors W and H = A Q A^T of the equations, the redundancy numbers
are the diagonal of T^-1 (I - H W) T, which for full weights is that of Qvv P. An error of one unit of an observation is
d = T e in the equations: its test is d^T v over the root of d^T K d, with K the cofactor of the residuals v; for full
weights that is P v over the root of the diagonal of P Qvv P (Baarda 1968, *A testing procedure for use in geodetic
networks*).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import astuple

from orip.adjustment.outlier_tests import OutlierTest
from orip.adjustment.precision import residual_cofactor
from orip.arrays import BoolArray, FloatArray, IntArray, parts
from orip.bundle.correlated_rows import CorrelatedRows
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.solve import SolvedBlock
from orip.records.results.solution import CorrelatedReliability, Reliability, Residuals, Solution
from orip.set_aside import set_aside
from orip.structs import remembered
from orip.threads import by_threads

# One may be a blunder. Where most rays of a photo or of the control points are lost, the solution is not that of the
# block that was measured, however well the rest fits.


_MOST = 0.5


def lost_rays(solved: SolvedBlock) -> BoolArray:
    """Return which of the block's photo points (n,) are used, but lie behind their camera."""
    start = 0
    for kind in solved.problem.observations:
        rows = slice(start, start + len(kind.rows.used))
        start = rows.stop
        if isinstance(kind, PhotoPointObservations):
            active = solved.equations.active[rows]
            if active.all():  # mostly
                return np.zeros(len(kind.point), dtype=bool)
            idle = kind.rows.used & ~active
            if solved.problem.excluded is not None:
                idle &= ~solved.problem.excluded[rows]
            return np.asarray(idle.reshape(-1, 2).any(axis=1))
    return np.zeros(0, dtype=bool)


def lost_control(solved: SolvedBlock) -> tuple[str, ...]:
    """Return the control points none of whose used rays has an influence; empty unless they are the majority."""
    block, lost = solved.block, lost_rays(solved)
    if not lost.any():
        return ()
    points = block.photo_points
    used = points.partly_in_use
    rays = np.bincount(points.point[used], minlength=len(block.point_names))
    gone = np.bincount(points.point[lost], minlength=len(block.point_names))
    place = block.point_index()
    control = [point.name for point in block.control_points if point.kind == "control" and rays[place[point.name]]]
    found = tuple(name for name in control if gone[place[name]] == rays[place[name]])
    return found if len(found) > _MOST * len(control) else ()


def lost_photos(solved: SolvedBlock) -> tuple[str, ...]:
    """Return the photos behind which most of their points lie."""
    block, lost = solved.block, lost_rays(solved)
    if not lost.any():
        return ()
    points = block.photo_points
    used = np.bincount(points.photo[points.partly_in_use], minlength=len(block.photos))
    gone = np.bincount(points.photo[lost], minlength=len(block.photos))
    return tuple(photo.name for row, photo in enumerate(block.photos) if gone[row] > _MOST * used[row])


NON_CENTRALITY = 4.132
"""Shift of a normalised residual that a test with error probability 0.001 finds with probability 0.80 (Baarda 1968)."""

_TESTABLE = 1e-6


def reliability(residuals: Residuals, deviation_scale: float) -> Reliability:
    """Return the reliability of observations from their redundancy numbers.

    Parameters
    ----------
    deviation_scale : float
        sigma0, or 1 without redundancy.

    Returns
    -------
    Reliability
        Internal: 4.13 a sqrt(q) / r, with a the a-priori error and q = var(v) / a² (`residual_cofactor`). External:
        4.13 wf sqrt(h q) / r, the influence of such an error on any function of the unknowns, in units of its standard
        deviation, with h = (1 - r) / wf. With full weight they are 4.13 a / sqrt(r) and 4.13 sqrt((1 - r) / r). The
        deviation of the adjusted observation is sigma0 a sqrt(h).
    """
    found = Reliability(*np.empty((3, len(residuals.redundancy_number))))

    def put(part: slice) -> None:
        number, weight_factor = residuals.redundancy_number[part], residuals.weight_factor[part]
        a_priori = residuals.a_priori[part]
        testable = np.where(number > _TESTABLE, number, np.nan)
        share = np.clip(1.0 - number, 0.0, None)
        factor = np.where(weight_factor > 0.0, weight_factor, np.nan)
        # the figures of an adjustment that diverged may overflow; they are printed as they are
        with np.errstate(over="ignore", invalid="ignore"):
            detected = NON_CENTRALITY * np.sqrt(residual_cofactor(testable, factor)) / testable
            np.multiply(a_priori, detected, out=found.minimal_detectable_bias[part])
            np.multiply(detected, np.sqrt(factor * share), out=found.external[part])
            np.multiply(deviation_scale * a_priori, np.sqrt(share / factor), out=found.adjusted_sd[part])

    by_threads(put, parts(len(residuals.redundancy_number)))
    return Reliability(*map(set_aside, astuple(found)))


def reliability_of(solution: Solution) -> Reliability:
    """Return the reliability of the observations of a solution."""
    found = reliability(solution.residuals, solution.sigma0 if np.isfinite(solution.sigma0) else 1.0)
    if solution.correlated:
        found = Reliability(*(np.array(values) for values in astuple(found)))
    for one in solution.correlated:
        found.minimal_detectable_bias[one.row] = one.minimal_detectable_bias
        found.external[one.row] = one.external
        found.adjusted_sd[one.row] = one.adjusted_sd
    return found


FAMILY_ALPHA = 0.05
"""Probability that anything is listed as misfitting in a block without blunders."""

_LARGEST_ALPHA = 0.001
"""Error probability of one normalised residual in a block of few observations."""


def suspicious_w(solution: Solution, test_level: float | None = None) -> float:
    """Return the limit of normalised residuals.

    Parameters
    ----------
    test_level : float or None
        Error probability of one test, as it is classical; None: the limit grows with the number of tests, so that that
        of all together is `FAMILY_ALPHA`.
    """
    residuals = solution.residuals
    tested = int(np.count_nonzero(np.isfinite(residuals.w) & (residuals.weight_factor > 0.0)))
    alpha = min(FAMILY_ALPHA / max(tested, 1), _LARGEST_ALPHA) if test_level is None else test_level
    return OutlierTest(alpha, 1.0, max(solution.redundancy, 0)).limit()


def suspect_rows(solution: Solution, test_level: float | None = None) -> IntArray:
    """Return the rows of the observations that fit worse than chance explains, the worst first.

    All components are listed that have lost weight together with one that does not fit.
    """
    residuals = solution.residuals
    down, misfit = residuals.weight_factor < 1.0, _misfit(solution, test_level)
    names = _observations(residuals, np.flatnonzero(misfit))
    beside = [row for row in np.flatnonzero(down & ~misfit).tolist() if _key(residuals, row) in names]
    rows = np.concatenate([np.flatnonzero(misfit), np.array(beside, dtype=np.int64)])
    rows = np.sort(rows)
    w = residuals.w[rows]
    size = np.where(np.isnan(w), residuals.standard_residual[rows], np.abs(w))
    return np.asarray(rows[np.argsort(-size, kind="stable")])


def number_by_chance(solution: Solution, test_level: float | None = None) -> int:
    """Return how many observations have lost weight although they fit as well as chance explains."""
    residuals = solution.residuals
    names = _observations(residuals, np.flatnonzero(residuals.weight_factor < 1.0))
    return len(names - _observations(residuals, suspect_rows(solution, test_level)))


def has_suspects(solution: Solution) -> bool:
    """Tell whether any observation fits worse than chance explains."""
    return bool(_misfit(solution, None).any())


@remembered
def _misfit(solution: Solution, test_level: float | None) -> BoolArray:
    """Return which residuals are too large for chance; those that nothing tests if they have lost weight."""
    residuals = solution.residuals
    untested = np.isnan(residuals.w) & (residuals.weight_factor < 1.0)
    too_large = np.abs(residuals.w) > suspicious_w(solution, test_level)
    return np.asarray(untested | (too_large & (residuals.weight_factor > 0.0)))


def _observations(residuals: Residuals, rows: IntArray) -> set[tuple[str, str, str]]:
    return {_key(residuals, row) for row in rows.tolist()}


def _key(residuals: Residuals, row: int) -> tuple[str, str, str]:
    return residuals.kind[row], residuals.photo[row], residuals.point[row]


_TESTABLE_RESPONSE = 1e-6


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
                yield _figures_of_group(solved, group, rows, np.flatnonzero(used), kind.rows.error[group.rows])
        first += len(kind.rows.error)


def _figures_of_group(
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
    tested = response > _TESTABLE_RESPONSE * own
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
