"""Orip's distortion polynomial in the unit and the y direction of another program, and in orip's millimetres."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct, field

from orip.records.exchanged import ImageAxes
from orip.records.project.camera import CAMERA_PARAMETERS

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
    polynomial : Polynomial
    axes : ImageAxes
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
    c, dx, dy = (given.pop(name) for name in ("C", "DX", "DY"))
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
