"""INTERIOR_RESULT.OUT: the listing of template and photo orientations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.files.listings.title import title_block
from orip.files.text.table import INDENT, Column, paragraph, section, table_lines
from orip.number_text import fixed
from orip.records.observations.measurement import TransformationKind
from orip.records.results.interior import MarkAdjustment

TITLE = "INTERIOR ORIENTATION: RESULTS"

TRANSFORMATION_NAMES: dict[TransformationKind, str] = {
    "A": "affine",
    "C": "conformal",
    "W": "conformal without scale",
}

GROUP_NAMES = {"templates": "Template", "photos": "Photo"}

TARGETS = {"templates": "template", "photos": "photo"}
"""The system that an orientation transforms to; the given coordinates of its marks are in it."""


def interior_listing(adjustments: Sequence[MarkAdjustment], project: str, user: str, run: str) -> str:
    """Return INTERIOR_RESULT.OUT as one text with a newline at its end."""
    return "".join(f"{line}\n" for line in interior_listing_lines(adjustments, project, user, run))


def interior_listing_lines(adjustments: Sequence[MarkAdjustment], project: str, user: str, run: str) -> Iterator[str]:
    """Yield the lines of INTERIOR_RESULT.OUT, without newlines: an overview, then every template and every photo.

    Parameters
    ----------
    adjustments : sequence of MarkAdjustment
        In any order; templates are listed first.
    project, user, run : str
        Names on the listing, and the run id of the stores.
    """
    ordered = sorted(adjustments, key=lambda adjustment: adjustment.summary.group != "templates")
    yield from title_block(TITLE, run, (("Project", project), ("User", user)))
    yield from section("OVERVIEW", _overview(ordered))
    for group, title in (("templates", "TEMPLATE ORIENTATIONS"), ("photos", "PHOTO ORIENTATIONS")):
        lines = [line for one in ordered if one.summary.group == group for line in _orientation(one)]
        yield from section(title, lines or table_lines([]))


def _overview(adjustments: Sequence[MarkAdjustment]) -> list[str]:
    summaries = [adjustment.summary for adjustment in adjustments]
    return table_lines(
        [
            Column("Record", [GROUP_NAMES[summary.group] for summary in summaries], align="left"),
            Column("Name", [summary.name for summary in summaries], align="left"),
            Column("Transformation", [TRANSFORMATION_NAMES[one.kind] for one in adjustments], align="left"),
            Column("Marks", [str(len(one.marks.names)) for one in adjustments]),
            Column("Disregarded", [str(int(one.marks.disregarded.sum())) for one in adjustments]),
            Column("Redundancy", [str(summary.redundancy) for summary in summaries]),
            Column("s0", fixed([summary.s0 for summary in summaries], 5), "mm"),
            Column("Largest v", fixed([_largest_residual(one) for one in adjustments], 5), "mm"),
            Column("", ["mirrored" if one.mirrored else "" for one in adjustments], align="left"),
        ]
    )


def _largest_residual(adjustment: MarkAdjustment) -> float:
    sizes = np.hypot(adjustment.residuals[:, 0], adjustment.residuals[:, 1])[~adjustment.marks.disregarded]
    return float(sizes.max()) if sizes.size else float("nan")


def _orientation(adjustment: MarkAdjustment) -> list[str]:
    summary, target = adjustment.summary, TARGETS[adjustment.summary.group]
    stage = f", {adjustment.stage} stage" if adjustment.stage else ""
    header = (
        f"{GROUP_NAMES[summary.group]} {summary.name}:  {adjustment.system} to {target} system, "
        f"transformation {TRANSFORMATION_NAMES[adjustment.kind]}{stage}"
    )
    return [
        "",
        " " * INDENT + header,
        "",
        *_marks(adjustment, target),
        "",
        *_parameters(adjustment),
        *_remarks(adjustment),
    ]


def _marks(adjustment: MarkAdjustment, target: str) -> list[str]:
    marks, given, residuals = adjustment.marks, adjustment.given, adjustment.residuals
    system = adjustment.system
    return table_lines(
        [
            Column("Mark", marks.names, align="left"),
            *(Column(f"{axis}-{target}", fixed(given[:, k], 4), "mm") for k, axis in enumerate("XY")),
            *(Column(f"{axis}-{system}", fixed(marks.measured[:, k], 4), "mm") for k, axis in enumerate("XY")),
            *(Column(f"V{axis}", fixed(residuals[:, k], 5), "mm") for k, axis in enumerate("XY")),
            Column("", ["disregarded" if flag else "" for flag in marks.disregarded.tolist()], align="left"),
        ],
        indent=2 * INDENT,
    )


def _parameters(adjustment: MarkAdjustment) -> list[str]:
    summary = adjustment.summary
    return table_lines(
        [
            *(Column(label, fixed([value], 4), "mm") for label, value in (("x0", summary.x0), ("y0", summary.y0))),
            *(Column(label, fixed([value], 6), "degrees") for label, value in (("ro", summary.ro), ("sk", summary.sk))),
            *(Column(label, fixed([value], 8)) for label, value in (("sx", summary.sx), ("sy", summary.sy))),
            Column("s0", fixed([summary.s0], 5), "mm"),
            Column("Redundancy", [str(summary.redundancy)]),
        ],
        indent=2 * INDENT,
    )


def _remarks(adjustment: MarkAdjustment) -> list[str]:
    remarks = []
    if adjustment.mirrored:
        remarks.append("Mirror image: the film lies upside down, or the axes of marks or scan are mixed up.")
    if adjustment.summary.redundancy == 0:
        remarks.append("Redundancy 0: nothing checks these marks; a wrong one is not seen. Measure more of them.")
    lines = [line for remark in remarks for line in paragraph(remark, indent=2 * INDENT)]
    return ["", *lines] if lines else []
