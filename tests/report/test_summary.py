"""The summary at the terminal: the report's questions in its order, with its figures, and no longer than it may be."""

from __future__ import annotations

import re
import textwrap
from functools import partial

import numpy as np
import pytest
from report.sample_pages import SAMPLES, Page, sample
from scipy import stats

from orip.bundle.groups.words import CODE, EXPLAINED
from orip.bundle.results.reliability import suspect_rows, suspicious_w
from orip.files.listings.errors import error_listing_lines
from orip.records.results.solution import Blunder, Diagnosis, Estimates, Residuals, SingularUnknown, Solution
from orip.records.results.tests import Gate, GateResult
from orip.report.summary import MOST_LINES, SummaryLine, summary
from orip.report.table import significant
from orip.report.trouble import suspects
from orip.structs import replace

ORDER = ["status", "sigma0", "check", "gate", "misfit", "note", "weak", "points", "photos", "camera"]
HEIGHT = partial(textwrap.wrap, width=80 - 9, break_on_hyphens=False)


def summary_of(solution: Solution, *gates: GateResult) -> tuple[SummaryLine, ...]:
    return summary(solution, gates, "BUNDLE_ERROR.OUT")


def height(lines: tuple[SummaryLine, ...]) -> int:
    return sum(len(HEIGHT(line.text)) for line in lines)


def under(lines: tuple[SummaryLine, ...], label: str) -> str:
    """Return a labelled line and those that continue it, as one text with plain blanks."""
    found, taking = [], False
    for line in lines:
        taking = line.label == label or (taking and not line.label)
        if taking:
            found.append(line.text)
    return " ".join(found).replace("\N{NO-BREAK SPACE}", " ")


def gate(number: int, passed: bool) -> GateResult:
    return GateResult(Gate("sigma0", "<=", float(number)), 5.5, passed)


@pytest.mark.parametrize("name", SAMPLES)
def test_questions_come_in_the_order_of_the_page(name: str) -> None:
    lines = summary_of(sample(name).solution)
    labels = [line.label for line in lines if line.label]
    assert labels == sorted(labels, key=ORDER.index)
    assert labels[:2] == ["status", "sigma0"]
    assert height(lines) <= MOST_LINES


@pytest.mark.parametrize("name", SAMPLES)
def test_it_says_of_sigma0_and_the_check_points_what_the_page_says(name: str) -> None:
    found = sample(name)
    said = under(summary_of(found.solution), "sigma0")
    sigma0, _, rest = said.partition(", ")
    assert sigma0 == f"{found.result['sigma0']:.4f}"
    assert rest.partition(" (chi-square test)")[0] in "".join(Page(found.page).words)
    assert f"{found.result['observations']} observations, {found.result['unknowns']} unknowns" in said
    check = under(summary_of(found.solution), "check")
    assert bool(check) == bool(found.result["check_points"])
    assert check in found.page


def test_the_blunders_of_the_simulated_block_are_named_with_their_size() -> None:
    lines = summary_of(sample("small_frame_block").solution)
    said = under(lines, "misfit")
    # truth.json: 1307 in photo 104 was mispointed by 0.045 and -0.070 mm
    assert "photo 203 point 1213: probably off by x 0.78" in said
    assert "photo 104 point 1307: probably off by y -0.067" in said
    (level,) = [line.level for line in lines if line.label == "misfit"]
    assert level == "bad"
    assert lines[0] == SummaryLine(
        "status", "doubtful: observations do not fit; see the warning about photo 203", "caution"
    )


def test_precision_is_that_of_result_json() -> None:
    found = sample("small_frame_block")
    said = under(summary_of(found.solution), "points")
    for axis in "XYZ":
        sd = np.array([point[axis]["sd"] for point in found.result["points"].values() if point[axis]["sd"] is not None])
        assert f"{axis} {significant(float(np.sqrt(np.mean(sd**2))))}/{significant(float(sd.max()))}" in said


def test_parameters_of_the_camera_with_what_is_significant() -> None:
    said = under(summary_of(sample("small_frame_block").solution), "camera")
    assert said.startswith("REFLEX35 C 35.361 ± 0.060, DX 0.177 ± 0.023, DY -0.055 ± 0.033; significant: A3, A5")
    solution = sample("small_frame_block").solution
    sd = solution.cameras.sd.copy()
    sd[0, 5] *= 1e3  # A5
    weaker = replace(solution, cameras=replace(solution.cameras, sd=sd))
    assert under(summary_of(weaker), "camera").endswith("; significant: A3; not significant: A5")


def test_a_camera_that_was_held_is_not_mentioned() -> None:
    assert under(summary_of(sample("zurich_city_hall").solution), "camera") == ""


def test_failed_gates_come_first_and_the_verdict_has_them() -> None:
    solution = sample("dcs260_calibration").solution
    lines = summary_of(solution, gate(6, True), gate(7, True), gate(8, True), gate(5, False))
    assert (lines[0].text, lines[0].level) == ("converged, but 1 gate failed", "bad")
    first, *_ = [line for line in lines if line.label == "gate"]
    assert (first.text, first.level) == ("FAIL sigma0 <= 5 (5.5)", "bad")
    assert "1 of 4 gates failed; 'orip check' shows each" in under(lines, "gate")


@pytest.mark.parametrize(("status", "said"), [("not_converged", "not converged"), ("stopped", "stopped")])
def test_what_is_not_to_be_used_is_not_praised_for_its_precision(status: str, said: str) -> None:
    solution = replace(sample("small_frame_block").solution, status=status)  # type: ignore[arg-type]
    lines = summary_of(solution)
    assert lines[0] == SummaryLine("status", f"{said}: do not use its values", "bad")
    assert not {line.label for line in lines} & {"points", "photos", "camera", "weak"}


def test_what_has_no_room_is_counted() -> None:
    notes = tuple(Diagnosis("correlation", "", f"text {number} " + "word " * 30, "remedy") for number in range(7))
    lines = summary_of(replace(sample("small_frame_block").solution, diagnosis=notes))
    shown = sum(line.label == "note" for line in lines)
    assert 0 < shown < 7
    assert f"+{7 - shown} more in BUNDLE_ERROR.OUT" in under(lines, "note")
    assert height(lines) <= MOST_LINES


def test_when_all_is_wrong_at_once_it_is_no_longer() -> None:
    solution = sample("small_frame_block").solution
    long = "word " * 30
    cameras = Estimates(
        tuple(f"CAMERA{number}" for number in range(5)),
        np.repeat(solution.cameras.values, 5, axis=0),
        np.repeat(solution.cameras.sd, 5, axis=0),
    )
    wrong = replace(
        solution,
        cameras=cameras,
        singular=(SingularUnknown("POINT", "1", "X", 12.0),),
        diagnosis=tuple(Diagnosis("undetermined", "", long, "remedy") for _ in range(9)),
        blunders=(Blunder(1, "photo", "1", "2", "x", 1.0, 0.1, 10.0, 3.3),),
    )
    lines = summary_of(wrong, *(gate(number, False) for number in range(5)))
    assert height(tuple(line for line in lines if line.label != "camera")) <= MOST_LINES
    # the results of the camera are reported, however much else there is to report
    assert under(lines, "camera").startswith("CAMERA0 C 35.361")
    assert not {line.label for line in lines} & {"weak", "points", "photos"}
    assert lines[0].text == "doubtful: converged, but 1 unknown could not be determined"
    assert {"status", "sigma0", "check", "gate", "misfit", "note"} <= {line.label for line in lines}
    assert [line.level for line in lines if line.label == "note"] == ["bad"]


def test_without_redundancy_there_is_no_test() -> None:
    solution = replace(sample("dcs260_calibration").solution, redundancy=0, redundancy_used=0.0, sigma0=float("nan"))
    assert under(summary_of(solution), "sigma0").startswith("not known, nothing is redundant to test it")


def test_where_nothing_has_full_weight_sigma0_is_not_said_to_lack_redundancy() -> None:
    solution = replace(sample("dcs260_calibration").solution, redundancy=18, redundancy_used=0.0, sigma0=float("nan"))
    said = under(summary_of(solution), "sigma0")
    assert said.startswith("not known, no observation with full weight is checked by another one")


def test_what_to_do_about_a_contradicting_group_follows_the_first_sentence() -> None:
    contradicting = Diagnosis(CODE, "distances", "all distances are off by about +1.0 m", "check their unit")
    other = Diagnosis("correlation", "", "something else", "remedy")
    solution = replace(sample("dcs260_calibration").solution, diagnosis=(contradicting, other))
    lines = summary_of(solution)
    assert lines[0] == SummaryLine("status", "converged, but all distances are off by about +1.0 m", "caution")
    assert lines[1] == SummaryLine("", "check their unit")
    assert under(lines, "note") == "something else: remedy"


def with_normalised_residuals(w: np.ndarray) -> Solution:
    """Return a solution with these normalised residuals and much redundancy."""
    ones = np.ones(len(w))
    names = ("1",) * len(w)
    of_photos = Residuals(
        ("photo",) * len(w), names, names, ("x",) * len(w), w, w, ones, np.abs(w), ones, ones, np.abs(w)
    )
    return replace(sample(SAMPLES[0]).solution, residuals=of_photos, redundancy=1_000_000)


@pytest.mark.parametrize(("code", "listed"), [(CODE, True), (EXPLAINED, False)])
def test_misfits_are_not_listed_where_a_warning_names_the_cause(code: str, listed: bool) -> None:
    found = Diagnosis(code, "exposure stations", "all are off by about +1.0 m", "first correct them")
    solution = replace(with_normalised_residuals(np.r_[np.zeros(99), 9.0]), diagnosis=(found,))
    lines = summary_of(solution)
    assert lines[0].text.startswith("converged, but all are off")
    assert ("measure again" in under(lines, "misfit")) is listed
    assert ("look at them after" in under(lines, "misfit")) is not listed


def test_what_is_listed_as_misfitting_follows_the_number_of_observations() -> None:
    # one good residual in a thousand is beyond 3.29: of 20 000 some twenty, of which a summary must not speak
    random = np.random.default_rng(4)
    many = random.normal(size=20_000)
    assert np.count_nonzero(np.abs(many) > 3.29) > 10
    assert suspect_rows(with_normalised_residuals(many)).size == 0
    # 4.71 is the limit of 20 000 with 0.05 for all of them together (normal distribution)
    assert suspicious_w(with_normalised_residuals(many)) == pytest.approx(stats.norm.isf(0.025 / 20_000), abs=0.01)
    many[700] = -5.0
    assert suspect_rows(with_normalised_residuals(many)).tolist() == [700]
    # few observations: 0.001 for each
    assert suspicious_w(with_normalised_residuals(many[:40])) == pytest.approx(stats.norm.isf(0.0005), abs=0.01)


def test_what_the_summary_says_is_in_the_listing_is_there() -> None:
    solution = sample("small_frame_block").solution
    rows = suspect_rows(solution).tolist()
    assert f"+{len(suspects(solution)) - 1} more in BUNDLE_ERROR.OUT" in " ".join(
        line.text for line in summary_of(replace(solution, diagnosis=(LONG_NOTE,) * 9))
    )
    listed = "\n".join(error_listing_lines(solution, rows)).partition("OBSERVATIONS THAT DO NOT FIT")[2]
    listed = listed.partition("DOWN-WEIGHTED")[0]
    for row in rows:
        residuals = solution.residuals
        assert re.search(rf"{residuals.photo[row]} +{residuals.point[row]} +{residuals.component[row]} ", listed)


LONG_NOTE = Diagnosis("correlation", "", "word " * 60, "remedy")
