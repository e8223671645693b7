"""The verdict on an adjustment: the chi-square test of sigma0, and the sentence that comes first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import Literal

from msgspec import Struct

from orip.bundle.ground_system import CONTROL_LINE
from orip.bundle.groups.words import CODE, EXPLAINED, group_name
from orip.bundle.results.reliability import has_suspects, suspect_rows
from orip.bundle.results.unchecked_photos import UNCHECKED
from orip.records.observation_kinds import PHOTO_POINT, named_observation
from orip.records.results.solution import Diagnosis, Solution
from orip.records.results.tests import NOT_DETERMINED
from orip.wording import counted

Level = Literal["good", "caution", "bad"]

MISTAKE = "mistake"
"""Code of the diagnoses of what was probably mistaken; a warning says what."""

TWO_PLACES = "two-places"
"""Code of the diagnosis of points of which as many rays meet elsewhere."""

OTHER_ORIENTATION = "other-orientation"
"""Code of the diagnosis of photos of few points that fit as well in another place."""

CONFIDENCE = 0.95
_FAR_ABOVE = 2.0
"""sigma0 above which the a-priori errors are more than just optimistic; the diagnosis has the same limit."""

_FAR_ABOVE_TEXT = "the residuals are far larger than the a-priori errors"

_MOST_DECIMALS = 6

_HANDFUL = 10.0
"""Redundancy below which sigma0 says nothing about the a-priori errors: by chance it is anything from 0.5 to 2."""

_LEAST_REDUNDANCY = 0.05
"""Redundancy that is none: what observations with least weights add up to."""


class GlobalTest(Struct, frozen=True):
    """The chi-square test of sigma0 against 1.

    Parameters
    ----------
    freedom : float
        Degrees of freedom, redundancy_used.
    lower, upper : float
        Where sigma0 lies with probability 0.95 if the a-priori errors are right.
    statistic : float
        redundancy_used · sigma0².
    p : float
        Probability of a statistic so large or larger.
    """

    freedom: float
    lower: float
    upper: float
    statistic: float
    p: float


class Untested(Enum):
    """Why sigma0 cannot be tested."""

    NOTHING_REDUNDANT = "nothing is redundant to test it"
    NO_FULL_WEIGHT = "no observation with full weight is checked by another one"
    ERRORS_ESTIMATED = "1 by definition: the a-priori errors are estimated from the same residuals"


def global_test(sigma0: float, redundancy: float) -> GlobalTest | Untested:
    """Return the two-sided test of sigma0 = 1, or why there is none.

    redundancy · sigma0² is chi-square distributed on as many degrees of freedom if the a-priori errors are right.

    Parameters
    ----------
    redundancy : float
        Of the observations that sigma0 is based on; not always a whole number.
    """
    from scipy.special import gammaincc, gammaincinv

    if not (redundancy >= _LEAST_REDUNDANCY and math.isfinite(sigma0)):
        return Untested.NOTHING_REDUNDANT
    tail = (1.0 - CONFIDENCE) / 2.0
    lower, upper = (math.sqrt(2.0 * gammaincinv(redundancy / 2.0, part) / redundancy) for part in (tail, 1.0 - tail))
    statistic = redundancy * sigma0**2
    return GlobalTest(redundancy, lower, upper, statistic, float(gammaincc(redundancy / 2.0, statistic / 2.0)))


def sigma0_test(solution: Solution) -> GlobalTest | Untested:
    """Return the test of a solution's sigma0, or why there is none."""
    if any(math.isfinite(component.factor) for component in solution.variance_components):
        return Untested.ERRORS_ESTIMATED
    test = global_test(solution.sigma0, solution.redundancy_used)
    if test is Untested.NOTHING_REDUNDANT and solution.redundancy > 0:
        return Untested.NO_FULL_WEIGHT
    return test


def headline(solution: Solution, failed: int, test: GlobalTest | Untested) -> tuple[Level, str]:
    """Return whether all is well, and what comes first, from all that was found; `failed` gates were not passed."""
    if solution.status in {"not_converged", "stopped"}:
        how = "was stopped before it converged" if solution.status == "stopped" else "did not converge"
        return "bad", f"The adjustment {how}: do not use its values"
    if solution.status == "not_determined":
        reason = next((found.text for found in solution.diagnosis if found.code in NOT_DETERMINED), "")
        return "bad", f"Not determined: {reason}"
    contradicting = group_findings(solution)
    far_above = isinstance(test, GlobalTest) and solution.sigma0 > max(test.upper, _FAR_ABOVE)
    mistakes = [found for found in solution.diagnosis if found.code == MISTAKE]
    if solution.singular:
        also = [found.text for found in (*contradicting, *mistakes)] + [_FAR_ABOVE_TEXT] * far_above
        also += _ambiguities(solution)
        unfit = f", and {also[0]}" if also else ""
        return "bad", f"Converged, but {_undetermined(solution)} could not be determined{unfit}"
    if failed:
        return "bad", f"Converged, but {counted(failed, 'gate')} failed"
    if contradicting:
        return "caution", f"Converged, but {contradicting[0].text}"
    if why := _doubts(solution, mistakes):
        return "caution", f"Converged, {why}"
    if doubted := [group for group in solution.groups if group.doubted]:
        return "caution", f"Converged, but the {group_name(doubted[0])} contradict the other observations"
    if far_above:
        return "caution", f"Converged, but {_FAR_ABOVE_TEXT}"
    if has_suspects(solution):
        return "caution", "Converged; not all observations fit"
    return _weaknesses(solution)


def _doubts(solution: Solution, mistakes: Sequence[Diagnosis]) -> str:
    """Return what was found wrong with single observations or with what is given; "" if nothing was."""
    if solution.blunders:
        found = counted(len({blunder.order for blunder in solution.blunders}), "blunder")
        return f"with doubts: {found} found and left out"
    if solution.status == "doubtful":
        also = [found.text for found in mistakes[:1]] + _ambiguities(solution)
        fits = any(found.code == OTHER_ORIENTATION for found in solution.diagnosis) and not has_suspects(solution)
        unfit = f"observations do not fit{'' if also else _worst_but_photo_points(solution)}"
        return "with doubts: " + "; ".join([*([] if fits else [unfit]), *also])
    return f"but {mistakes[0].text}" if mistakes else ""


def _worst_but_photo_points(solution: Solution) -> str:
    """Return the observation that fits worst, to follow what is said of all; "" where it is a photo point."""
    residuals, rows = solution.residuals, suspect_rows(solution)
    if not len(rows) or residuals.kind[row := int(rows[0])] == PHOTO_POINT.name:
        return ""
    name = named_observation(residuals.kind[row], residuals.photo[row], residuals.point[row], residuals.component[row])
    return f", worst of all {name}"


def _ambiguities(solution: Solution) -> list[str]:
    """Return a sentence on the points of which as many rays meet elsewhere, and on photos that fit there as well."""
    why = {TWO_PLACES: "where as many rays meet", OTHER_ORIENTATION: "where its points fit as well"}
    found = [one for one in solution.diagnosis if one.code in why]
    return [f"{one.where} may be at another place, {why[one.code]}" for one in found]


def _weaknesses(solution: Solution) -> tuple[Level, str]:
    if unchecked := [found.text for found in solution.diagnosis if found.code == UNCHECKED]:
        return "caution", f"Converged, but {unchecked[0]}"
    if solution.diagnosis:
        return "good", f"Converged; {counted(len(solution.diagnosis), 'note')} on what is weak"
    return "good", "Converged; all observations fit, and all unknowns are determined"


def _undetermined(solution: Solution) -> str:
    """Return how much is undetermined: so many points, where it is points alone, and all of their coordinates."""
    points = {unknown.name for unknown in solution.singular if unknown.group == "POINT"}
    if 3 * len(points) == len(solution.singular):
        return counted(len(points), "point")
    return counted(len(solution.singular), "unknown")


def group_findings(solution: Solution) -> list[Diagnosis]:
    """Return what the first sentence says: groups that contradict the others, the gravest first, or poor control."""
    return [found for found in solution.diagnosis if found.code in (CODE, EXPLAINED, CONTROL_LINE)]


def _decimals_that_agree(sigma0: float, test: GlobalTest) -> int:
    """Return the decimals of the interval's ends: on paper sigma0, of three or four decimals, is on the same side."""
    # for a large block the interval is narrower than 0.01
    least = max(2, -math.floor(math.log10(test.upper - test.lower)))
    for decimals in range(least, _MOST_DECIMALS):
        lower, upper = round(test.lower, decimals), round(test.upper, decimals)
        shown = [round(sigma0, digits) for digits in (3, 4)]
        below = [value < lower for value in shown] == [sigma0 < test.lower] * 2
        above = [value > upper for value in shown] == [sigma0 > test.upper] * 2
        if below and above:
            return decimals
    return _MOST_DECIMALS


def sigma0_finding(sigma0: float, test: GlobalTest) -> str:
    """Return what the test says of sigma0."""
    decimals = _decimals_that_agree(sigma0, test)
    between = f"{test.lower:.{decimals}f} to {test.upper:.{decimals}f} expected by chance"
    if sigma0 < test.lower:
        return f"below the {between}: the observations are better than their a-priori errors"
    if sigma0 > test.upper:
        return f"above the {between}: the residuals are larger than the a-priori errors suggest"
    if test.freedom < _HANDFUL:
        return f"within the {between}, but redundancy {test.freedom:.2g} is too little to test the a-priori errors"
    return f"within the {between}: the residuals do not contradict the a-priori errors, p = {test.p:.2f}"
