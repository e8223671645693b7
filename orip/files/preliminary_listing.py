"""PRELIM_RESULT.OUT: the listing of how preliminary values were found, and of the values themselves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.files.listing_title import title_block
from orip.files.number_text import fixed
from orip.files.preliminary_steps import (
    failure_lines,
    relative_orientation_lines,
    relative_overview,
    similarity_lines,
    similarity_overview,
)
from orip.files.text_table import Column, paragraph, section, table_lines
from orip.model.photo import PHOTO_PARAMETERS
from orip.model.preliminary import PreliminaryValues, SimilarityStep

TITLE = "PRELIMINARY VALUES"


def preliminary_listing(
    values: PreliminaryValues,
    orientations: Sequence[Sequence[float]],
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
    ground_unit : str
    facts : sequence of (label, text)
        Project, user and bundle for the title.
    run : str
        Run id.
    """
    lines = preliminary_listing_lines(values, orientations, ground_unit, facts, run)
    return "".join(f"{line}\n" for line in lines)


def preliminary_listing_lines(
    values: PreliminaryValues,
    orientations: Sequence[Sequence[float]],
    ground_unit: str,
    facts: Sequence[tuple[str, str]],
    run: str,
) -> Iterator[str]:
    """Yield the lines of PRELIM_RESULT.OUT, without newlines."""
    yield from title_block(TITLE, run, facts)
    if values.findings:
        yield from section("FINDINGS", [line for each in values.findings for line in paragraph(each, hanging=2)])
    yield from section("HOW EACH PHOTO WAS ORIENTED", _how(values))
    if values.failures:
        yield from section("WHAT COULD NOT BE ORIENTED", failure_lines(values.failures))
    if values.relative:
        yield from section("RELATIVE ORIENTATION", relative_overview(values.relative))
    yield from _similarities("MODEL BRIDGING", values.bridges)
    yield from _similarities("CONNECTION", values.connections)
    if values.absolute is not None:
        yield from section("ABSOLUTE ORIENTATION", similarity_lines(values.absolute))
    yield from section("PHOTOS", _photos(values, orientations, ground_unit))
    yield from section("POINTS", _points(values, ground_unit))
    if values.relative:
        details = [line for model in values.relative for line in relative_orientation_lines(model)]
        yield from section("RELATIVE ORIENTATION: POINTS AND PARAMETERS", details)
    for title, steps in (("MODEL BRIDGING", values.bridges), ("CONNECTION", values.connections)):
        if steps:
            details = [line for step in steps for line in similarity_lines(step)]
            yield from section(f"{title}: POINTS AND PARAMETERS", details)


def _similarities(title: str, steps: Sequence[SimilarityStep]) -> Iterator[str]:
    if steps:
        yield from section(title, similarity_overview(steps))


def _how(values: PreliminaryValues) -> list[str]:
    return table_lines(
        [
            Column("Photo", [each.name for each in values.photos], align="left"),
            Column("", [each.how for each in values.photos], align="left"),
        ]
    )


def _photos(values: PreliminaryValues, orientations: Sequence[Sequence[float]], ground_unit: str) -> list[str]:
    table = np.array(orientations, dtype=np.float64).reshape(-1, 6)
    units = [ground_unit] * 3 + ["degrees"] * 3
    return table_lines(
        [
            Column("Photo", [each.name for each in values.photos], align="left"),
            *(Column(kind, fixed(table[:, k], 3 if k < 3 else 4), units[k]) for k, kind in enumerate(PHOTO_PARAMETERS)),
        ]
    )


def _points(values: PreliminaryValues, ground_unit: str) -> list[str]:
    xyz = np.array([each.coordinates for each in values.points], dtype=np.float64).reshape(-1, 3)
    unknown = (np.nan,) * 3
    sd = np.array([each.deviations or unknown for each in values.points], dtype=np.float64).reshape(-1, 3)
    return table_lines(
        [
            Column("Point", [each.name for each in values.points], align="left"),
            *(Column(axis, fixed(xyz[:, k], 3), ground_unit) for k, axis in enumerate("XYZ")),
            *(Column(f"s{axis}", fixed(sd[:, k], 3), ground_unit) for k, axis in enumerate("XYZ")),
        ]
    )
