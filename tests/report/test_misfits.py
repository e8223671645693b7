"""Observations that do not fit: what chance explains is none of them, and all outputs count the same."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from report.sample_pages import sample

from orip.records.results.solution import Solution
from orip.report.misfits import number_by_chance, suspect_rows, suspects, suspicious_w
from orip.report.summary import summary
from orip.report.trouble import suspect_table


def with_w(largest: float) -> Solution:
    """Return a solution whose residuals are all small, the first two of which have a w of this size and lost weight."""
    solution = sample("dcs260_calibration").solution
    residuals = solution.residuals
    w, weight = np.full_like(residuals.w, 0.5), np.ones_like(residuals.weight_factor)
    w[:2], weight[:2] = [largest, 0.1], 0.2
    return replace(solution, residuals=replace(residuals, w=w, weight_factor=weight))


def test_what_lost_weight_by_chance_does_not_misfit() -> None:
    solution = with_w(0.95 * suspicious_w(with_w(1.0)))
    assert suspects(solution) == {}
    assert suspect_table(solution) is None
    assert number_by_chance(solution) == 1


def test_what_chance_does_not_explain_misfits_with_all_that_lost_weight_beside_it() -> None:
    solution = with_w(1.05 * suspicious_w(with_w(1.0)))
    assert len(suspects(solution)) == 1
    assert suspect_rows(solution).tolist() == [0, 1]
    assert number_by_chance(solution) == 0


def test_summary_and_report_count_alike() -> None:
    solution = sample("small_frame_block").solution
    (misfit,) = [line.text for line in summary(solution, (), "BUNDLE_ERROR.OUT") if line.label == "misfit"]
    table = suspect_table(solution)
    assert table is not None
    counts = [re.match(r"(\d+) observations?", text) for text in (misfit, table.note)]
    assert None not in counts
    assert len({found[1] for found in counts if found}) == 1
