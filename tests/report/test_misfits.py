"""Observations that do not fit: what chance explains is none of them, and all outputs count the same."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from report.sample_pages import sample, sample_project

from orip.bundle.results.reliability import number_by_chance, suspect_rows, suspicious_w
from orip.records.camera import Camera, Sensor
from orip.records.definition import BundleDefinition
from orip.records.names import record_key
from orip.records.observation_kinds import named_observation
from orip.records.photo import Photo
from orip.records.results.solution import Solution
from orip.report.report_input import ReportInput
from orip.report.summary import summary
from orip.report.trouble import suspect_table, suspects, weak_spots
from orip.structs import replace


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


@pytest.mark.parametrize(("unchecked", "spots"), [(40, 40), (70, 1)])
def test_of_points_that_nobody_measures_again_by_hand_one_hint_says_all(unchecked: int, spots: int) -> None:
    solution = sample("small_frame_block").solution
    residuals = solution.residuals
    first = {point: row for row, point in reversed(list(enumerate(residuals.point))) if residuals.kind[row] == "photo"}
    numbers = np.ones_like(residuals.redundancy_number)
    numbers[sorted(first.values())[:unchecked]] = 0.05
    rays = np.maximum(solution.point_rays, 3)
    changed = replace(solution, point_rays=rays, residuals=replace(residuals, redundancy_number=numbers))
    found = [spot for spot in weak_spots(changed) if "hardly checked" in spot.what]
    assert len(found) == spots
    assert found[0].where == ("70 points" if spots == 1 else f"point {min(first, key=first.__getitem__)}")
    assert ("measure" in found[0].remedy) == (spots > 1)


def of_page(solution: Solution) -> ReportInput:
    return ReportInput(solution, (), BundleDefinition("MAIN"), {}, {})


def test_probable_sizes_are_in_pixels_too_where_these_were_measured() -> None:
    solution = with_w(1.05 * suspicious_w(with_w(1.0)))
    camera = Camera("GRID", (50.0, *(0.0,) * 12), sensor=Sensor(3000, 2000, 36.0, 24.0))
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


def test_at_the_classical_level_the_limit_does_not_grow_with_the_block() -> None:
    limit = suspicious_w(with_w(1.0))
    # the quantile of tau for a thousandth, which is 3.29 for large redundancies
    classical = suspicious_w(with_w(1.0), 0.001)
    assert 3.2 < classical < 3.3 < limit
    solution = with_w((classical + limit) / 2.0)
    assert suspects(solution) == {}
    assert len(suspects(solution, 0.001)) == 1
    assert number_by_chance(solution, 0.001) == 0
    table = suspect_table(replace(of_page(solution), test_level=0.001))
    assert table is not None
    assert "each test has an error probability of 0.001" in table.note
    label = [line.text for line in summary(solution, (), "BUNDLE_ERROR.OUT", 0.001) if line.label == "misfit"]
    assert label[0].startswith("1 observation does not fit")


def test_the_level_of_orip_toml_is_that_of_listing_summary_and_report(tmp_path: Path) -> None:
    folder = sample_project("dcs260_calibration", tmp_path / "grid")
    outputs = []
    for level in ("", "[check]\ntest_level = 0.2\n\n"):
        text = (folder / "orip.toml").read_text(encoding="utf-8")
        begin, rest = text.split("[[camera]]", 1)
        (folder / "orip.toml").write_text(f"{begin}{level}[[camera]]{rest}", encoding="utf-8")
        said = orip(folder, "run").told
        found = re.search(r"(\d+) observations? (?:does|do) not fit", said)
        page = (folder / "report.html").read_text(encoding="utf-8")
        on_page = re.search(r"(\d+) observations?, \d+ components?;", page)
        outputs.append([int(match[1]) if match else 0 for match in (found, on_page)])
    (plain, plain_page), (many, many_page) = outputs
    assert plain == plain_page
    assert many == many_page > plain
    assert "test_level = 0.2" in orip(folder, "export-toml").out


@pytest.mark.parametrize(
    ("kind", "photo", "point", "component", "name"),
    [
        ("element", "DJI_0005", "", "Z0", "Z0 of photo DJI_0005"),
        ("constant element", "P1", "", "KAPPA", "KAPPA of photo P1"),
        ("element", "", "17", "X", "X of point 17"),
        ("element", "", "C35", "A3", "A3 of camera C35"),
        ("photo", "P1", "17", "x", "photo P1 point 17"),
        ("distance", "", "BAR1", "length", "distance BAR1"),
    ],
)
def test_observations_are_called_by_what_they_observe(
    kind: str, photo: str, point: str, component: str, name: str
) -> None:
    assert named_observation(kind, photo, point, component) == name
