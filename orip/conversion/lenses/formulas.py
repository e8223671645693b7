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
    """Return image coordinates by the equidistant projection with a polynomial of the angle (OpenCV's fisheye)."""
    by_angle, t = _by_angle(x, y)
    factor = by_angle * (1.0 + t * (p["k1"] + t * (p["k2"] + t * (p["k3"] + t * p["k4"]))))
    return p["fx"] * x * factor + p["cx"], p["fy"] * y * factor + p["cy"]


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
