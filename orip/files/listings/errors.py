"""BUNDLE_ERROR.OUT and INTERIOR_RESULT.OUT: what is wrong with an adjustment, and orientations by marks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.files.listings.bundle_residuals import LEGEND, component_columns
from orip.files.listings.title import bundle_title, title_block
from orip.files.text.table import INDENT, Column, key_lines, paragraph, section, table_lines
from orip.number_text import fixed, measure
from orip.records.interior import MarkAdjustment
from orip.records.measurement import TransformationKind
from orip.records.observation_kinds import unit_of_observation
from orip.records.results.solution import Solution

TITLE_OF_ERRORS = "BUNDLE ADJUSTMENT: WARNINGS AND ERRORS"


def error_listing_lines(solution: Solution, misfits: Sequence[int]) -> Iterator[str]:
    """Yield the lines of BUNDLE_ERROR.OUT, without newlines.

    Parameters
    ----------
    misfits : sequence of int
        Rows of the residuals of what does not fit, the worst first.
    """
    yield from bundle_title(TITLE_OF_ERRORS, solution)
    yield from section("SUMMARY", _summary(solution))
    yield from section("SINGULAR UNKNOWNS, REMOVED FROM THE ADJUSTMENT", _singular(solution))
    yield from section("DIAGNOSIS", _diagnosis(solution))
    yield from section("BLUNDERS, IN THE ORDER THEY WERE FOUND", _blunders(solution))
    yield from section("OBSERVATIONS THAT DO NOT FIT, THE WORST FIRST", _misfits(solution, misfits))
    yield from section("DOWN-WEIGHTED OBSERVATIONS", _down_weighted(solution))
    yield from section("WARNINGS", _warnings(solution))


def _summary(solution: Solution) -> list[str]:
    counts = (
        ("Singular unknowns", len(solution.singular)),
        ("Weaknesses diagnosed", len(solution.diagnosis)),
        ("Blunders", len(solution.blunders)),
        ("Down-weighted observations", int(np.count_nonzero(solution.residuals.weight_factor < 1.0))),
        ("Warnings", len(solution.warnings)),
    )
    return key_lines([(label, str(count), "") for label, count in counts])


def _singular(solution: Solution) -> list[str]:
    rows = solution.singular
    return table_lines(
        [
            Column("Group", [row.group for row in rows], align="left"),
            Column("Name", [row.name for row in rows], align="left"),
            Column("Unknown", [row.kind for row in rows], align="left"),
            Column("Lost digits", fixed([row.lost_digits for row in rows], 1)),
        ]
    )


def _diagnosis(solution: Solution) -> list[str]:
    lines = []
    for row in solution.diagnosis:
        lines += _remark(row.code, row.where, row.text)
        lines += paragraph(f"What to do: {row.remedy}", indent=2 * INDENT, hanging=INDENT) if row.remedy else []
    return lines or table_lines([])


def _blunders(solution: Solution) -> list[str]:
    rows = solution.blunders
    units = [unit_of_observation(row.kind, row.component, solution.ground_unit) for row in rows]
    lines = table_lines(
        [
            Column("No.", [str(row.order) for row in rows]),
            Column("Kind", [row.kind for row in rows], align="left"),
            Column("Photo", [row.photo for row in rows], align="left"),
            Column("Point or name", [row.point for row in rows], align="left"),
            Column("Component", [row.component for row in rows], align="left"),
            Column("Size", [measure(row.size, row.sd) for row in rows], align="point"),
            Column("sd", [measure(row.sd, row.sd) for row in rows], align="point"),
            Column("Unit", units, align="left"),
            Column("Statistic", fixed([row.statistic for row in rows], 2)),
            Column("Limit", fixed([row.limit for row in rows], 2)),
        ]
    )
    for order, others in dict.fromkeys((row.order, row.alternatives) for row in rows if row.alternatives):
        lines += [
            "",
            *paragraph(f"No. {order} cannot be told apart from {others}: one of them is wrong", hanging=INDENT),
        ]
    return lines


def _misfits(solution: Solution, rows: Sequence[int]) -> list[str]:
    lines = table_lines(component_columns(solution.residuals, rows, solution.ground_unit))
    return [*lines, *LEGEND] if rows else lines


def _down_weighted(solution: Solution) -> list[str]:
    rows = np.flatnonzero(solution.residuals.weight_factor < 1.0).tolist()
    lines = table_lines(component_columns(solution.residuals, rows, solution.ground_unit))
    return [*lines, *LEGEND] if rows else lines


def _warnings(solution: Solution) -> list[str]:
    lines = []
    for code, where, text in solution.warnings:
        lines += _remark(code, where, text)
    return lines or table_lines([])


def _remark(code: str, where: str, text: str) -> list[str]:
    place = f"{where}: " if where else ""
    return paragraph(f"[{code}] {place}{text}", hanging=INDENT)


TITLE_OF_ORIENTATIONS = "INTERIOR ORIENTATION: RESULTS"

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
    yield from title_block(TITLE_OF_ORIENTATIONS, run, (("Project", project), ("User", user)))
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
