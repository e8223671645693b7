"""Observed rotations: their three angles, or, where phi is near ±90 degrees, three small rotations about the axes.

Near there omega and kappa turn about the same axis: each of them by itself says nothing, and their errors, taken as
those of the angles, would hold a third axis without any. The rotation that the three angles are together is as well
known as elsewhere. Its residual is the rotation delta with R = Exp([delta]x) R_observed: those of OMEGA, PHI and KAPPA
are what R is turned by about X, Y and Z, and their a-priori errors are the errors of these rotations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.errors import InputError
from orip.geometry.rotation import (
    angle_rates_from_axes_rotation,
    angles_from_rotation,
    rotation_from_angles,
    rotation_vectors_with_partials,
)
from orip.units import DEGREES_PER_RADIAN, RADIANS_PER_DEGREE
from orip.wording import agreeing, first_names, joined

_COSINE_NEAR_POLE = 0.1
"""Of an observed phi of 84.3 degrees: beyond it the rotation is what was observed."""

_LEAST_COSINE = 0.02
"""Of an adjusted phi of 88.9 degrees: angles cannot be compared there, wherever they were observed."""


def rotation_residuals_with_partials(
    rotation: FloatArray, observed: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return what n rotations differ from observed ones in each of their three angles or small rotations.

    Parameters
    ----------
    rotation : array (n, 3, 3)
    observed : array (n, 3)
        Omega, phi and kappa, degrees; NaN where one was not observed.

    Returns
    -------
    residual : array (n, 3)
        Degrees, in (-180, 180]; NaN where the angle was not observed.
    partials : array (n, 3, 3)
        Degrees by small rotations about the axes, radians.
    inseparable : array (n,) of bool
        Rotations near the pole of which not all angles were observed: there these say nothing.
    """
    angles = angles_from_rotation(rotation)
    complete = np.isfinite(observed).all(axis=1)
    at_pole = np.abs(np.cos(angles[:, 1])) < _LEAST_COSINE
    as_rotation = complete & (at_pole | (np.abs(np.cos(observed[:, 1] * RADIANS_PER_DEGREE)) < _COSINE_NEAR_POLE))
    residual = (angles * DEGREES_PER_RADIAN - observed + 180.0) % 360.0 - 180.0
    partials = angle_rates_from_axes_rotation(angles) * DEGREES_PER_RADIAN
    if as_rotation.any():
        as_observed = rotation_from_angles(observed[as_rotation] * RADIANS_PER_DEGREE)
        vectors, by_rotation = rotation_vectors_with_partials(rotation[as_rotation] @ np.swapaxes(as_observed, 1, 2))
        residual[as_rotation], partials[as_rotation] = vectors * DEGREES_PER_RADIAN, by_rotation * DEGREES_PER_RADIAN
    return residual, partials, at_pole & ~complete


def require_separable_angles(inseparable: Sequence[str]) -> None:
    """Require that single angles are observed only where omega and kappa can be told apart.

    Parameters
    ----------
    inseparable : sequence of str
        What is observed there.

    Raises
    ------
    InputError
    """
    if inseparable:
        what = joined(inseparable) if len(inseparable) <= 3 else first_names(inseparable, 3)
        message = (
            f"{what} {agreeing(len(inseparable), 'is', 'are')} observed, but phi is within 1.1 degrees of ±90 "
            "there, where omega and kappa turn about the same axis; give all three angles of a photo in the "
            f".ELE file (they are then one rotation), or remove the {agreeing(len(inseparable), 'element')}"
        )
        raise InputError.single(message)
