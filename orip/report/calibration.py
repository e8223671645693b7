"""The cameras: parameters with precision and significance, correlations, and the distortion before and after."""

from __future__ import annotations

import math

import numpy as np
from markupsafe import Markup
from msgspec import Struct

from orip.arrays import FloatArray
from orip.interior.distortion import curve_from_polynomial
from orip.interior.mounting import frame_corners
from orip.records.camera import CAMERA_PARAMETERS, RADIAL_PLACES, Camera
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.report.drawings.residual_vectors import measured_reach
from orip.report.drawings.svg import ChartFrame, Curve, line_chart
from orip.report.report_input import ReportInput
from orip.report.table import MISSING, PageColumn, PageTable, fixed, parameter

STRONG = 0.95
_ERROR_PROBABILITY = 0.05
_RADII = 81
_UNITS = {
    "C": "mm", "DX": "mm", "DY": "mm", "A1": "", "A3": "mm⁻²", "A5": "mm⁻⁴", "A7": "mm⁻⁶", "A9": "mm⁻⁸",
    "P1": "mm⁻¹", "P2": "mm⁻¹", "B1": "", "B2": "", "READOUT": "s",
}  # fmt: skip


class CorrelationMatrix(Struct, frozen=True):
    """Correlation coefficients of a camera's unknowns: names and the rows of the full matrix."""

    names: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]


class CameraSheet(Struct, frozen=True):
    """All that the page shows of one camera."""

    name: str
    parameters: PageTable
    correlations: CorrelationMatrix | None
    distortion: Markup


def camera_sheets(given: ReportInput) -> tuple[CameraSheet, ...]:
    """Return a sheet for each camera."""
    return tuple(_sheet(given, name, row) for row, name in enumerate(given.solution.cameras.names))


def correlation_matrix(solution: Solution, camera: str) -> CorrelationMatrix | None:
    """Return the correlations of a camera's unknowns; None where it has fewer than two."""
    found = {
        (correlation.a, correlation.b): correlation.r
        for correlation in solution.correlations
        if correlation.a.rpartition(".")[0] == camera
    }
    names = tuple(dict.fromkeys(name for pair in found for name in pair))
    if not names:
        return None
    rows = tuple(tuple(1.0 if a == b else found.get((a, b), found.get((b, a), math.nan)) for b in names) for a in names)
    return CorrelationMatrix(tuple(name.rpartition(".")[2] for name in names), rows)


def significance_limit(redundancy: int) -> float:
    """Return the two-sided 5 % limit of Student's t."""
    from scipy.special import stdtrit

    return float(stdtrit(redundancy, 1.0 - _ERROR_PROBABILITY / 2.0)) if redundancy > 0 else math.nan


def _sheet(given: ReportInput, name: str, row: int) -> CameraSheet:
    solution, before = given.solution, given.cameras.get(record_key(name))
    adjusted = solution.cameras.values[row]
    return CameraSheet(
        name,
        _parameter_table(solution, row, before),
        correlation_matrix(solution, name),
        _distortion_chart(given, name, before, adjusted),
    )


def _parameter_table(solution: Solution, row: int, before: Camera | None) -> PageTable:
    """Return the parameters that are unknown or not zero."""
    name = solution.cameras.names[row]
    given = before.parameters if before is not None else (math.nan,) * len(CAMERA_PARAMETERS)
    shown = [
        (kind, _UNITS[kind], old, value, sd)
        for kind, old, value, sd in zip(
            CAMERA_PARAMETERS, given, solution.cameras.values[row].tolist(), solution.cameras.sd[row].tolist(),
            strict=True,
        )
        if not math.isnan(sd) or value != 0.0
    ]  # fmt: skip
    shown += [
        (parameter.name, "", 0.0, parameter.value, parameter.sd)
        for parameter in solution.additional
        if parameter.camera == name
    ]
    written = [parameter(value, sd) for _kind, _unit, _old, value, sd in shown]
    limit = significance_limit(solution.redundancy)
    significant = [significance(kind, value, sd, limit) for kind, _unit, _old, value, sd in shown]
    columns: tuple[PageColumn, ...] = (
        PageColumn("Parameter", [kind for kind, *_ in shown], key="name", words=True),
        PageColumn("Unit", [unit for _kind, unit, *_ in shown], words=True),
        PageColumn("Before", [MISSING if math.isnan(old) else f"{old:.6g}" for _kind, _unit, old, *_ in shown]),
        PageColumn("Adjusted", [value for value, _sd in written], key="value"),
        PageColumn("sd", [sd for _value, sd in written], key="sd"),
    )
    if not any(significant):
        return PageTable(f"cameras.{name}", f"Parameters of camera {name}", columns)
    columns += (
        PageColumn("|value| / sd", [_ratio(kind, value, sd) for kind, _unit, _old, value, sd in shown]),
        PageColumn("Significant", significant, words=True),
    )
    note = (
        f"Significant: different from zero at the 5 % level, |value| / sd above {limit:.2f}; "
        "each by itself. C, DX and DY are not tested: zero means nothing there."
    )
    return PageTable(f"cameras.{name}", f"Parameters of camera {name}", columns, note)


def _is_tested(kind: str, sd: float) -> bool:
    return kind not in {"C", "DX", "DY"} and math.isfinite(sd) and sd > 0.0


def _ratio(kind: str, value: float, sd: float) -> str:
    return fixed(abs(value) / sd, 1) if _is_tested(kind, sd) else ""


def significance(kind: str, value: float, sd: float, limit: float) -> str:
    """Return whether a parameter differs from zero: ``yes``, ``no``, or empty where that is not tested."""
    if not _is_tested(kind, sd) or math.isnan(limit):
        return ""
    return "yes" if abs(value) > limit * sd else "no"


def _distortion_chart(given: ReportInput, name: str, before: Camera | None, adjusted: FloatArray) -> Markup:
    """Return the radial distortion in µm over the radius, before and after."""
    reach = frame_reach(given, name) or measured_reach(given, name)
    curves = []
    if before is not None:
        curves.append(("before", "limit", before.parameters[RADIAL_PLACES]))
    curves.append(("adjusted", "first", tuple(adjusted[RADIAL_PLACES].tolist())))
    if reach <= 0.0 or not any(any(coefficients) for _name, _style, coefficients in curves):
        return Markup("")
    radius = np.linspace(0.0, reach, _RADII)
    lines = [
        Curve(
            list(zip(radius.tolist(), (1e3 * curve_from_polynomial(coefficients, radius)).tolist(), strict=True)),
            *label,
        )
        for *label, coefficients in curves
    ]
    label = f"Radial distortion of camera {name}, before (dashed) and after the adjustment"
    return line_chart(label, ChartFrame("radius (mm)", "distortion (µm)", 460.0, 250.0), lines)


def frame_reach(given: ReportInput, name: str) -> float:
    """Return the largest distance (mm) of a camera's frame from its principal point; 0 if it has no frame."""
    camera = given.cameras.get(record_key(name))
    corners = frame_corners(camera) if camera is not None else None
    if corners is None or camera is None:
        return 0.0
    return float(np.hypot(*np.maximum(*(np.abs(corner - camera.parameters[1:3]) for corner in corners))))
