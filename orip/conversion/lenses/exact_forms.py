"""Cameras of other programs that orip's polynomial holds exactly; None where it does not."""

from __future__ import annotations

from orip.conversion.lenses.formulas import Parameters
from orip.conversion.lenses.polynomial import Polynomial


def opencv_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of OpenCV's model; there is none for the rational one, or for unequal focal lengths."""
    c, affinity = p["fy"], p["fx"] / p["fy"] - 1.0
    distortion = {
        "A3": p["k1"] / c**2, "A5": p["k2"] / c**4, "A7": p["k3"] / c**6,
        "P1": p["p2"] / c, "P2": p["p1"] / c,
    }  # fmt: skip
    # the affinity of OpenCV multiplies what is distorted, that of orip what is not
    if any(p[name] for name in ("k4", "k5", "k6")) or (affinity and any(distortion.values())):
        return None
    return _held(Polynomial(c, (p["cx"], p["cy"]), {**distortion, "B1": affinity}))


def agisoft_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of Metashape's model; there is none with p3, p4, or with affinity beside distortion."""
    c = p["f"]
    distortion = {
        "A3": p["k1"] / c**2, "A5": p["k2"] / c**4, "A7": p["k3"] / c**6, "A9": p["k4"] / c**8,
        "P1": p["p1"] / c, "P2": p["p2"] / c,
    }  # fmt: skip
    affinity = {"B1": p["b1"] / c, "B2": p["b2"] / c}
    if p["p3"] or p["p4"] or (any(affinity.values()) and any(distortion.values())):
        return None
    return _held(Polynomial(c, (p["cx"], p["cy"]), distortion | affinity))


def fraser_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of MicMac's model; there is none with a fifth coefficient, or a centre of distortion."""
    terms = {"A3": "c1", "A5": "c2", "A7": "c3", "A9": "c4", "P1": "p1", "P2": "p2", "B1": "b1", "B2": "b2"}
    if p["c5"] or p["ex"] or p["ey"]:
        return None
    return _held(Polynomial(p["f"], (p["cx"], p["cy"]), {name: p[term] for name, term in terms.items()}))


def measured_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of a model at measured coordinates."""
    terms = {"A3": "k1", "A5": "k2", "A7": "k3", "P1": "p1", "P2": "p2", "B1": "b1", "B2": "b2"}
    coefficients = {name: -p[term] for name, term in terms.items()}
    return Polynomial(p["f"], (p["cx"], p["cy"]), coefficients, at_measured=True)


def isp_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of the form of the ISP regulations."""
    square = p["r0"] ** 2
    terms = {"A3": "a1", "A5": "a2", "A7": "a3", "P1": "p1", "P2": "p2", "B1": "b1", "B2": "b2"}
    coefficients = {name: p[term] for name, term in terms.items()}
    coefficients["A1"] = -(p["a1"] * square + p["a2"] * square**2 + p["a3"] * square**3)
    return Polynomial(p["f"], (p["cx"], p["cy"]), coefficients)


def equidistant_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of OpenCV's fisheye model, whose argument is the angle.

    There is none with prism terms or terms beyond the ninth power, or as for `opencv`.
    """
    c, affinity = p["fy"], p["fx"] / p["fy"] - 1.0
    distortion = {
        "A3": p["k1"] / c**2, "A5": p["k2"] / c**4, "A7": p["k3"] / c**6, "A9": p["k4"] / c**8,
        "P1": p["p2"] / c, "P2": p["p1"] / c,
    }  # fmt: skip
    if any(p[name] for name in ("k5", "k6", "s1", "s2", "s3", "s4")) or (affinity and any(distortion.values())):
        return None
    return _held(Polynomial(c, (p["cx"], p["cy"]), {**distortion, "B1": affinity}))


def fisheye624_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of Aria's fisheye, which without decentring is OpenCV's."""
    return None if p["p1"] or p["p2"] else equidistant_polynomial(p)


def fov_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of the field-of-view model where it distorts nothing."""
    return None if p["omega"] else _pinhole(p)


def eucm_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of the enhanced unified model where it is a pinhole."""
    return None if p["alpha"] else _pinhole(p)


def division_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of the division model where it distorts nothing."""
    return None if p["k1"] else _pinhole(p)


def _pinhole(p: Parameters) -> Polynomial | None:
    return _held(Polynomial(p["fy"], (p["cx"], p["cy"]), {"B1": p["fx"] / p["fy"] - 1.0}))


def _held(polynomial: Polynomial) -> Polynomial | None:
    return polynomial if polynomial.holds() else None
