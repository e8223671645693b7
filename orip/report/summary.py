"""The report in a few lines for a terminal: the reader's questions in the same order."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from msgspec import Struct

from orip.bundle.groups.words import EXPLAINED, probability_in_words
from orip.bundle.verdict import MISTAKE, Level, Untested, group_findings, headline, sigma0_finding, sigma0_test
from orip.number_text import one_fixed
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.results.solution import Solution
from orip.records.results.tests import GateResult
from orip.report.calibration import significance, significance_limit
from orip.report.first_page import check_point_finding
from orip.report.precision import Spread, spreads
from orip.report.table import counted, parameter, significant
from orip.report.trouble import suspects, weak_spots
from orip.wording import agreeing

MOST_LINES = 16
"""Most lines; with the names of the files that are written there are twenty."""

USUAL_COLUMNS = 80
LABEL_COLUMNS = 9
_KEEP = "\N{NO-BREAK SPACE}"
_SAID_BY_STATUS = re.compile(r"^(Converged, with doubts|The adjustment [a-z ]+): ")
"""How a headline begins that says no more than the status does."""

_WRONG = {
    "another-block",
    "datum",
    "undetermined",
    "same-unknown",
    "behind",
    "diverging",
    "not-converged",
    "no-redundancy",
    "blunder",
    "blunder-kept",
}
"""Diagnoses of what must be corrected; the others need attention only."""

_SHORTER: tuple[tuple[int, int, frozenset[str]], ...] = (
    (3, 3, frozenset()),
    (3, 2, frozenset()),
    (3, 1, frozenset()),
    (2, 1, frozenset()),
    (1, 1, frozenset()),
    (1, 1, frozenset({"weak"})),
    (1, 1, frozenset({"weak", "points", "photos"})),
)
"""Most entries of one kind, most notes, and questions that are left to the report: tried in this order until everything
fits. The camera is the purpose of a calibration, and is always shown."""


class SummaryLine(Struct, frozen=True):
    """A line of the summary.

    Parameters
    ----------
    label : str
        Empty where it continues the line above.
    level : {"good", "caution", "bad"} or None
        None: a fact that is neither.
    """

    label: str
    text: str
    level: Level | None = None


def summary(
    solution: Solution, gates: Sequence[GateResult], error_listing: str, test_level: float | None = None
) -> tuple[SummaryLine, ...]:
    """Return the summary of an adjustment: 16 lines of 80 columns at most, or longer by the lines of a camera.

    Parameters
    ----------
    error_listing : str
        The file that lists what finds no room.
    test_level : float or None
        Error probability of the test of one observation; None: 5 % for all of the block together.
    """
    lines: tuple[SummaryLine, ...] = ()
    sections = _sections(solution, gates, error_listing, test_level)
    for most, notes, left_out in _SHORTER:
        lines = tuple(
            line
            for label, section in sections.items()
            if label not in left_out
            for line in section(notes if label == "note" else most)
        )
        if sum(map(_height, lines)) <= MOST_LINES:
            break
    return lines


Section = Callable[[int], Iterable[SummaryLine]]


def _sections(
    solution: Solution, gates: Sequence[GateResult], error_listing: str, test_level: float | None
) -> dict[str, Section]:
    """Return the sections by their questions; each takes the most entries it may have."""
    usable = solution.status in {"converged", "doubtful"}
    found = suspects(solution, test_level)
    sections: dict[str, Section] = {
        "status": _whole(_trust(solution, gates)),
        "gate": lambda most: _gates(gates, most),
        "misfit": lambda most: _misfits(found, solution, error_listing, most),
        "note": lambda most: _notes(solution, error_listing, most),
    }
    if usable:
        sections |= {
            "weak": _whole(_weak(solution)),
            "points": _whole(_precision(solution, "Points")),
            "photos": _whole(_precision(solution, "Photos")),
            "camera": lambda most: _cameras(solution, most),
        }
    return sections


def _whole(lines: Iterable[SummaryLine]) -> Section:
    """Return a section that has the same lines however many entries it may have."""
    found = tuple(lines)
    return lambda _most: found


def _height(line: SummaryLine) -> int:
    return len(textwrap.wrap(line.text, USUAL_COLUMNS - LABEL_COLUMNS, break_on_hyphens=False))


def _trust(solution: Solution, gates: Sequence[GateResult]) -> Iterator[SummaryLine]:
    test = sigma0_test(solution)
    level, text = headline(solution, sum(not result.passed for result in gates), test)
    status = solution.status.replace("_", " ")
    whole = solution.status in {"converged", "not_determined"}
    finding = text if whole else f"{status}: {_uncapitalised(_SAID_BY_STATUS.sub('', text))}"
    yield SummaryLine("status", _uncapitalised(finding), level)
    if (contradicting := group_findings(solution)) and contradicting[0].text in text:
        yield SummaryLine("", contradicting[0].remedy)
    tested = test.value if isinstance(test, Untested) else f"{sigma0_finding(solution.sigma0, test)} (chi-square test)"
    sigma0 = f"{solution.sigma0:.4f}" if math.isfinite(solution.sigma0) else "not known"
    yield SummaryLine("sigma0", f"{sigma0}, {tested}")
    size = f"{solution.observations} observations, {solution.unknowns} unknowns, redundancy {solution.redundancy}"
    down = (solution.residuals.weight_factor < 1.0).any()
    yield SummaryLine("", f"{one_fixed(solution.sigma0_all, 4)} with none down-weighted; {size}" if down else size)
    yield from _variance_components(solution)
    if solution.check_points:
        yield SummaryLine("check", re.sub(r"(?<=\d) (?!check|in )", _KEEP, check_point_finding(solution)))


def _variance_components(solution: Solution) -> Iterator[SummaryLine]:
    label = "errors"
    for row in solution.variance_components:
        if math.isnan(row.factor):
            confounded = "not distinguishable from 0 or from that of another group"
            why = "too little redundancy" if row.redundancy < 1.0 else confounded
            yield SummaryLine(label, f"{row.name}: not estimated, {why}")
        else:
            found = f"{_kept(f'{significant(row.factor, 3)} ± {significant(row.sd, 2)}')} times the given ones"
            yield SummaryLine(label, f"{row.name}: {found} ({probability_in_words(row.p)})")
        label = ""


def _kept(text: str) -> str:
    """Return words with blanks at which no line is broken."""
    return text.replace(" ", _KEEP)


def _uncapitalised(text: str) -> str:
    return f"{text[0].lower()}{text[1:]}"


def _gates(gates: Sequence[GateResult], most: int) -> Iterator[SummaryLine]:
    """Yield the gates, those that failed first."""
    failed = sum(not result.passed for result in gates)
    for result in sorted(gates, key=lambda gate: gate.passed)[:most]:
        yield SummaryLine("gate", str(result), None if result.passed else "bad")
    if len(gates) > most:
        yield SummaryLine("", f"{failed} of {counted(len(gates), 'gate')} failed; 'orip check' shows each")


def _misfits(
    found: Mapping[str, Sequence[str]], solution: Solution, error_listing: str, most: int
) -> Iterator[SummaryLine]:
    if not found:
        return
    level: Level = "bad" if solution.status == "doubtful" else "caution"
    do_not_fit = f"{counted(len(found), 'observation')} {agreeing(len(found), 'does', 'do')} not fit"
    if any(finding.code == EXPLAINED for finding in solution.diagnosis):
        yield SummaryLine("misfit", f"{do_not_fit}; look at them after what the warning says is corrected", level)
        return
    title = f"{do_not_fit}; check names, measure again, or disregard"
    yield SummaryLine("misfit", f"{title}:", level)
    for name, sizes in list(found.items())[:most]:
        yield SummaryLine("", f"{name}: probably off by {', '.join(map(_kept, sizes))}")
    if len(found) > most:
        yield SummaryLine("", f"+{len(found) - most} more in {error_listing}")


def _notes(solution: Solution, error_listing: str, most: int) -> Iterator[SummaryLine]:
    # what the headline says is not repeated
    told = group_findings(solution)[:1]
    found = [finding for finding in solution.diagnosis if finding not in told and finding.code != MISTAKE]
    for finding in found[:most]:
        yield SummaryLine("note", f"{finding.text}: {finding.remedy}", "bad" if finding.code in _WRONG else "caution")
    if len(found) > most:
        yield SummaryLine("", f"+{len(found) - most} more in {error_listing}")


def _weak(solution: Solution) -> Iterator[SummaryLine]:
    spots = weak_spots(solution)
    if spots:
        more = f"; +{len(spots) - 1} more in the report" if len(spots) > 1 else ""
        yield SummaryLine("weak", f"{spots[0].where} {spots[0].what}{more}")


def _precision(solution: Solution, group: str) -> Iterator[SummaryLine]:
    """Yield the standard deviations, places and angles on lines of their own."""
    mine = [spread for spread in spreads(solution) if spread.name.startswith(group)]
    label, heading = group.lower(), "sd (RMS/largest) "
    for unit in dict.fromkeys(spread.unit for spread in mine):
        listed = ", ".join(_of_spread(spread) for spread in mine if spread.unit == unit)
        yield SummaryLine(label, f"{heading}{listed}{_KEEP}{unit}")
        label = heading = ""


def _of_spread(spread: Spread) -> str:
    return f"{spread.name.partition(', ')[2]}{_KEEP}{spread.rms}/{spread.largest}"


def _cameras(solution: Solution, most: int) -> Iterator[SummaryLine]:
    found = [text for row in range(len(solution.cameras.names)) if (text := _camera(solution, row))]
    for text in found[:most]:
        yield SummaryLine("camera", text)
    if len(found) > most:
        yield SummaryLine("", f"+{len(found) - most} more in the report, and by 'orip results cameras'")


def _camera(solution: Solution, row: int) -> str:
    """Return the parameters of a camera that were adjusted; "" where none was."""
    name, limit = solution.cameras.names[row], significance_limit(solution.redundancy)
    values, sds = solution.cameras.values[row].tolist(), solution.cameras.sd[row].tolist()
    adjusted = [
        (kind, value, sd) for kind, value, sd in zip(CAMERA_PARAMETERS, values, sds, strict=True) if not math.isnan(sd)
    ]
    adjusted += [
        (estimate.name, estimate.value, estimate.sd) for estimate in solution.additional if estimate.camera == name
    ]
    verdicts = {kind: significance(kind, value, sd, limit) for kind, value, sd in adjusted}
    interior = [(kind, *parameter(value, sd)) for kind, value, sd in adjusted if not verdicts[kind]]
    parts = [", ".join(_kept(f"{kind} {value} ± {sd}") for kind, value, sd in interior)] if interior else []
    for verdict, heading in (("yes", "significant"), ("no", "not significant")):
        kinds = [kind for kind, found in verdicts.items() if found == verdict]
        if kinds:
            parts.append(f"{heading}: {', '.join(kinds)}")
    return f"{name} {'; '.join(parts)}" if parts else ""
