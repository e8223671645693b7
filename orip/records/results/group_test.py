"""Tests of groups of observations: whether those of one kind, camera and axis agree with all others."""

from __future__ import annotations

import math
from typing import Literal

from msgspec import Struct

GroupKind = Literal["photo", "control", "element", "distance", "direction", "station", "attitude", "check"]

ContradictionKind = Literal["shift", "scatter", "point", "down-weighted"]
"""An error common to a group; residuals too large; one check point; too many observations that lost weight."""


class GroupTest(Struct, frozen=True):
    """A group of observations of one kind and component, and how it agrees with the others.

    Residuals are adjusted minus observed, in the unit of the observation. Probabilities are those of figures as large
    or larger by chance if the a-priori errors are right; NaN where nothing can be tested.

    Parameters
    ----------
    kind : GroupKind
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
    what : ContradictionKind
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
