"""How an adjustment ended, figures of a result, gates, tests and variance components of groups."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Literal

from msgspec import Struct

Status = Literal["converged", "doubtful", "not_converged", "stopped", "not_determined"]
"""Doubtful: converged, but something contradicts it. Not determined: converged, but the observations leave free where
the block lies or how photos are turned."""

NOT_DETERMINED = frozenset({"datum", "photo-rotations"})
"""Codes of the diagnoses with which a block is not determined."""


VarianceGroupKind = Literal[
    "photo", "control", "element", "distance", "direction", "line", "plane", "cylinder", "height", "given direction",
    "terrain", "station", "attitude", "difference",
]  # fmt: skip

FIGURE_GROUPS = {
    "line": "points on lines", "plane": "points on planes", "cylinder": "points on cylinders", "height": "equal heights"
}  # fmt: skip
"""Kinds of group whose observations are distances from figures, and what they are called."""

_GROUPS = FIGURE_GROUPS | {
    "station": "exposure stations", "attitude": "attitudes of the exposure stations", "distance": "distances",
    "given direction": "given directions", "terrain": "heights on terrain",
}  # fmt: skip
_ELEMENTS = {
    "CAMERA": "observed camera parameters",
    "POINT": "observed point coordinates",
    "THEODOLITE": "observed zero directions",
}


class VarianceComponent(Struct, frozen=True):
    """The a-priori error of a group of observations as the adjustment estimates it.

    Parameters
    ----------
    of : str
        The camera of photo points; PHOTO, CAMERA, POINT or THEODOLITE of elements; else empty.
    component : str
        ``xy`` of photo points, ``XY`` or ``Z`` of control points, ``X0 Y0 Z0`` or ``OMEGA PHI KAPPA`` of elements of
        photos, ``direction`` or ``zenith``; else empty.
    number : int
        Observations that the estimate is based on: in use, and with weight factor 1.
    redundancy : float
        Sum of their redundancy numbers.
    factor, sd : float
        Estimated error over given a-priori error, and its standard deviation. NaN where the group has too little
        redundancy, or cannot be told from another one: its a-priori errors stay as they are.
    p : float
        Two-sided probability of a factor as far from 1 by chance if the given errors are right; NaN likewise.
    """

    kind: VarianceGroupKind
    of: str
    component: str
    number: int
    redundancy: float
    factor: float
    sd: float
    p: float

    @property
    def name(self) -> str:
        """Return what the group is called: ``photo points of camera CAM``, ``Z of the control points``."""
        match self.kind:
            case "photo":
                return f"photo points of camera {self.of}"
            case "control":
                return f"{', '.join(self.component)} of the control points"
            case "element" if self.of == "PHOTO":
                return "exposure stations" if self.component.startswith("X0") else "rotations of the photos"
            case "element":
                return _ELEMENTS[self.of]
            case "difference":
                return f"{'rotations' if self.component.startswith('OMEGA') else 'positions'} between exposure stations"
            case "direction":
                return "zenith angles" if self.component == "zenith" else "directions"
            case _:
                return _GROUPS[self.kind]


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
    value : float
        NaN where the solution has no such figure, infinite where an unknown is not determined.
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


GroupKind = Literal[VarianceGroupKind, "check"]

ContradictionKind = Literal["shift", "scatter", "point", "down-weighted"]
"""An error common to a group; residuals too large; one check point; too many observations that lost weight."""


class GroupTest(Struct, frozen=True):
    """A group of observations of one kind and component, and how it agrees with the others.

    Residuals are adjusted minus observed, in the unit of the observation. Probabilities are those of figures as large
    or larger by chance if the a-priori errors are right; NaN where nothing can be tested.

    Parameters
    ----------
    of : str
        The camera of photo points; PHOTO, CAMERA, POINT or THEODOLITE of elements; the strip of stations; else empty.
    component : str
        As in residuals.csv: ``x``, ``Z``, ``Z0``, ``XYZ``, ``zenith``.
    number, down_weighted : int
        Observations, and those with a weight factor below 1; 0 of a parameter of a camera that is held, which is listed
        only where it is doubted.
    redundancy : float
        Sum of the redundancy numbers of those with weight factor 1; of check points, their number.
    sigma0, p_sigma0 : float
        Root of the square sum of the standard residuals over the redundancy, of those with weight factor 1; of check
        points, with the covariances of their differences.
    mean, mean_sd, p_mean : float
        Weighted mean of the residuals. Its standard deviation takes their correlation into account; that of photo
        points is an upper bound.
    shift, shift_sd : float
        The error common to all observations that explains the mean best: observed minus what all others predict.
    worst : str
        The check point that differs most for its standard deviation, or the only observation of a group; the camera of
        a held parameter.
    worst_size, p_worst : float
        Its difference, and the probability that the largest of so many is so large; NaN except for check points.
    doubted : bool
        One of the probabilities is too small, given how many groups are tested.
    """

    kind: GroupKind
    of: str
    component: str
    number: int
    down_weighted: int
    redundancy: float
    sigma0: float
    p_sigma0: float
    mean: float
    mean_sd: float
    p_mean: float
    shift: float
    shift_sd: float
    worst: str
    worst_size: float
    p_worst: float
    doubted: bool


CommonExtent = Literal["strip", "all", "lever arm", "whole", "one", "held"]
"""What has an error in common: a group, or the stations of a strip; those of all strips, in the project's axes or in
those of the photos; all coordinates of control or of observed stations; one observation; a camera that is held."""


class CommonError(Struct, frozen=True):
    """An error common to stations in one component: a shift, or a drift each second."""

    component: str
    is_drift: bool
    size: float
    sd: float


class CommonCause(Struct, frozen=True):
    """What may be wrong in place of something else; see `Contradiction`."""

    group: GroupTest
    extent: CommonExtent
    components: tuple[str, ...]


class Contradiction(Struct, frozen=True):
    """What contradicts all other observations.

    Parameters
    ----------
    groups : tuple of GroupTest
        Of a shift there are several where they cannot be told apart.
    p : float
        Probability of so much or more by chance.
    shift, shift_sd : float
        The error common to the first group that all other observations and the check points suggest; NaN unless `what`
        is a shift on the ground.
    common : tuple of CommonError
        Of stations, or of all coordinates of control: their shift in these components, and their drift if they have
        one.
    extent : CommonExtent
        Of these.
    alternatives : tuple of CommonCause
        Errors in common that explain the same misfit about as well.
    """

    what: ContradictionKind
    groups: tuple[GroupTest, ...]
    p: float
    shift: float = math.nan
    shift_sd: float = math.nan
    common: tuple[CommonError, ...] = ()
    extent: CommonExtent = "strip"
    alternatives: tuple[CommonCause, ...] = ()


Quantity = Literal["ground", "angle", "photo", "other", "text"]
"""Ground coordinate; angle in degrees; C, DX or DY in mm; any other number; a word."""


class Figure(Struct, frozen=True):
    """One figure.

    Parameters
    ----------
    value : float, str or None
        None where the result has null.
    sd : float or None
        Its standard deviation, None where it has none.
    adjusted : bool
        It is the value of an unknown or constant, not a measure of quality.
    effect : float
        Effect of one unit of it on a photo coordinate 10 mm from the principal point, mm; 1 unless it is a coefficient.
    """

    value: float | str | None
    quantity: Quantity
    sd: float | None = None
    adjusted: bool = False
    effect: float = 1.0


class FigureGroup(Struct, frozen=True):
    """Figures that belong to one thing, by name.

    Parameters
    ----------
    name : str
        As it is shown, e.g. ``photo st1``; empty for figures of the whole adjustment.
    figures : mapping of str to Figure
    """

    name: str
    figures: Mapping[str, Figure]


ResultFigures = Mapping[tuple[str, str], FigureGroup]
"""The figures of a result by kind of thing and name; names of cameras and photos by `record_key`."""
