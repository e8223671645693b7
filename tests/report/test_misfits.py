"""Observations that do not fit: what chance explains is none of them, and all outputs count the same."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from report.sample_pages import sample

from orip.records.names import record_key
from orip.records.project.camera import Camera, Sensor
from orip.records.project.definition import BundleDefinition
from orip.records.project.photo import Photo
from orip.records.results.solution import Solution
from orip.report.misfits import number_by_chance, suspect_rows, suspects, suspicious_w
from orip.report.report_input import ReportInput
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
    assert suspect_table(of_page(solution)) is None
    assert number_by_chance(solution) == 1


def test_what_chance_does_not_explain_misfits_with_all_that_lost_weight_beside_it() -> None:
    solution = with_w(1.05 * suspicious_w(with_w(1.0)))
    assert len(suspects(solution)) == 1
    assert suspect_rows(solution).tolist() == [0, 1]
    assert number_by_chance(solution) == 0


def test_summary_and_report_count_alike() -> None:
    solution = sample("small_frame_block").solution
    (misfit,) = [line.text for line in summary(solution, (), "BUNDLE_ERROR.OUT") if line.label == "misfit"]
    table = suspect_table(of_page(solution))
    assert table is not None
    counts = [re.match(r"(\d+) observations?", text) for text in (misfit, table.note)]
    assert None not in counts
    assert len({found[1] for found in counts if found}) == 1


def of_page(solution: Solution) -> ReportInput:
    return ReportInput(solution, (), BundleDefinition("MAIN"), {}, {})


def test_probable_sizes_are_in_pixels_too_where_these_were_measured() -> None:
    solution = with_w(1.05 * suspicious_w(with_w(1.0)))
    camera = Camera("GRID", (50.0,), sensor=Sensor(3000, 2000, 36.0, 24.0))
    photos = {record_key(name): Photo(name, "GRID") for name in solution.photos.names}
    table = suspect_table(ReportInput(solution, (), BundleDefinition("MAIN"), {record_key("GRID"): camera}, photos))
    plain = suspect_table(of_page(solution))
    assert table is not None
    assert plain is not None
    millimetres, pixels = [column for column in table.columns if column.heading == "Probable size"]
    assert pixels.unit == "px"
    # 36 mm on 3000 columns; pixels are shown with one decimal
    assert float(pixels.cells[0]) == pytest.approx(float(millimetres.cells[0]) / 0.012, abs=0.1)
    assert [column.heading for column in plain.columns].count("Probable size") == 1
