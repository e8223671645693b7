"""Observations that fit worse than chance explains, with the probable sizes of their errors."""

from __future__ import annotations

import math

from orip.bundle.results.misfits import suspect_rows
from orip.records.observations.observation_kinds import OBSERVATION_KINDS, unit_of_observation
from orip.records.results.solution import Residuals, Solution
from orip.report.numbers import SINGULAR, decimals_for, fixed


def suspects(solution: Solution, test_level: float | None = None) -> dict[str, list[str]]:
    """Return the observations that do not fit, the worst first, with the probable size of each component's error."""
    found: dict[str, list[str]] = {}
    for row in suspect_rows(solution, test_level).tolist():
        size, component = probable_size(solution.residuals, row), solution.residuals.component[row]
        unit = "" if size == SINGULAR else unit_of_residual(solution, row)
        text = f"{component} {size} {unit}".rstrip()
        found.setdefault(observation_of(solution.residuals, row), []).append(text.strip())
    return found


def named_observation(kind: str, photo: str, point: str) -> str:
    """Return what an observation of a kind is called."""
    if kind == "photo":
        return f"photo {photo} point {point}"
    return " ".join(part for part in (OBSERVATION_KINDS[kind].label, photo, point) if part)


def observation_of(residuals: Residuals, row: int) -> str:
    """Return what an observation is called: ``photo 101 point 12``."""
    return named_observation(residuals.kind[row], residuals.photo[row], residuals.point[row])


def probable_error(residuals: Residuals, row: int) -> float:
    """Return by how much an observation is probably off: observed minus what all others predict; NaN if not tested."""
    number = residuals.redundancy_number[row]
    return float(-residuals.residual[row] / number) if number > 0.01 else math.nan


def probable_size(residuals: Residuals, row: int) -> str:
    """Return the same as text."""
    error = probable_error(residuals, row)
    return SINGULAR if math.isnan(error) else fixed(error, decimals_for([residuals.a_priori[row]]))


def unit_of_residual(solution: Solution, row: int) -> str:
    """Return the unit of a residual."""
    residuals = solution.residuals
    return unit_of_observation(residuals.kind[row], residuals.component[row], solution.ground_unit)
