"""BUNDLE_ERROR.OUT: what is wrong or doubtful with a bundle adjustment, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.files.listings.bundle_residuals import LEGEND, component_columns
from orip.files.listings.title import bundle_title
from orip.files.text.table import INDENT, Column, key_lines, paragraph, section, table_lines
from orip.number_text import fixed, measure
from orip.records.observations.observation_kinds import unit_of_observation
from orip.records.results.solution import Solution

TITLE = "BUNDLE ADJUSTMENT: WARNINGS AND ERRORS"


def error_listing_lines(solution: Solution, misfits: Sequence[int]) -> Iterator[str]:
    """Yield the lines of BUNDLE_ERROR.OUT, without newlines.

    Parameters
    ----------
    solution : Solution
    misfits : sequence of int
        Rows of the residuals of what does not fit, the worst first.
    """
    yield from bundle_title(TITLE, solution)
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
