"""Figures of a forecast, as commands and the page of a plan tell them."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from orip.arrays import FloatArray
from orip.planning.forecast import Forecast
from orip.records.camera import CAMERA_PARAMETERS


def finite(value: float) -> float | None:
    """Return a number for JSON; None for what is not determined."""
    return float(value) if math.isfinite(value) else None


def figures_of(found: Forecast) -> dict[str, Any]:
    """Return the figures of a forecast that are told."""
    sd, residuals = found.point_sd, found.solution.residuals
    with np.errstate(invalid="ignore"):
        medians, largest = _columns(sd, "median"), _columns(sd, "max")
    photo = _columns(found.solution.photos.sd, "median")
    cameras = found.solution.cameras.sd[0]
    rows = 2 * len(found.solved.block.photo_points.photo)
    return {
        "point_sd_median": [finite(value) for value in medians],
        "point_sd_largest": [finite(value) for value in largest],
        "photo_sd_median": [finite(value) for value in photo],
        "camera_sd": {
            name: finite(float(value))
            for name, value in zip(CAMERA_PARAMETERS, cameras, strict=True)
            if name in found.solved.block.cameras[0].unknown
        },
        "redundancy": found.solution.redundancy,
        "redundancy_number_median": finite(float(np.nanmedian(residuals.redundancy_number[:rows]))),
        "smallest_bias_mm": finite(found.smallest_bias),
        "external": finite(found.external),
        "not_determined": [f"{one.group} {one.name} {one.kind}" for one in found.solution.singular],
    }


def _columns(values: FloatArray, what: Literal["median", "max"]) -> list[float]:
    """Return a figure of each column over what is determined."""
    kept = [column[np.isfinite(column)] for column in values.T]
    found = np.median if what == "median" else np.max
    return [float(found(column)) if len(column) else math.nan for column in kept]


def facts_of(found: Forecast, unit: str) -> list[tuple[str, str]]:
    """Return what a forecast says, each line with what it is about."""
    figures, solution = figures_of(found), found.solution
    facts = [
        (
            "block",
            (
                f"{len(solution.photos.names)} photos, {len(solution.points.names)} points, "
                f"redundancy {solution.redundancy}, each {short(figures['redundancy_number_median'])} (median)"
            ),
        ),
        (
            "points",
            (
                f"sd X Y Z  {_row(figures['point_sd_median'])} {unit} (median), "
                f"{_row(figures['point_sd_largest'])} (largest)"
            ),
        ),
        (
            "photos",
            (
                f"sd X0 Y0 Z0  {_row(figures['photo_sd_median'][:3])} {unit}; OMEGA PHI KAPPA "
                f"{_row(figures['photo_sd_median'][3:])} degrees (median)"
            ),
        ),
    ]
    if figures["camera_sd"]:
        parts = [f"{name} {short(value)}" for name, value in figures["camera_sd"].items()]
        facts.append(("camera", f"sd {', '.join(parts)}"))
    if found.held:
        facts.append(("", f"all figures are as if {', '.join(found.held)} were known, which nothing determines"))
    bias, external = short(figures["smallest_bias_mm"]), short(figures["external"])
    text = f"of {bias} mm are found in a photo point; undetected they move a result by {external} of its sd at most"
    return [*facts, ("blunders", f"{text} (medians)")]


def _row(values: list[float | None]) -> str:
    return " ".join(map(short, values))


def short(value: float | None) -> str:
    """Return three figures; - for what is not determined."""
    return "-" if value is None else f"{value:.3g}"
