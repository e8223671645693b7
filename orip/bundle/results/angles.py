"""Rotations of adjusted photos by other angles, in other units."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.frames import terrestrial_from_rotation, terrestrial_rates
from orip.geometry.rotation import axes_rotation_from_angle_rates, rotation_from_angles
from orip.records.results.solution import Estimates, Solution
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

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
