"""The chi-square test of sigma0, and what the page says first."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from files.hand_built_solutions import awkward
from scipy.stats import chi2

from orip.bundle.groups.words import CODE
from orip.bundle.verdict import GlobalTest, Untested, global_test, sigma0_finding
from orip.files.text.decimal_numbers import parse_gate
from orip.records.definition import BundleDefinition
from orip.records.results.solution import Blunder, Diagnosis, Solution
from orip.records.results.tests import GateResult
from orip.report.first_page import verdict
from orip.report.report_input import ReportInput
from orip.structs import replace


def without_misfits(solution: Solution) -> Solution:
    rows = solution.residuals
    return replace(solution, residuals=replace(rows, w=0.0 * rows.w, weight_factor=np.ones_like(rows.weight_factor)))


QUIET = replace(
    without_misfits(awkward()), status="converged", singular=(), blunders=(), diagnosis=(), check_points=(), sigma0=1.0,
    redundancy_used=400.0,
)  # fmt: skip


def test_a_result_with_observations_that_do_not_fit_is_not_called_inconspicuous() -> None:
    quiet = replace(QUIET, residuals=awkward().residuals)
    assert headline(quiet) == ("caution", "Converged; not all observations fit")


def headline(solution: Solution, *gates: GateResult) -> tuple[str, str]:
    test = global_test(solution.sigma0, solution.redundancy_used)
    found = verdict(ReportInput(solution, gates, BundleDefinition("MAIN"), {}, {}), test)
    return found.level, found.headline


def test_limits_are_those_of_the_printed_table() -> None:
    # chi-square on 10 degrees of freedom: 3.247 and 20.483 (every textbook's table, three decimals)
    test = global_test(1.2, 10.0)
    assert isinstance(test, GlobalTest)
    assert 10.0 * test.lower**2 == pytest.approx(3.247, abs=0.0005)
    assert 10.0 * test.upper**2 == pytest.approx(20.483, abs=0.0005)
    assert test.statistic == pytest.approx(14.4)


@pytest.mark.parametrize(("sigma0", "redundancy"), [(0.8, 217.0), (1.0059, 355.006), (14.3, 283.0), (0.5, 1.5)])
def test_it_is_the_chi_square_distribution(sigma0: float, redundancy: float) -> None:
    test = global_test(sigma0, redundancy)
    assert isinstance(test, GlobalTest)
    # both evaluate the incomplete gamma function, to some 12 digits
    assert test.lower == pytest.approx(math.sqrt(chi2.ppf(0.025, redundancy) / redundancy), rel=1e-10)
    assert test.upper == pytest.approx(math.sqrt(chi2.ppf(0.975, redundancy) / redundancy), rel=1e-10)
    assert test.p == pytest.approx(chi2.sf(redundancy * sigma0**2, redundancy), rel=1e-9)


def test_nothing_redundant_is_no_test() -> None:
    assert global_test(float("nan"), 0.0) is Untested.NOTHING_REDUNDANT
    # what is left of observations that have all lost their weight
    assert global_test(110.0, 1e-8) is Untested.NOTHING_REDUNDANT
    nothing = replace(QUIET, sigma0=float("nan"), redundancy=0)
    said = verdict(ReportInput(nothing, (), BundleDefinition("MAIN"), {}, {}), Untested.NOTHING_REDUNDANT).sentences
    assert "Nothing is redundant" in " ".join(said)


def test_the_gravest_comes_first() -> None:
    blunder = Blunder(1, "photo", "P", "1", "x", 0.1, 0.01, 9.0, 3.3)
    failed = GateResult(parse_gate("sigma0<=0.5"), 1.0, passed=False)
    assert headline(replace(QUIET, status="not_converged"), failed)[1] == (
        "The adjustment did not converge: do not use its values"
    )
    assert headline(replace(QUIET, singular=awkward().singular), failed) == (
        "bad", "Converged, but 2 unknowns could not be determined",
    )  # fmt: skip
    assert headline(replace(QUIET, blunders=(blunder,)), failed) == ("bad", "Converged, but 1 gate failed")
    assert headline(replace(QUIET, blunders=(blunder,))) == (
        "caution", "Converged, with doubts: 1 blunder found and left out",
    )  # fmt: skip
    assert headline(replace(QUIET, sigma0=14.3))[0] == "caution"
    assert headline(QUIET) == ("good", "Converged; all observations fit, and all unknowns are determined")


def test_sigma0_is_put_in_words() -> None:
    fits = "do not contradict the a-priori errors, p = 0.49"
    for sigma0, words in ((1.0, fits), (0.8, "better than"), (1.2, "larger than")):
        solution = replace(QUIET, sigma0=sigma0)
        test = global_test(sigma0, solution.redundancy_used)
        said = verdict(ReportInput(solution, (), BundleDefinition("MAIN"), {}, {}), test).sentences[1]
        assert words in said


def test_a_handful_of_redundancy_is_no_test_of_the_a_priori_errors() -> None:
    test = global_test(1.0, 5.0)
    assert isinstance(test, GlobalTest)
    said = sigma0_finding(1.0, test)
    assert said.endswith("but redundancy 5 is too little to test the a-priori errors")


def test_a_group_that_contradicts_the_others_comes_first() -> None:
    contradicting = Diagnosis(CODE, "distances", "all distances are off by about +1.0 ± 0.1 m (p < 0.0001)", "check")
    blunder = Blunder(1, "photo", "P", "1", "x", 0.1, 0.01, 9.0, 3.3)
    solution = replace(QUIET, blunders=(blunder,), diagnosis=(contradicting,))
    assert headline(solution) == (
        "caution", "Converged, but all distances are off by about +1.0 ± 0.1 m (p < 0.0001)",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("sigma0", "lower", "upper"), [(0.9873, 0.98716, 1.0127), (1.00461, 0.9956, 1.00459), (0.98734, 0.98736, 1.0126)]
)
def test_rounding_does_not_contradict_the_test(sigma0: float, lower: float, upper: float) -> None:
    said = sigma0_finding(sigma0, GlobalTest(5000.0, lower, upper, 0.0, 0.5))
    shown_lower, shown_upper = map(float, re.findall(r"\d\.\d+", said)[:2])
    for digits in (3, 4):
        shown = round(sigma0, digits)
        assert (shown < shown_lower) == (sigma0 < lower) == said.startswith("below")
        assert (shown > shown_upper) == (sigma0 > upper) == said.startswith("above")
