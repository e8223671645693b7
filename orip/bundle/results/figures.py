"""Figures of a solution by the names that gates use, and rotations of its photos by other angles, in other units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orip.arrays import FloatArray
from orip.geometry.frames import terrestrial_from_rotation, terrestrial_rates
from orip.geometry.rotation import axes_rotation_from_angle_rates, rotation_from_angles
from orip.records.coded_names import coded
from orip.records.observation_kinds import CONTROL_POINT
from orip.records.results.solution import Estimates, Solution
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE


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


AngleSystem = Literal["omega-phi-kappa", "alpha-zeta-kappa"]
AngleUnit = Literal["degree", "gon", "radian"]

UNITS_PER_RADIAN: Final[Mapping[AngleUnit, float]] = MappingProxyType(
    {"degree": 180.0 / np.pi, "gon": 200.0 / np.pi, "radian": 1.0}
)


def with_angles(solution: Solution, system: AngleSystem, unit: AngleUnit) -> Solution:
    """Return a solution whose photos have other angles in the place of omega, phi and kappa, in a unit.

    Standard deviations of alpha, zeta and kappa follow from those of omega, phi and kappa and their correlations; they
    are NaN where these are not known, and where a photo looks straight up or down.
    """
    photos = solution.photos
    angles, deviations = photos.values[:, 3:] * RADIANS_PER_DEGREE, photos.sd[:, 3:] * RADIANS_PER_DEGREE
    about_axes = solution.photo_rotation_sd_about_axes
    if system == "alpha-zeta-kappa":
        rotations = rotation_from_angles(angles)
        angles = terrestrial_from_rotation(rotations)
        deviations = _deviations_of_terrestrial(solution, angles)
        about_axes = (False,) * len(about_axes)
    per_radian = UNITS_PER_RADIAN[unit]
    found = Estimates(
        photos.names,
        np.hstack([photos.values[:, :3], angles * per_radian]),
        np.hstack([photos.sd[:, :3], deviations * per_radian]),
    )
    return replace(solution, photos=found, photo_rotation_sd_about_axes=about_axes)


def _deviations_of_terrestrial(solution: Solution, terrestrial: FloatArray) -> FloatArray:
    """Return the standard deviations (n, 3) of alpha, zeta and kappa, radians."""
    sd = solution.photos.sd[:, 3:] * RADIANS_PER_DEGREE
    found = np.full_like(sd, np.nan)
    if len(solution.photo_correlations) != len(sd):
        return found
    place = {pair: n for n, pair in enumerate((a, b) for b in range(6) for a in range(b))}
    for row, deviation in enumerate(sd):
        known = np.isfinite(deviation).all() and abs(np.cos(terrestrial[row, 1])) > 1e-6
        correlations = solution.photo_correlations[row]
        matrix = np.eye(3)
        for a, b in ((0, 1), (0, 2), (1, 2)):
            matrix[a, b] = matrix[b, a] = correlations[place[a + 3, b + 3]]
        if not (known and np.isfinite(matrix).all()):
            continue
        covariance = matrix * np.outer(deviation, deviation)
        rates = terrestrial_rates(terrestrial[row][None])[0]
        if not solution.photo_rotation_sd_about_axes[row]:
            angles = solution.photos.values[row, 3:] * RADIANS_PER_DEGREE
            rates = rates @ axes_rotation_from_angle_rates(angles)
        found[row] = np.sqrt(np.diag(rates @ covariance @ rates.T))
    return found
