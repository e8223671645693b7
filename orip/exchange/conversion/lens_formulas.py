"""Camera formulas of other programs, for n directions or image coordinates as arrays (n,).

They take complex numbers too: partials are found by a complex step (`inversion`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

Parameters = Mapping[str, float]
Array = Any
"""Of floats or complex numbers."""


def opencv_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by OpenCV's rational model (COLMAP, OpenSfM, Pix4D, Bundler and many others)."""
    s = x * x + y * y
    radial = (1.0 + s * (p["k1"] + s * (p["k2"] + s * p["k3"]))) / (1.0 + s * (p["k4"] + s * (p["k5"] + s * p["k6"])))
    to_x = x * radial + 2.0 * p["p1"] * x * y + p["p2"] * (s + 2.0 * x * x)
    to_y = y * radial + p["p1"] * (s + 2.0 * y * y) + 2.0 * p["p2"] * x * y
    return p["fx"] * to_x + p["cx"], p["fy"] * to_y + p["cy"]


def agisoft_fisheye_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the fisheye camera of Metashape: equidistant coordinates in place of tangents."""
    factor, _ = _by_angle(x, y)
    return agisoft_image(p, x * factor, y * factor)


def agisoft_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the frame camera of Metashape (user manual, appendix on camera models)."""
    s = x * x + y * y
    radial = 1.0 + s * (p["k1"] + s * (p["k2"] + s * (p["k3"] + s * p["k4"])))
    decentring = 1.0 + s * (p["p3"] + s * p["p4"])
    to_x = x * radial + (p["p1"] * (s + 2.0 * x * x) + 2.0 * p["p2"] * x * y) * decentring
    to_y = y * radial + (p["p2"] * (s + 2.0 * y * y) + 2.0 * p["p1"] * x * y) * decentring
    return p["cx"] + p["f"] * to_x + p["b1"] * to_x + p["b2"] * to_y, p["cy"] + p["f"] * to_y


def fraser_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by MicMac's radial and Fraser models: a polynomial of lengths, its centre apart."""
    ideal_x, ideal_y = p["f"] * x, p["f"] * y
    u, v = ideal_x - p["ex"], ideal_y - p["ey"]
    dx, dy = _lengths_distortion(p, ("c1", "c2", "c3", "c4", "c5"), u, v)
    return p["cx"] + ideal_x + dx + p["b1"] * u + p["b2"] * v, p["cy"] + ideal_y + dy


def measured_direction(p: Parameters, u: Array, v: Array) -> tuple[Array, Array]:
    """Return directions by a polynomial of measured coordinates (PhotoModeler, VisualSFM), first freed of affinity."""
    u, v = u - p["cx"], v - p["cy"]
    u = u + p["b1"] * u + p["b2"] * v
    dx, dy = _lengths_distortion(p, ("k1", "k2", "k3"), u, v)
    return (u + dx) / p["f"], (v + dy) / p["f"]


def isp_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the form of the ISP regulations at ideal coordinates (AICON)."""
    u, v = p["f"] * x, p["f"] * y
    s, zero = u * u + v * v, p["r0"] ** 2
    radial = p["a1"] * (s - zero) + p["a2"] * (s**2 - zero**2) + p["a3"] * (s**3 - zero**3)
    to_u = u * radial + p["p1"] * (s + 2.0 * u * u) + 2.0 * p["p2"] * u * v + p["b1"] * u + p["b2"] * v
    to_v = v * radial + p["p2"] * (s + 2.0 * v * v) + 2.0 * p["p1"] * u * v
    return p["cx"] + u + to_u, p["cy"] + v + to_v


def division_direction(p: Parameters, u: Array, v: Array) -> tuple[Array, Array]:
    """Return directions by the division model with one coefficient (Fitzgibbon, CVPR 2001)."""
    x, y = (u - p["cx"]) / p["fx"], (v - p["cy"]) / p["fy"]
    divisor = 1.0 + p["k1"] * (x * x + y * y)
    return x / divisor, y / divisor


def equidistant_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the equidistant projection with a polynomial of the angle (OpenCV's fisheye).

    Decentring and prism terms have equidistant coordinates without distortion as their argument (COLMAP's thin prism
    fisheye, OpenSfM's fisheye624).
    """
    by_angle, t = _by_angle(x, y)
    u, v = x * by_angle, y * by_angle
    du, dv = _prism(p, u, v)
    radial = _radial_of_angle(p, t)
    return p["fx"] * (u * radial + du) + p["cx"], p["fy"] * (v * radial + dv) + p["cy"]


def fisheye624_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by Project Aria's fisheye: decentring and prism terms of what is distorted radially."""
    by_angle, t = _by_angle(x, y)
    radial = by_angle * _radial_of_angle(p, t)
    u, v = x * radial, y * radial
    du, dv = _prism(p, u, v)
    return p["fx"] * (u + du) + p["cx"], p["fy"] * (v + dv) + p["cy"]


def fov_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the field-of-view model with its angle omega (Devernay and Faugeras, 2001)."""
    omega = p["omega"]
    stretch = 2.0 * np.tan(omega / 2.0)
    by_angle, _ = _by_angle(stretch * x, stretch * y)
    factor = by_angle * stretch / omega if omega else 1.0
    return p["fx"] * x * factor + p["cx"], p["fy"] * y * factor + p["cy"]


def eucm_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
    """Return image coordinates by the enhanced unified model (Khomutenko, Garcia and Martinet, 2016)."""
    divisor = p["alpha"] * np.sqrt(p["beta"] * (x * x + y * y) + 1.0) + 1.0 - p["alpha"]
    return p["fx"] * x / divisor + p["cx"], p["fy"] * y / divisor + p["cy"]


def angle_polynomial_image(p: Parameters, x: Array, y: Array) -> tuple[Array, Array]:
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
