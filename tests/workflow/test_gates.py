"""Figures of a solution, and gates held against them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from workflow.quiet import run_quietly
from workflow.small_projects import first_project, replace_in

from orip.bundle.results.figures import figure
from orip.errors import UsageError
from orip.records.results.solution import CheckPoint, Correlation, SingularUnknown, Solution
from orip.records.results.tests import GATE_FIGURES, Gate, GateResult
from orip.structs import replace
from orip.workflow.adjust.gates import check_solution

NAN = math.nan


@pytest.fixture(scope="module")
def solution(tmp_path_factory: pytest.TempPathFactory) -> Solution:
    folder = first_project(tmp_path_factory.mktemp("first"))
    replace_in(
        folder / "FIRST.PNT", "4   1181.60  2138.35  110.25   0.02 0.02 0.03", "4 1181.6 2138.35 110.25 -1 -1 -1"
    )
    (outcome,) = run_quietly(folder)
    return outcome.solution


def verdict(solution: Solution, gate: str) -> bool:
    (result,) = check_solution(solution, [gate])
    return result.passed


@pytest.mark.parametrize("name", GATE_FIGURES)
def test_every_figure_has_a_meaning_and_a_value(solution: Solution, name: str) -> None:
    value = figure(solution, name)
    assert type(value) is float
    assert len(GATE_FIGURES[name]) <= 54, "a line of the help has 80 columns"
    if name != "max_correlation":  # no parameter of the camera is unknown
        assert math.isfinite(value)


def test_no_figure_is_without_a_meaning(solution: Solution) -> None:
    from orip.bundle.results import figures

    assert list(figures._FIGURES) == list(GATE_FIGURES)


def test_values_of_figures(solution: Solution) -> None:
    residuals = solution.residuals
    used = np.isfinite(residuals.weight_factor)
    control = [
        residuals.residual[row]
        for row, kind in enumerate(residuals.kind)
        if kind == "control" and used[row] and residuals.component[row] in "XY"
    ]
    assert len(control) == 6
    assert figure(solution, "control.rms_xy") == pytest.approx(math.sqrt(sum(v * v for v in control) / 6))
    assert figure(solution, "control.count") == 9
    (check,) = solution.check_points
    assert figure(solution, "check_points.rms_xy") == pytest.approx(math.hypot(check.dX, check.dY) / math.sqrt(2))
    assert figure(solution, "check_points.rms_z") == pytest.approx(abs(check.dZ))
    assert figure(solution, "check_points.max") == max(abs(check.dX), abs(check.dY), abs(check.dZ))
    assert figure(solution, "iterations") == len(solution.iterations)
    assert figure(solution, "max_standard_residual") == residuals.standard_residual[used].max()
    assert figure(solution, "min_redundancy_number") == residuals.redundancy_number[used].min()
    assert figure(solution, "points.max_sd") == solution.points.sd.max()
    assert figure(solution, "points.single_ray") == 0
    assert figure(solution, "photos.count") == 2


def test_check_points_with_unknown_coordinates(solution: Solution) -> None:
    some = replace(solution, check_points=(CheckPoint("a", 3.0, -4.0, NAN), CheckPoint("b", NAN, NAN, 2.0)))
    assert figure(some, "check_points.rms_xy") == pytest.approx(math.sqrt(25 / 2))
    assert figure(some, "check_points.rms_z") == 2.0
    assert figure(some, "check_points.max") == 4.0
    assert figure(some, "check_points.count") == 2


def test_figures_of_nothing_fail_whatever_the_gate(solution: Solution) -> None:
    none = replace(solution, check_points=(), sigma0=NAN)
    for name in ("check_points.rms_xy", "check_points.rms_z", "check_points.max", "sigma0", "max_correlation"):
        for operator in ("<", ">=", "!="):
            (result,) = check_solution(none, [f"{name}{operator}1"])
            assert not result.passed
            assert str(result) == f"FAIL {name} {operator} 1 (the solution has no such figure)"
    assert verdict(none, "check_points.count==0")


def test_an_undetermined_point_has_no_finite_deviation(solution: Solution) -> None:
    sd = solution.points.sd.copy()
    sd[0, 2] = math.inf
    loose = replace(
        solution,
        points=replace(solution.points, sd=sd),
        singular=(SingularUnknown("POINT", solution.points.names[0], "Z", 13.0),),
    )
    for gate in ("points.max_sd<1e300", "points.max_sd>0", "points.rms_sd<1e9"):
        (result,) = check_solution(loose, [gate])
        assert not result.passed
        assert result.reason == "not determined"
    assert verdict(loose, "singular==1")


def test_correlations(solution: Solution) -> None:
    both = replace(solution, correlations=(Correlation("C35.C", "C35.DX", 0.3), Correlation("C35.C", "C35.DY", -0.8)))
    assert figure(both, "max_correlation") == 0.8


@pytest.mark.parametrize(
    ("operator", "passed"),
    [("<", (True, False, False)), ("<=", (True, True, False)), (">", (False, False, True)),
     (">=", (False, True, True)), ("==", (False, True, False)), ("!=", (True, False, True))],
)  # fmt: skip
def test_operators(solution: Solution, operator: str, passed: tuple[bool, ...]) -> None:
    for value, expected in zip((1, 2, 3), passed, strict=True):
        assert verdict(replace(solution, redundancy=value), f"redundancy{operator}2") is expected


def test_unknown_names_fail_with_the_nearest_known_one(solution: Solution) -> None:
    for name, near in (("sigma_0", "sigma0"), ("SIGMA0", "sigma0"), ("checkpoints.rms_xy", "check_points.rms_xy")):
        (result,) = check_solution(solution, [f"{name}<1e9"])
        assert not result.passed
        assert math.isnan(result.value)
        assert f"did you mean {near}?" in str(result)
    (result,) = check_solution(solution, ["qqq<1"])
    assert result.reason == "there is no figure of this name; 'orip check --help' lists all"


def test_malformed_expressions(solution: Solution) -> None:
    with pytest.raises(UsageError, match="'sigma0' is not a gate"):
        check_solution(solution, ["sigma0<1", "sigma0"])


def test_gates_and_texts(solution: Solution) -> None:
    assert len(check_solution(solution, [Gate("sigma0", "<", 100.0), "enp>0"])) == 2
    assert check_solution(solution, []) == ()


@pytest.mark.parametrize(
    ("gate", "value", "shown"),
    [
        (Gate("sigma0", "<=", 1.5), 0.98, "pass sigma0 <= 1.5 (0.98)"),
        (Gate("sigma0", "<=", 1.5), 1.5000001, "FAIL sigma0 <= 1.5 (1.5000001)"),
        (Gate("sigma0", "<", 1.5), 1.4999999999, "pass sigma0 < 1.5 (1.4999999999)"),
        (Gate("observations", ">", 454.0), 123456.0, "pass observations > 454 (123456)"),
    ],
)
def test_the_value_that_is_shown_does_not_contradict_the_verdict(gate: Gate, value: float, shown: str) -> None:
    assert str(GateResult(gate, value, gate.holds(value))) == shown
