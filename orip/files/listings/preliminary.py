"""PRELIM_RESULT.OUT: the listing of how preliminary values were found, and of the values themselves."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from orip.files.listings.preliminary_steps import (
    failure_lines,
    relative_orientation_lines,
    relative_overview,
    relative_remarks,
    similarity_lines,
    similarity_overview,
    similarity_remarks,
)
from orip.files.listings.title import title_block
from orip.files.text.table import INDENT, PAGE_WIDTH, Column, one_line, paragraph, section, table_lines
from orip.number_text import decimals_for, fixed
from orip.records.observations.control import PreliminaryPoint
from orip.records.project.camera import CAMERA_PARAMETERS
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.records.results.preliminary import CameraStart, PreliminaryValues, SimilarityStep

TITLE = "PRELIMINARY VALUES"


def preliminary_listing(
    values: PreliminaryValues,
    orientations: Sequence[Sequence[float]],
    points: Sequence[PreliminaryPoint],
    ground_unit: str,
    facts: Sequence[tuple[str, str]],
    run: str,
) -> str:
    """Return PRELIM_RESULT.OUT as one text with a newline at its end.

    Parameters
    ----------
    values : PreliminaryValues
    orientations : sequence of 6 floats a photo
        Elements of `values.photos` as in the files: ground unit and degrees; NaN where there are none.
    points : sequence of PreliminaryPoint
        Those of `values` in the project's coordinates.
    ground_unit : str
    facts : sequence of (label, text)
        Project, user and bundle for the title.
    run : str
        Run id.
    """
    lines = chain(title_block(TITLE, run, facts), _sections(values, orientations, points, ground_unit))
    return "".join(f"{line}\n" for line in lines)


def _sections(
    values: PreliminaryValues,
    orientations: Sequence[Sequence[float]],
    points: Sequence[PreliminaryPoint],
    ground_unit: str,
) -> Iterator[str]:
    if values.findings:
        yield from section("FINDINGS", [line for finding in values.findings for line in paragraph(finding, hanging=2)])
    yield from section("HOW EACH PHOTO WAS ORIENTED", _how(values))
    if values.failures:
        yield from section("WHAT COULD NOT BE ORIENTED", failure_lines(values.failures))
    if values.relative:
        said = relative_remarks(values.relative)
        yield from section("RELATIVE ORIENTATION", [*relative_overview(values.relative), *said])
    yield from _similarities("MODEL BRIDGING", values.bridges)
    yield from _similarities("CONNECTION", values.connections)
    if values.absolute is not None:
        yield from section("ABSOLUTE ORIENTATION", similarity_lines(values.absolute, ground_unit))
    if values.cameras:
        yield from section("CAMERAS", _cameras(values.cameras))
    yield from section("PHOTOS", _photos(values, orientations, points, ground_unit))
    yield from section("POINTS", _points(points, ground_unit))
    if values.relative:
        details = [line for model in values.relative for line in relative_orientation_lines(model)]
        yield from section("RELATIVE ORIENTATION: POINTS AND PARAMETERS", details)
    for title, steps in (("MODEL BRIDGING", values.bridges), ("CONNECTION", values.connections)):
        if steps:
            details = [line for step in steps for line in similarity_lines(step, ground_unit)]
            yield from section(f"{title}: POINTS AND PARAMETERS", details)


def _similarities(title: str, steps: Sequence[SimilarityStep]) -> Iterator[str]:
    if steps:
        yield from section(title, [*similarity_overview(steps), *similarity_remarks(steps)])


def _how(values: PreliminaryValues) -> list[str]:
    width = PAGE_WIDTH - 2 * INDENT - max(len("Photo"), *(len(photo.name) for photo in values.photos))
    wrapped = [textwrap.wrap(one_line(photo.how), width) or [""] for photo in values.photos]
    names = [
        name
        for photo, lines in zip(values.photos, wrapped, strict=True)
        for name in (photo.name, *[""] * (len(lines) - 1))
    ]
    return table_lines(
        [
            Column("Photo", names, align="left"),
            Column("How", [line for lines in wrapped for line in lines], align="left"),
        ]
    )


def _cameras(cameras: Sequence[CameraStart]) -> list[str]:
    """Return what preliminary values contain of unknown cameras."""
    parameters = np.array([camera.parameters for camera in cameras])
    return table_lines(
        [
            Column("Camera", [camera.name for camera in cameras], align="left"),
            *(Column(kind, fixed(parameters[:, CAMERA_PARAMETERS.index(kind)], 3), "mm") for kind in ("C", "DX", "DY")),
            Column("A3", [f"{value:.3e}" for value in parameters[:, CAMERA_PARAMETERS.index("A3")]], "1/mm²"),
        ]
    )


def _photos(
    values: PreliminaryValues,
    orientations: Sequence[Sequence[float]],
    points: Sequence[PreliminaryPoint],
    ground_unit: str,
) -> list[str]:
    table = np.array(orientations, dtype=np.float64).reshape(-1, 6)
    units = [ground_unit] * 3 + ["degrees"] * 3
    decimals = [_decimals(points)] * 3 + [4] * 3
    return table_lines(
        [
            Column("Photo", [photo.name for photo in values.photos], align="left"),
            *(Column(kind, fixed(table[:, k], decimals[k]), units[k]) for k, kind in enumerate(PHOTO_PARAMETERS)),
        ]
    )


def _points(points: Sequence[PreliminaryPoint], ground_unit: str) -> list[str]:
    xyz = np.array([point.coordinates for point in points], dtype=np.float64).reshape(-1, 3)
    sd = _deviations(points)
    decimals = _decimals(points)
    return table_lines(
        [
            Column("Point", [point.name for point in points], align="left"),
            *(Column(axis, fixed(xyz[:, k], decimals), ground_unit) for k, axis in enumerate("XYZ")),
            *(Column(f"s{axis}", fixed(sd[:, k], decimals), ground_unit) for k, axis in enumerate("XYZ")),
        ]
    )


def _deviations(points: Sequence[PreliminaryPoint]) -> NDArray[np.float64]:
    unknown = (np.nan,) * 3
    return np.array([point.deviations or unknown for point in points], dtype=np.float64).reshape(-1, 3)


def _decimals(points: Sequence[PreliminaryPoint]) -> int:
    """Return the decimals with which a typical standard deviation has two significant digits."""
    sd = _deviations(points)
    return decimals_for(np.nanmedian(sd) if np.isfinite(sd).any() else [])
