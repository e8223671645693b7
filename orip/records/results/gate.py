"""Gates: conditions that the figures of a solution have to meet, such as ``sigma0 <= 1.5``."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Literal

from msgspec import Struct

GateOperator = Literal["<=", ">=", "==", "!=", "<", ">"]

OPERATORS: Mapping[GateOperator, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}

GATE_FIGURES: Mapping[str, str] = {
    "sigma0": "standard error of unit weight",
    "sigma0_all": "the same over all observations, none down-weighted",
    "redundancy": "observations minus unknowns",
    "redundancy_used": "share of the redundancy that sigma0 is based on",
    "observations": "observation equations",
    "unknowns": "unknowns, removed ones included",
    "enp": "exponent of numerical precision at the end",
    "iterations": "iterations",
    "down_weighted": "observation components with a weight factor < 1",
    "singular": "unknowns that nothing determines",
    "blunders": "observations found to be wrong",
    "diagnosis": "weaknesses that were diagnosed",
    "doubted_groups": "groups of observations that contradict the others",
    "warnings": "warnings",
    "max_standard_residual": "largest residual over its a-priori error",
    "max_abs_w": "largest normalised residual",
    "min_redundancy_number": "smallest redundancy number of an observation",
    "max_correlation": "largest |correlation| of two camera parameters",
    "check_points.count": "check points that were compared",
    "check_points.rms_xy": "RMS of their dX and dY (of n points: divisor 2n)",
    "check_points.rms_z": "RMS of their dZ",
    "check_points.max": "largest |dX|, |dY| or |dZ|",
    "control.count": "control coordinates that are observations",
    "control.rms_xy": "RMS of their residuals in X and Y",
    "control.rms_z": "RMS of their residuals in Z",
    "control.max": "largest |residual| of them",
    "cameras.count": "cameras",
    "photos.count": "photos",
    "photos.max_sd": "largest sd of X0, Y0 or Z0",
    "photos.max_angle_sd": "largest sd of an angle, degrees",
    "points.count": "ground points",
    "points.single_ray": "points seen by one ray",
    "points.max_sd": "largest sd of X, Y or Z",
    "points.rms_sd": "RMS of the sd of X, Y and Z of all points",
}
"""Names and meanings of the figures that a gate may be about.

Lengths on the ground are in the project's unit; sd is a standard deviation, RMS a root mean square.
"""

_LARGEST_COUNT = 1e15
"""Whole numbers below it are shown with all their digits, as counts are."""


class Gate(Struct, frozen=True):
    """A condition: the figure `name` compared with `limit` by `operator`."""

    name: str
    operator: GateOperator
    limit: float

    def __str__(self) -> str:
        """Return it as it is written, with blanks."""
        return f"{self.name} {self.operator} {self.limit:.15g}"

    def holds(self, value: float) -> bool:
        """Tell whether a value meets the condition; one that is not finite meets none."""
        return math.isfinite(value) and OPERATORS[self.operator](value, self.limit)


class GateResult(Struct, frozen=True):
    """What a gate finds in a solution.

    Parameters
    ----------
    gate : Gate
    value : float
        NaN where the solution has no such figure, infinite where an unknown is not determined.
    passed : bool
    reason : str
        Why there is no value to compare; empty where there is one.
    """

    gate: Gate
    value: float
    passed: bool
    reason: str = ""

    def __str__(self) -> str:
        """Return ``pass sigma0 <= 1.5 (0.98)``, or the same with ``FAIL``."""
        return f"{'pass' if self.passed else 'FAIL'} {self.gate} ({self.reason or self._shown_value()})"

    def _shown_value(self) -> str:
        if self.value.is_integer() and abs(self.value) < _LARGEST_COUNT:
            return f"{self.value:.0f}"
        # as few digits as will not contradict the verdict
        texts = (f"{self.value:.{digits}g}" for digits in range(4, 18))
        return next((text for text in texts if self.gate.holds(float(text)) == self.passed), repr(self.value))
