"""A camera's radial distortion as text: its coefficients, and how the points of a given curve fit."""

from __future__ import annotations

from collections.abc import Sequence

from orip.arrays import FloatArray
from orip.files.text.table import Column, table_lines
from orip.number_text import fixed, root_mean_square
from orip.records.project.camera import ISP_PARAMETERS, RADIAL_PARAMETERS


def distortion_lines(
    coefficients: Sequence[float],
    isp: Sequence[float] | None,
    radius: FloatArray,
    given: FloatArray,
    residual: FloatArray,
) -> list[str]:
    """Return the terms of the polynomial, the ISP form, and of a given curve its points and residuals.

    Parameters
    ----------
    coefficients : (A1, A3, A5, A7, A9)
    isp : (R0, A1, A2, A3) or None
    radius, given, residual : arrays (n,)
        Points of the curve and polynomial minus given, mm; empty without a curve.
    """
    terms = {name: value for name, value in zip(RADIAL_PARAMETERS, coefficients, strict=True) if value} or {"A1": 0.0}
    lines = [_named("polynomial", list(terms), list(terms.values()))]
    if isp is not None:
        lines.append(_named("ISP form", ISP_PARAMETERS, isp))
    if len(radius):
        columns = [
            Column("R", fixed(radius, 3), "mm"),
            Column("D given", fixed(given, 5), "mm"),
            Column("D fitted", fixed(given + residual, 5), "mm"),
            Column("Residual", fixed(residual, 5), "mm"),
        ]
        lines += ["", *table_lines(columns), f"  RMS of the residuals {root_mean_square(residual):.5f} mm"]
    return lines


def _named(label: str, names: Sequence[str], values: Sequence[float]) -> str:
    terms = "  ".join(f"{name} = {value:.9g}" for name, value in zip(names, values, strict=True))
    return f"  {label + ':':<13}{terms}"
