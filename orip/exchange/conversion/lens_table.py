"""The lenses by name: their parameters, their formula in both directions, and orip's polynomial where it holds them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.exchange.conversion import lens_exact as exact_forms
from orip.exchange.conversion import lens_formulas as formulas
from orip.exchange.conversion.lens_exact import Polynomial
from orip.exchange.conversion.lens_formulas import Parameters
from orip.records.camera import Projection
from orip.records.exchanged import ExchangedCamera, Lens

STEP = 1e-30
"""f(x + ih) has the imaginary part h f'(x), to all digits (Squire and Trapp, SIAM Review 1998)."""

_ITERATIONS = 50
_ENOUGH = 1e-13
"""Of the largest value."""

_FOUND = 1e-10
"""Of the largest value: a millionth of a pixel."""

Map = Callable[[Any, Any], tuple[Any, Any]]


def inverse_of(function: Map, image: FloatArray, start: FloatArray) -> FloatArray:
    """Return the places (n, 2) that a function of the plane takes to given ones.

    Parameters
    ----------
    function : callable
        From x and y, arrays (n,), to two arrays (n,); analytic.
    image : array (n, 2)
    start : array (n, 2)
        Approximations.

    Returns
    -------
    array (n, 2)
        NaN where there is none, or where the function mirrors the plane.
    """
    place = start.astype(np.float64)
    largest = max(float(np.abs(image).max(initial=0.0)), 1e-300)
    with np.errstate(all="ignore"):  # single points may run away
        for _ in range(_ITERATIONS):
            misfit, partials = _misfit(function, place, image)
            if not np.any(np.abs(misfit) > _ENOUGH * largest):
                break
            place = place - _solved(partials, misfit)
        misfit, partials = _misfit(function, place, image)
        found = np.all(np.abs(misfit) <= _FOUND * largest, axis=1) & (np.linalg.det(partials) > 0.0)
    place[~found] = np.nan
    return place


def _misfit(function: Map, place: FloatArray, image: FloatArray) -> tuple[FloatArray, FloatArray]:
    by_x = np.stack(function(place[:, 0] + 1j * STEP, place[:, 1] + 0j), axis=1)
    by_y = np.stack(function(place[:, 0] + 0j, place[:, 1] + 1j * STEP), axis=1)
    return by_x.real - image, np.stack([by_x.imag, by_y.imag], axis=2) / STEP


def _solved(partials: FloatArray, misfit: FloatArray) -> FloatArray:
    (a, b), (c, d) = partials.transpose(1, 2, 0)
    determinant = a * d - b * c
    u, v = misfit.T
    return np.stack([(d * u - b * v) / determinant, (a * v - c * u) / determinant], axis=1)


class LensFormula(Struct, frozen=True):
    """A lens.

    Parameters
    ----------
    names : tuple of str
        Its parameters.
    formula : callable
        From parameters and directions to image coordinates, or the other way.
    polynomial : callable
        From parameters to orip's polynomial; None where it does not hold the lens exactly.
    gives_directions : bool
        The formula takes image coordinates and returns directions.
    projection : {"perspective", "equidistant"}
        Of orip's camera.
    suits_any_projection : bool
        Where orip's camera is fitted, it has the projection that comes nearer.
    """

    names: tuple[str, ...]
    formula: Callable[[Parameters, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
    polynomial: Callable[[Parameters], Polynomial | None]
    gives_directions: bool = False
    projection: Projection = "perspective"
    suits_any_projection: bool = False


_PLANE = ("fx", "fy", "cx", "cy")
_FISHEYE = (*_PLANE, "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4")
_LENGTHS = ("f", "cx", "cy", "p1", "p2", "b1", "b2")

LENSES: Mapping[Lens, LensFormula] = {
    "opencv": LensFormula(
        (*_PLANE, "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"),
        formulas.opencv_image,
        exact_forms.opencv_polynomial,
    ),
    "agisoft": LensFormula(
        (*_LENGTHS, "k1", "k2", "k3", "k4", "p3", "p4"), formulas.agisoft_image, exact_forms.agisoft_polynomial
    ),
    "fraser": LensFormula(
        (*_LENGTHS, "c1", "c2", "c3", "c4", "c5", "ex", "ey"), formulas.fraser_image, exact_forms.fraser_polynomial
    ),
    "measured": LensFormula(
        (*_LENGTHS, "k1", "k2", "k3"), formulas.measured_direction, exact_forms.measured_polynomial, True
    ),
    "isp": LensFormula((*_LENGTHS, "r0", "a1", "a2", "a3"), formulas.isp_image, exact_forms.isp_polynomial),
    "division": LensFormula((*_PLANE, "k1"), formulas.division_direction, exact_forms.division_polynomial, True),
    "equidistant": LensFormula(
        _FISHEYE, formulas.equidistant_image, exact_forms.equidistant_polynomial, projection="equidistant"
    ),
    "fisheye624": LensFormula(
        _FISHEYE, formulas.fisheye624_image, exact_forms.fisheye624_polynomial, projection="equidistant"
    ),
    "fov": LensFormula((*_PLANE, "omega"), formulas.fov_image, exact_forms.fov_polynomial, suits_any_projection=True),
    "eucm": LensFormula(
        (*_PLANE, "alpha", "beta"), formulas.eucm_image, exact_forms.eucm_polynomial, suits_any_projection=True
    ),
    "angle_polynomial": LensFormula(
        (*_PLANE, *(f"q{n}" for n in range(1, 8))),
        formulas.angle_polynomial_image,
        exact_forms.angle_polynomial_polynomial,
        projection="equidistant",
    ),
    "agisoft_fisheye": LensFormula(
        (*_LENGTHS, "k1", "k2", "k3", "k4", "p3", "p4"),
        formulas.agisoft_fisheye_image,
        exact_forms.agisoft_polynomial,
        projection="equidistant",
    ),
}


def lens_parameters(camera: ExchangedCamera) -> dict[str, float]:
    """Return all parameters of a camera's lens; 0 for those that the file does not have.

    Raises
    ------
    KeyError
        If the file has one that the lens has not: a fault of its reader.
    """
    names = LENSES[camera.lens].names
    if unknown := set(camera.parameters) - set(names):
        raise KeyError(min(unknown))
    return {name: float(camera.parameters.get(name, 0.0)) for name in names}


def image_of_directions(camera: ExchangedCamera, directions: FloatArray) -> FloatArray:
    """Return image coordinates (n, 2), in the axes of the lens, of directions (n, 2); NaN where there are none."""
    lens, parameters = LENSES[camera.lens], lens_parameters(camera)
    function: Map = partial(lens.formula, parameters)
    if not lens.gives_directions:
        with np.errstate(all="ignore"):
            return np.stack(function(*directions.T), axis=1)
    return inverse_of(function, directions, _pinhole(parameters, directions))


def directions_of_image(camera: ExchangedCamera, image: FloatArray) -> FloatArray:
    """Return the directions (n, 2) of image coordinates (n, 2) in the axes of the lens; NaN where there are none."""
    lens, parameters = LENSES[camera.lens], lens_parameters(camera)
    function: Map = partial(lens.formula, parameters)
    if lens.gives_directions:
        with np.errstate(all="ignore"):
            return np.stack(function(*image.T), axis=1)
    return inverse_of(function, image, _pinhole_directions(parameters, image))


def _pinhole(p: Parameters, directions: FloatArray) -> FloatArray:
    fx, fy = p.get("f", p.get("fx", 1.0)), p.get("f", p.get("fy", 1.0))
    return np.asarray(directions * np.array([fx, fy]) + np.array([p["cx"], p["cy"]]))


def _pinhole_directions(p: Parameters, image: FloatArray) -> FloatArray:
    fx, fy = p.get("f", p.get("fx", 1.0)), p.get("f", p.get("fy", 1.0))
    return np.asarray((image - np.array([p["cx"], p["cy"]])) / np.array([fx, fy]))


def focal_lengths(camera: ExchangedCamera) -> list[float]:
    """Return the focal length of a camera, or both, in the unit of its lens."""
    parameters = lens_parameters(camera)
    return [parameters[name] for name in ("f", "fx", "fy") if name in parameters]
