"""Did the adjustment converge, and can it be trusted? Its status, sigma0 and its test, gates, check points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from orip.bundle.figures import figure
from orip.records.gate import GATE_FIGURES
from orip.records.solution import Solution
from orip.report.numbers import counted, decimals_for, fixed, significant
from orip.report.report_input import ReportInput
from orip.report.table import PageColumn, PageTable
from orip.wording import agreeing

Level = Literal["good", "caution", "bad"]

CONFIDENCE = 0.95
_FAR_ABOVE = 2.0
"""sigma0 from which on the a-priori errors are not just optimistic; the diagnosis has the same limit."""


@dataclass(frozen=True, slots=True)
class GlobalTest:
    """The chi-square test of sigma0 against 1.

    Parameters
    ----------
    lower, upper : float
        Where sigma0 lies with probability 0.95 if the a-priori errors are right.
    statistic : float
        redundancy_used · sigma0².
    p : float
        Probability of a statistic so large or larger.
    """

    lower: float
    upper: float
    statistic: float
    p: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the page says first."""

    level: Level
    headline: str
    sentences: tuple[str, ...]


def global_test(sigma0: float, redundancy: float) -> GlobalTest | None:
    """Return the two-sided test of sigma0 = 1; None where nothing is redundant.

    redundancy · sigma0² is chi-square distributed on as many degrees of freedom if the a-priori errors are right.

    Parameters
    ----------
    sigma0 : float
    redundancy : float
        Of the observations that sigma0 is based on; not always a whole number.
    """
    from scipy.special import gammaincc, gammaincinv

    if not (redundancy > 0.0 and math.isfinite(sigma0)):
        return None
    tail = (1.0 - CONFIDENCE) / 2.0
    lower, upper = (math.sqrt(2.0 * gammaincinv(redundancy / 2.0, part) / redundancy) for part in (tail, 1.0 - tail))
    statistic = redundancy * sigma0**2
    return GlobalTest(lower, upper, statistic, float(gammaincc(redundancy / 2.0, statistic / 2.0)))


def verdict(given: ReportInput, test: GlobalTest | None) -> Verdict:
    """Return what to think of the adjustment, in a few sentences."""
    solution = given.solution
    failed = [result for result in given.gates if not result.passed]
    level, text = headline(solution, len(failed), test)
    sentences = [_about_status(solution), _about_sigma0(solution, test)]
    if solution.blunders:
        count = len({blunder.order for blunder in solution.blunders})
        were, blunders = agreeing(count, "was", "were"), agreeing(count, "a blunder", "blunders")
        sentences.append(f"{counted(count, 'observation')} {were} found to be {blunders} and left out.")
    if given.gates:
        passed = len(given.gates) - len(failed)
        names = f": {', '.join(str(result.gate) for result in failed)} not met" if failed else ""
        sentences.append(f"{passed} of {counted(len(given.gates), 'gate')} passed{names}.")
    if solution.check_points:
        sentences.append(f"{check_point_finding(solution)}.")
    return Verdict(level, text, tuple(sentences))


def gate_table(given: ReportInput) -> PageTable | None:
    """Return the gates with what they found."""
    gates = given.gates
    if not gates:
        return None
    columns = (
        PageColumn("Gate", [str(result.gate) for result in gates], words=True),
        PageColumn("Meaning", [GATE_FIGURES.get(result.gate.name, "") for result in gates], words=True),
        PageColumn("Found", [result.reason or significant(result.value, 5) for result in gates]),
        PageColumn("", ["passed" if result.passed else "FAILED" for result in gates], words=True),
    )
    failed = frozenset(row for row, result in enumerate(gates) if not result.passed)
    return PageTable("", "Gates", columns, emphasised=failed)


def check_point_table(solution: Solution) -> PageTable | None:
    """Return the check points: adjusted minus given, with the standard deviation of the adjusted coordinate."""
    points = solution.check_points
    if not points:
        return None
    place = {name: row for row, name in enumerate(solution.points.names)}
    unknown = np.full(3, np.nan)
    sd = np.array([solution.points.sd[place[point.name]] if point.name in place else unknown for point in points])
    decimals = decimals_for(sd)
    differences = np.array([(point.dX, point.dY, point.dZ) for point in points])
    columns = [PageColumn("Point", [point.name for point in points], key="name", words=True)]
    for axis, name in enumerate("XYZ"):
        cells = [fixed(value, decimals) for value in differences[:, axis]]
        columns.append(PageColumn(f"d{name}", cells, solution.ground_unit, f"d{name}"))
        columns.append(
            PageColumn(f"sd {name}", [fixed(value, decimals) for value in sd[:, axis]], solution.ground_unit)
        )
    note = "Adjusted minus given. The given coordinates had no influence; their own errors are in the differences."
    return PageTable("check_points", "Check points", columns, note)


def headline(solution: Solution, failed: int, test: GlobalTest | None) -> tuple[Level, str]:
    """Return whether all is well, and what comes first; `failed` gates were not passed."""
    if solution.status in {"not_converged", "stopped"}:
        how = "was stopped before it converged" if solution.status == "stopped" else "did not converge"
        return "bad", f"The adjustment {how}: do not use its values"
    if solution.singular:
        return "bad", f"Converged, but {counted(len(solution.singular), 'unknown')} could not be determined"
    if failed:
        return "bad", f"Converged, but {counted(failed, 'gate')} failed"
    if solution.blunders or solution.status == "doubtful":
        found = counted(len({blunder.order for blunder in solution.blunders}), "blunder")
        why = f"{found} found and left out" if solution.blunders else "observations do not fit"
        return "caution", f"Converged, with doubts: {why}"
    if test is not None and solution.sigma0 > max(test.upper, _FAR_ABOVE):
        return "caution", "Converged, but the residuals are far larger than the a-priori errors"
    if solution.diagnosis:
        return "good", f"Converged; {counted(len(solution.diagnosis), 'note')} on what is weak"
    return "good", "Converged, nothing conspicuous"


def _about_status(solution: Solution) -> str:
    size = (
        f"{counted(solution.observations, 'observation')} of {counted(len(solution.photos.names), 'photo')} and "
        f"{counted(len(solution.points.names), 'point')} determine {counted(solution.unknowns, 'unknown')}"
    )
    ended = {
        "converged": "The adjustment converged",
        "doubtful": "The adjustment converged",
        "not_converged": "The adjustment did not converge",
        "stopped": "The adjustment was stopped",
    }[solution.status]
    last = f"{ended} in {counted(len(solution.iterations), 'iteration')} (ENP {fixed(solution.enp, 1)}): {size}."
    if solution.status != "doubtful":
        return last
    share = np.count_nonzero(solution.residuals.weight_factor < 1.0)
    return (
        f"{last} It is doubtful: {counted(int(share), 'component')} had to be down-weighted, and over all "
        f"observations sigma0 would be {significant(solution.sigma0_all)}."
    )


def _about_sigma0(solution: Solution, test: GlobalTest | None) -> str:
    if test is None:
        return "Nothing is redundant: no observation checks another, and sigma0 cannot be estimated."
    found = f"sigma0 is {significant(solution.sigma0)}, {sigma0_finding(solution.sigma0, test)}."
    if solution.sigma0 < test.lower:
        return f"{found} The standard deviations here take that into account."
    if solution.sigma0 > test.upper:
        return (
            f"{found} The standard deviations here are already multiplied with it, but the cause should be known: "
            f"a-priori errors too small, blunders, or a camera model that does not fit."
        )
    return found


def sigma0_finding(sigma0: float, test: GlobalTest) -> str:
    """Return what the test says of sigma0."""
    # of a large block the interval is narrower than 0.01
    decimals = max(2, -math.floor(math.log10(test.upper - test.lower)))
    between = f"{test.lower:.{decimals}f} to {test.upper:.{decimals}f} expected by chance"
    if sigma0 < test.lower:
        return f"below the {between}: the observations are better than their a-priori errors"
    if sigma0 > test.upper:
        return f"above the {between}: the residuals are larger than the a-priori errors suggest"
    return f"within the {between}: the a-priori errors are right"


def check_point_finding(solution: Solution) -> str:
    """Return how far check points are off."""
    plan, height = (figure(solution, f"check_points.rms_{part}") for part in ("xy", "z"))
    unit = solution.ground_unit
    return (
        f"{counted(len(solution.check_points), 'check point')} with an RMS of {significant(plan)} {unit} in X and Y "
        f"and {significant(height)} {unit} in Z"
    )
