"""Photo observations as text: what fits badly, what to measure; and a camera's radial distortion."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.files.text.table import Column, table_lines, xy_columns
from orip.number_text import fixed, root_mean_square
from orip.records.camera import ISP_PARAMETERS, RADIAL_PARAMETERS
from orip.records.interior import ListedObservation, PointToMeasure, StereoPartner
from orip.records.observation_kinds import measurement_name


def observation_lines(rows: Sequence[ListedObservation]) -> list[str]:
    """Return the table of measured points with the columns that ORIPROGRAM showed."""
    return table_lines(
        [
            Column("Point", [measurement_name(row.point, row.before) for row in rows], align="left"),
            Column("Photo", [row.photo for row in rows], align="left"),
            *xy_columns("{}-template", [row.measured for row in rows], 4, "mm, px"),
            *xy_columns("W{}", [row.error for row in rows], 5, "mm"),
            *xy_columns("{}_residual", [row.residual for row in rows], 5, "mm"),
            *xy_columns("SD {}", [row.sd for row in rows], 5, "mm"),
            *xy_columns("{} WF", [row.weight_factor for row in rows], 3),
            Column("Rays", [str(row.rays) for row in rows]),
            Column("", [_remark(row) for row in rows], align="left"),
        ]
    )


def _remark(row: ListedObservation) -> str:
    if row.disregarded:
        return "disregarded"
    return "down-weighted" if row.is_down_weighted else ""


def partner_lines(rows: Sequence[StereoPartner]) -> list[str]:
    """Return the table of stereo partners."""
    return table_lines(
        [
            Column("Point", [row.point for row in rows], align="left"),
            Column("Photo", [row.photo for row in rows], align="left"),
            Column("Partner", [row.partner for row in rows], align="left"),
            Column("Model", [row.model or "-" for row in rows], align="left"),
            Column("Position", [row.place for row in rows], align="left"),
            *xy_columns("{}-photo", [row.photo_xy for row in rows], 4, "mm"),
            *xy_columns("{}-plate", [row.log_xy for row in rows], 4, "mm, px"),
        ]
    )


def todo_text(rows: Sequence[PointToMeasure], title: str, bundle: str, run: str | None) -> str:
    """Return a measurement file in which the coordinates of the points to measure are still missing.

    Parameters
    ----------
    rows : sequence of PointToMeasure
        Those of a photo behind one another.
    title : str
        The names of project and user.
    run : str or None
        The adjustment that the predicted coordinates come from.
    """
    adjustment = f", after adjustment {run}" if run else ""
    if not rows:
        return f"! {title}\n! Nothing to measure again, bundle {bundle}{adjustment}.\n"
    head = [
        f"! {title}",
        f"! To measure again, bundle {bundle}{adjustment}.",
        "! Write x and y after each name (plate mm; pixels of scans and digital frames), and take out what you do not",
        "! measure; then: orip observations remeasure FILE",
    ]
    return "".join(f"{line}\n" for line in (*head, *_blocks(rows, bundle)))


def _blocks(rows: Sequence[PointToMeasure], bundle: str) -> Iterator[str]:
    width = max((len(row.point) for row in rows), default=0)
    for photo, points in itertools.groupby(rows, key=lambda row: row.photo):
        yield f"POINTS {bundle} {photo}"
        for row in points:
            yield f"  {row.point.ljust(width)}  ! {', '.join(_remarks(row))}"


def _remarks(row: PointToMeasure) -> Iterator[str]:
    yield row.why
    if not np.isnan(row.weight_factor).all():
        yield "residual {} {} mm, weight factor {} {}".format(*fixed(row.residual, 5), *fixed(row.weight_factor, 3))
    for label, xy in (("measured", row.before), ("predicted", row.predicted)):
        if not np.isnan(xy).any():
            yield "{} {} {}".format(label, *fixed(xy, 4))


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
