"""Did the adjustment converge, and can it be trusted? Its status, sigma0 and its test, gates, check points."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.bundle.results.figures import figure
from orip.bundle.results.misfits import number_by_chance
from orip.bundle.verdict import GlobalTest, Level, Untested, headline, sigma0_finding
from orip.records.names import places_of_names
from orip.records.results.result_tests import GATE_FIGURES
from orip.records.results.solution import Solution
from orip.report.report_input import ReportInput
from orip.report.table import PageColumn, PageTable, counted, decimals_of_most, fixed, significant
from orip.wording import agreeing


class Verdict(Struct, frozen=True):
    """What the page says first."""

    level: Level
    headline: str
    sentences: tuple[str, ...]


def verdict(given: ReportInput, test: GlobalTest | Untested) -> Verdict:
    """Return what to think of the adjustment, in a few sentences."""
    solution = given.solution
    failed = [result for result in given.gates if not result.passed]
    level, text = headline(solution, len(failed), test)
    sentences = [_about_status(solution), _about_sigma0(solution, test)]
    if solution.blunders:
        count = len({blunder.order for blunder in solution.blunders})
        were, blunders = agreeing(count, "was", "were"), agreeing(count, "a blunder", "blunders")
        sentences.append(f"{counted(count, 'observation')} {were} found to be {blunders} and left out.")
    if by_chance := number_by_chance(solution, given.test_level):
        names = agreeing(by_chance, "observation has", "observations have")
        sentences.append(f"{by_chance} {names} lost weight, no more than chance explains; BUNDLE_ERROR.OUT lists them.")
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
    place = places_of_names(solution.points.names)
    unknown = np.full(3, np.nan)
    sd = np.array([solution.points.sd[place[point.name]] if point.name in place else unknown for point in points])
    decimals = decimals_of_most(sd)
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


def _about_status(solution: Solution) -> str:
    size = (
        f"{counted(solution.observations, 'observation')} of {counted(len(solution.photos.names), 'photo')} and "
        f"{counted(len(solution.points.names), 'point')} determine {counted(solution.unknowns, 'unknown')}"
    )
    ended = {
        "converged": "The adjustment converged",
        "doubtful": "The adjustment converged",
        "not_determined": "The iterations ended without determining the block,",
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


def _about_sigma0(solution: Solution, test: GlobalTest | Untested) -> str:
    if test is Untested.ERRORS_ESTIMATED:
        return (
            f"sigma0 is {significant(solution.sigma0)}, which says nothing here: the a-priori errors of the groups "
            f"below are estimated from the same residuals."
        )
    if test is Untested.NO_FULL_WEIGHT:
        return "No observation with full weight is checked by another one: sigma0 cannot be estimated."
    if isinstance(test, Untested):
        return "Nothing is redundant: no observation checks another, and sigma0 cannot be estimated."
    found = f"sigma0 is {significant(solution.sigma0, 4)}, {sigma0_finding(solution.sigma0, test)}."
    if solution.sigma0 < test.lower:
        return f"{found} The standard deviations here take that into account."
    if solution.sigma0 > test.upper:
        return (
            f"{found} The standard deviations here are already multiplied with it, but the cause should be known: "
            f"a-priori errors too small, blunders, or a camera model that does not fit."
        )
    return found


def check_point_finding(solution: Solution) -> str:
    """Return how far check points are off."""
    plan, height = (figure(solution, f"check_points.rms_{part}") for part in ("xy", "z"))
    unit = solution.ground_unit
    return (
        f"{counted(len(solution.check_points), 'check point')} with an RMS of {significant(plan)} {unit} in X and Y "
        f"and {significant(height)} {unit} in Z"
    )
