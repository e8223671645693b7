"""The lenses by name: their parameters, their formula in both directions, and orip's polynomial where it holds them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.exchange.conversion import lens_exact as exact_forms
from orip.exchange.conversion.lens_exact import Parameters, Polynomial
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


# Formulas are for n directions or image coordinates as arrays (n,). They take complex numbers too: partials are found
# by a complex step (`inverse_of`).

Array = Any
"""Of floats or complex numbers."""


def _opencv_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by OpenCV's rational model (COLMAP, OpenSfM, Pix4D, Bundler and many others)."""
    s = x * x + y * y
    radial = (1.0 + s * (p["k1"] + s * (p["k2"] + s * p["k3"]))) / (1.0 + s * (p["k4"] + s * (p["k5"] + s * p["k6"])))
    to_x = x * radial + 2.0 * p["p1"] * x * y + p["p2"] * (s + 2.0 * x * x)
    to_y = y * radial + p["p1"] * (s + 2.0 * y * y) + 2.0 * p["p2"] * x * y
    return p["fx"] * to_x + p["cx"], p["fy"] * to_y + p["cy"]


def _agisoft_fisheye_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the fisheye camera of Metashape: equidistant coordinates in place of tangents."""
    factor, _ = _by_angle(x, y)
    return _agisoft_image(p, x * factor, y * factor)


def _agisoft_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the frame camera of Metashape (user manual, appendix on camera models)."""
    s = x * x + y * y
    radial = 1.0 + s * (p["k1"] + s * (p["k2"] + s * (p["k3"] + s * p["k4"])))
    decentring = 1.0 + s * (p["p3"] + s * p["p4"])
    to_x = x * radial + (p["p1"] * (s + 2.0 * x * x) + 2.0 * p["p2"] * x * y) * decentring
    to_y = y * radial + (p["p2"] * (s + 2.0 * y * y) + 2.0 * p["p1"] * x * y) * decentring
    return p["cx"] + p["f"] * to_x + p["b1"] * to_x + p["b2"] * to_y, p["cy"] + p["f"] * to_y


def _fraser_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by MicMac's radial and Fraser models: a polynomial of lengths, its centre apart."""
    ideal_x, ideal_y = p["f"] * x, p["f"] * y
    u, v = ideal_x - p["ex"], ideal_y - p["ey"]
    dx, dy = _lengths_distortion(p, ("c1", "c2", "c3", "c4", "c5"), u, v)
    return p["cx"] + ideal_x + dx + p["b1"] * u + p["b2"] * v, p["cy"] + ideal_y + dy


def _measured_direction(p: Parameters, u: Array, v: Array) -> tuple[Array, Array]:
    """Return directions by a polynomial of measured coordinates (PhotoModeler, VisualSFM), first freed of affinity."""
    u, v = u - p["cx"], v - p["cy"]
    u = u + p["b1"] * u + p["b2"] * v
    dx, dy = _lengths_distortion(p, ("k1", "k2", "k3"), u, v)
    return (u + dx) / p["f"], (v + dy) / p["f"]


def _isp_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the form of the ISP regulations at ideal coordinates (AICON)."""
    u, v = p["f"] * x, p["f"] * y
    s, zero = u * u + v * v, p["r0"] ** 2
    radial = p["a1"] * (s - zero) + p["a2"] * (s**2 - zero**2) + p["a3"] * (s**3 - zero**3)
    to_u = u * radial + p["p1"] * (s + 2.0 * u * u) + 2.0 * p["p2"] * u * v + p["b1"] * u + p["b2"] * v
    to_v = v * radial + p["p2"] * (s + 2.0 * v * v) + 2.0 * p["p1"] * u * v
    return p["cx"] + u + to_u, p["cy"] + v + to_v


def _division_direction(p: Parameters, u: Array, v: Array) -> tuple[Array, Array]:
    """Return directions by the division model with one coefficient (Fitzgibbon, CVPR 2001)."""
    x, y = (u - p["cx"]) / p["fx"], (v - p["cy"]) / p["fy"]
    divisor = 1.0 + p["k1"] * (x * x + y * y)
    return x / divisor, y / divisor


def _equidistant_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the equidistant projection with a polynomial of the angle (OpenCV's fisheye).

    Decentring and prism terms have equidistant coordinates without distortion as their argument (COLMAP's thin prism
    fisheye, OpenSfM's fisheye624).
    """
    by_angle, t = _by_angle(x, y)
    u, v = x * by_angle, y * by_angle
    du, dv = _prism(p, u, v)
    radial = _radial_of_angle(p, t)
    return p["fx"] * (u * radial + du) + p["cx"], p["fy"] * (v * radial + dv) + p["cy"]


def _fisheye624_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by Project Aria's fisheye: decentring and prism terms of what is distorted radially."""
    by_angle, t = _by_angle(x, y)
    radial = by_angle * _radial_of_angle(p, t)
    u, v = x * radial, y * radial
    du, dv = _prism(p, u, v)
    return p["fx"] * (u + du) + p["cx"], p["fy"] * (v + dv) + p["cy"]


def _fov_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the field-of-view model with its angle omega (Devernay and Faugeras, 2001)."""
    omega = p["omega"]
    stretch = 2.0 * np.tan(omega / 2.0)
    by_angle, _ = _by_angle(stretch * x, stretch * y)
    factor = by_angle * stretch / omega if omega else 1.0
    return p["fx"] * x * factor + p["cx"], p["fy"] * y * factor + p["cy"]


def _eucm_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the enhanced unified model (Khomutenko, Garcia and Martinet, 2016)."""
    divisor = p["alpha"] * np.sqrt(p["beta"] * (x * x + y * y) + 1.0) + 1.0 - p["alpha"]
    return p["fx"] * x / divisor + p["cx"], p["fy"] * y / divisor + p["cy"]


def _angle_polynomial_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the equidistant projection with every power of the angle (fisheye of Pix4D)."""
    by_angle, t = _by_angle(x, y)
    angle = np.sqrt(t)
    factor: Array = 0.0 * t
    for name in ("q7", "q6", "q5", "q4", "q3", "q2", "q1"):
        factor = angle * (p[name] + factor)
    radial = by_angle * (1.0 + factor)
    return p["fx"] * x * radial + p["cx"], p["fy"] * y * radial + p["cy"]


def _radial_of_angle(p: Parameters, t: Array) -> Array:
    """Return the radial distortion factor of the square of an angle."""
    factor: Array = 0.0 * t
    for name in ("k6", "k5", "k4", "k3", "k2", "k1"):
        factor = t * (p[name] + factor)
    return 1.0 + factor


def _prism(p: Parameters, u: Array, v: Array) -> tuple[Array, Array]:
    """Return decentring (OpenCV's order) and thin prism distortion."""
    s = u * u + v * v
    du = 2.0 * p["p1"] * u * v + p["p2"] * (s + 2.0 * u * u) + s * (p["s1"] + s * p["s2"])
    dv = p["p1"] * (s + 2.0 * v * v) + 2.0 * p["p2"] * u * v + s * (p["s3"] + s * p["s4"])
    return du, dv


def _by_angle(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the angle from the axis of tangents x, y divided by their length, and the square of the angle."""
    s = x * x + y * y
    is_centre = s == 0.0
    radius = np.sqrt(np.where(is_centre, 1.0, s))
    angle = np.arctan(radius)
    return np.where(is_centre, 1.0, angle / radius), np.where(is_centre, 0.0, angle * angle)


def _lengths_distortion(p: Parameters, radial: tuple[str, ...], u: Array, v: Array) -> tuple[Array, Array]:
    """Return the distortion of lengths u, v: radial terms by name, and p1, p2 in Agisoft's order."""
    s = u * u + v * v
    factor: Array = 0.0 * s
    for name in reversed(radial):
        factor = s * (p[name] + factor)
    dx = u * factor + p["p1"] * (s + 2.0 * u * u) + 2.0 * p["p2"] * u * v
    dy = v * factor + p["p2"] * (s + 2.0 * v * v) + 2.0 * p["p1"] * u * v
    return dx, dy


_PLANE = ("fx", "fy", "cx", "cy")
_FISHEYE = (*_PLANE, "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4")
_LENGTHS = ("f", "cx", "cy", "p1", "p2", "b1", "b2")

LENSES: Mapping[Lens, LensFormula] = {
    "opencv": LensFormula(
        (*_PLANE, "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"),
        _opencv_image,
        exact_forms.opencv_polynomial,
    ),
    "agisoft": LensFormula(
        (*_LENGTHS, "k1", "k2", "k3", "k4", "p3", "p4"), _agisoft_image, exact_forms.agisoft_polynomial
    ),
    "fraser": LensFormula(
        (*_LENGTHS, "c1", "c2", "c3", "c4", "c5", "ex", "ey"), _fraser_image, exact_forms.fraser_polynomial
    ),
    "measured": LensFormula((*_LENGTHS, "k1", "k2", "k3"), _measured_direction, exact_forms.measured_polynomial, True),
    "isp": LensFormula((*_LENGTHS, "r0", "a1", "a2", "a3"), _isp_image, exact_forms.isp_polynomial),
    "division": LensFormula((*_PLANE, "k1"), _division_direction, exact_forms.division_polynomial, True),
    "equidistant": LensFormula(
        _FISHEYE, _equidistant_image, exact_forms.equidistant_polynomial, projection="equidistant"
    ),
    "fisheye624": LensFormula(_FISHEYE, _fisheye624_image, exact_forms.fisheye624_polynomial, projection="equidistant"),
    "fov": LensFormula((*_PLANE, "omega"), _fov_image, exact_forms.fov_polynomial, suits_any_projection=True),
    "eucm": LensFormula(
        (*_PLANE, "alpha", "beta"), _eucm_image, exact_forms.eucm_polynomial, suits_any_projection=True
    ),
    "angle_polynomial": LensFormula(
        (*_PLANE, *(f"q{n}" for n in range(1, 8))),
        _angle_polynomial_image,
        exact_forms.angle_polynomial_polynomial,
        projection="equidistant",
    ),
    "agisoft_fisheye": LensFormula(
        (*_LENGTHS, "k1", "k2", "k3", "k4", "p3", "p4"),
        _agisoft_fisheye_image,
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
