"""The projections that a camera may have: from a ground point to the ideal photo coordinates, before any distortion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.geometry import equidistant, perspective
from orip.geometry.equidistant import equidistant_with_partials
from orip.geometry.perspective import Perspective, perspective_with_partials


class Projection(NamedTuple):
    """The formulas of one projection, for plain numbers as well as arrays (n,).

    Attributes
    ----------
    is_in_front : callable
        From U1, U2, U3 in the photo's axes: whether the point has an image.
    least_cosine : float
        Cosine of the angle from the axis up to which it has.
    ideal_coordinates : callable
        From C (mm), U1, U2, U3: ideal photo coordinates, mm.
    image_vector : callable
        From C and ideal coordinates (mm): a vector of the ray in the photo's axes, mm; its length tells how far a
        photo point moves with the direction of the ray.
    """

    is_in_front: Callable[..., Any]
    least_cosine: float
    ideal_coordinates: Callable[..., Any]
    image_vector: Callable[..., Any]


PROJECTIONS: Final = {
    module.NAME: Projection(module.is_in_front, module.LEAST_COSINE, module.ideal_coordinates, module.image_vector)
    for module in (perspective, equidistant)
}
"""By the name that a camera's record has."""


def projected_with_partials(
    offset: FloatArray, rotation: FloatArray, principal_distance_mm: FloatArray, is_equidistant: BoolArray
) -> Perspective:
    """Return the ideal photo coordinates of ground points, each by its own projection, and their partials.

    Those with `is_equidistant`, array (n,) of bool, are imaged by `equidistant_with_partials`, the others by
    `perspective_with_partials`, which describe the other arrays.
    """
    if not is_equidistant.any():
        return perspective_with_partials(offset, rotation, principal_distance_mm)
    if is_equidistant.all():
        return equidistant_with_partials(offset, rotation, principal_distance_mm)
    rows = np.flatnonzero(is_equidistant)
    found = perspective_with_partials(offset, rotation, principal_distance_mm)
    for whole, part in zip(
        found, equidistant_with_partials(offset[rows], rotation[rows], principal_distance_mm[rows]), strict=True
    ):
        whole[rows] = part
    return found
