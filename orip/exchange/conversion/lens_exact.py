"""Camera formulas of other programs: where a direction is imaged, and the polynomial that orip has for it."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct, field

from orip.records.camera import CAMERA_PARAMETERS
from orip.records.exchanged import ImageAxes

Parameters = Mapping[str, float]

# Directions are tangents (x, y): to the right and along the y axis of the lens' axes, at the depth 1. Parameters are
# those that `LENSES` lists, by name; those that are missing are 0.


_POWERS = {"A1": 0, "A3": 2, "A5": 4, "A7": 6, "A9": 8, "P1": 1, "P2": 1, "B1": 0, "B2": 0}
"""A coefficient's unit is 1/length to this power."""

_TURNED_WITH_Y = ("P2", "B2")


class Polynomial(Struct, frozen=True):
    """A camera in the form of orip's camera, in a unit of length and with a y direction of its own.

    Parameters
    ----------
    c : float
        Principal distance.
    point : tuple of 2 float
        Principal point.
    coefficients : mapping of str to float
        By the names of orip's parameters; those that are missing are 0.
    at_measured : bool
        The polynomial's argument is the measured coordinate.
    """

    c: float
    point: tuple[float, float]
    coefficients: Mapping[str, float] = field(default_factory=dict)
    at_measured: bool = False

    def holds(self) -> bool:
        """Return whether orip's camera has all terms that are not 0."""
        return all(name in CAMERA_PARAMETERS for name, value in self.coefficients.items() if value)


def parameters_from_polynomial(
    polynomial: Polynomial, axes: ImageAxes, frame: tuple[int, int], pixel_mm: float
) -> tuple[float, ...]:
    """Return orip's camera parameters of a polynomial in other axes.

    Parameters
    ----------
    frame : tuple of 2 int
        Columns and rows; used unless the axes begin at the frame's centre.
    pixel_mm : float
        Size of a pixel; a length unit of 1 mm needs none.

    Returns
    -------
    tuple of float
        In the order of `CAMERA_PARAMETERS`, millimetres.
    """
    unit = pixel_mm if axes.unit == "pixel" else 1.0
    up = 1.0 if axes.y == "up" else -1.0
    middle = middle_of_frame(axes, frame)
    found = {
        "C": polynomial.c * unit,
        "DX": (polynomial.point[0] - middle[0]) * unit,
        "DY": (polynomial.point[1] - middle[1]) * unit * up,
    }
    for name, value in polynomial.coefficients.items():
        sign = up if name in _TURNED_WITH_Y else 1.0
        found[name] = sign * value / unit ** _POWERS[name]
    return tuple(found.get(name, 0.0) + 0.0 for name in CAMERA_PARAMETERS)


def polynomial_from_parameters(
    parameters: tuple[float, ...], axes: ImageAxes, frame: tuple[int, int], pixel_mm: float, *, at_measured: bool
) -> Polynomial:
    """Return the polynomial in other axes of orip's camera parameters, the inverse of `parameters_from_polynomial`."""
    unit = pixel_mm if axes.unit == "pixel" else 1.0
    up = 1.0 if axes.y == "up" else -1.0
    middle = middle_of_frame(axes, frame)
    given = dict(zip(CAMERA_PARAMETERS, parameters, strict=True))
    c, dx, dy, _ = (given.pop(name) for name in ("C", "DX", "DY", "READOUT"))
    coefficients = {
        name: (up if name in _TURNED_WITH_Y else 1.0) * value * unit ** _POWERS[name] + 0.0
        for name, value in given.items()
    }
    return Polynomial(c / unit, (dx / unit + middle[0], up * dy / unit + middle[1]), coefficients, at_measured)


def middle_of_frame(axes: ImageAxes, frame: tuple[int, int]) -> tuple[float, float]:
    """Return where the middle of the frame is in axes in pixels."""
    if axes.origin == "frame_centre":
        return 0.0, 0.0
    shift = 0.5 if axes.origin == "first_pixel" else 0.0
    return frame[0] / 2.0 - shift, frame[1] / 2.0 - shift


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


def angle_polynomial_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of a fisheye with every power of the angle where the odd factors are 0."""
    if any(p[f"q{n}"] for n in (1, 3, 5, 7)):
        return None
    radial = {f"k{n}": p[f"q{2 * n}"] if n < 4 else 0.0 for n in range(1, 7)}
    none = dict.fromkeys(("p1", "p2", "s1", "s2", "s3", "s4"), 0.0)
    return equidistant_polynomial({**{name: p[name] for name in ("fx", "fy", "cx", "cy")}, **radial, **none})


def division_polynomial(p: Parameters) -> Polynomial | None:
    """Return the polynomial of the division model where it distorts nothing."""
    return None if p["k1"] else _pinhole(p)


def _pinhole(p: Parameters) -> Polynomial | None:
    return _held(Polynomial(p["fy"], (p["cx"], p["cy"]), {"B1": p["fx"] / p["fy"] - 1.0}))


def _held(polynomial: Polynomial) -> Polynomial | None:
    return polynomial if polynomial.holds() else None
