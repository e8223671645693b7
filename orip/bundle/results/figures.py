"""Figures of a solution by the names that gates use."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orip.arrays import FloatArray
from orip.records.coded_names import coded
from orip.records.observation_kinds import CONTROL_POINT
from orip.records.results.solution import Solution


def figure(solution: Solution, name: str) -> float:
    """Return a figure of a solution; see `orip.records.results.tests.GATE_FIGURES` for what the names mean.

    NaN where the solution has no such figure, for instance no check points; infinite where the standard deviations
    concerned include that of an unknown that nothing determines.

    Raises
    ------
    KeyError
        If there is no figure of this name.
    """
    return float(_FIGURES[name](solution))


def _largest(values: ArrayLike) -> float:
    known = _known(values)
    return float(known.max()) if known.size else np.nan


def _root_mean_square(values: ArrayLike) -> float:
    known = _known(values)
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan


def _known(values: ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    return array[~np.isnan(array)]


def _count(chosen: NDArray[np.bool_]) -> float:
    return float(np.count_nonzero(chosen))


def _taking_part(solution: Solution) -> NDArray[np.bool_]:
    """Return which components are observations; disregarded ones have no weight factor."""
    return ~np.isnan(solution.residuals.weight_factor)


def _smallest_redundancy_number(solution: Solution) -> float:
    return -_largest(-solution.residuals.redundancy_number[_taking_part(solution)])


def _check_differences(solution: Solution) -> FloatArray:
    """Return dX, dY, dZ (n, 3)."""
    return np.array([(point.dX, point.dY, point.dZ) for point in solution.check_points]).reshape(-1, 3)


def _control_residuals(solution: Solution, components: str) -> FloatArray:
    residuals = solution.residuals
    chosen = coded(residuals.kind).where(CONTROL_POINT.name.__eq__)
    chosen &= coded(residuals.component).where(lambda component: component in components)
    return residuals.residual[chosen & _taking_part(solution)]


_FIGURES: Mapping[str, Callable[[Solution], float]] = {
    "sigma0": lambda solution: solution.sigma0,
    "sigma0_all": lambda solution: solution.sigma0_all,
    "redundancy": lambda solution: solution.redundancy,
    "redundancy_used": lambda solution: solution.redundancy_used,
    "observations": lambda solution: solution.observations,
    "unknowns": lambda solution: solution.unknowns,
    "enp": lambda solution: solution.enp,
    "iterations": lambda solution: len(solution.iterations),
    "down_weighted": lambda solution: _count(solution.residuals.weight_factor < 1.0),
    "singular": lambda solution: len(solution.singular),
    "blunders": lambda solution: len(solution.blunders),
    "diagnosis": lambda solution: len(solution.diagnosis),
    "doubted_groups": lambda solution: sum(group.doubted for group in solution.groups),
    "warnings": lambda solution: len(solution.warnings),
    "max_standard_residual": lambda solution: _largest(solution.residuals.standard_residual[_taking_part(solution)]),
    "max_abs_w": lambda solution: _largest(np.abs(solution.residuals.w)),
    "min_redundancy_number": _smallest_redundancy_number,
    "max_correlation": lambda solution: _largest([abs(pair.r) for pair in solution.correlations if " " not in pair.a]),
    "check_points.count": lambda solution: len(solution.check_points),
    "check_points.rms_xy": lambda solution: _root_mean_square(_check_differences(solution)[:, :2]),
    "check_points.rms_z": lambda solution: _root_mean_square(_check_differences(solution)[:, 2]),
    "check_points.max": lambda solution: _largest(np.abs(_check_differences(solution))),
    "control.count": lambda solution: len(_control_residuals(solution, "XYZ")),
    "control.rms_xy": lambda solution: _root_mean_square(_control_residuals(solution, "XY")),
    "control.rms_z": lambda solution: _root_mean_square(_control_residuals(solution, "Z")),
    "control.max": lambda solution: _largest(np.abs(_control_residuals(solution, "XYZ"))),
    "cameras.count": lambda solution: len(solution.cameras.names),
    "photos.count": lambda solution: len(solution.photos.names),
    "photos.max_sd": lambda solution: _largest(solution.photos.sd[:, :3]),
    "photos.max_angle_sd": lambda solution: _largest(solution.photos.sd[:, 3:]),
    "points.count": lambda solution: len(solution.points.names),
    "points.single_ray": lambda solution: int(np.count_nonzero(solution.point_rays == 1)),
    "points.max_sd": lambda solution: _largest(solution.points.sd),
    "points.rms_sd": lambda solution: _root_mean_square(solution.points.sd),
}
