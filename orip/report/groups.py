"""The groups of observations, each compared with all others."""

from __future__ import annotations

import math
from collections.abc import Iterator

from orip.bundle.groups.words import group_name, unit_of_group
from orip.records.results.group_test import GroupTest
from orip.records.results.solution import Solution
from orip.report.numbers import MISSING, probability, significant
from orip.report.table import PageColumn, PageTable

_NOTHING = 1e-6
"""Of the standard deviation of a mean: what rounding leaves of a mean that is zero."""

_NOTE = (
    "p: probability of so much or more by chance if the a-priori errors are right; marked are groups where it is too "
    "small for the number of groups tested. Mean: of the residuals, adjusted minus observed. Common error: what all "
    "observations of the group would have to be off by, observed minus what all others predict. Worst: the check point "
    "that differs most for its standard deviation."
)


def group_table(solution: Solution) -> PageTable | None:
    """Return the groups with their tests."""
    groups = solution.groups
    if not groups:
        return None
    columns = (
        PageColumn("Group", [group_name(group) for group in groups], words=True),
        PageColumn("Number", [str(group.number) for group in groups], key="number"),
        PageColumn("Redundancy", [significant(group.redundancy) for group in groups], key="redundancy"),
        PageColumn("sigma0", [significant(group.sigma0) for group in groups], key="sigma0"),
        PageColumn("p", [_p(group.p_sigma0) for group in groups]),
        *_estimated_errors(solution),
        PageColumn("Mean", [_with_sd(group.mean, group.mean_sd) for group in groups]),
        PageColumn("p", [_p(group.p_mean) for group in groups]),
        PageColumn("Common error", [_with_sd(group.shift, group.shift_sd) for group in groups]),
        PageColumn("Unit", [unit_of_group(group, solution.ground_unit) for group in groups], words=True),
        PageColumn("Worst", [_worst(group) for group in groups], words=True),
        PageColumn("p", [_p(group.p_worst) for group in groups]),
    )
    emphasised = frozenset(row for row, group in enumerate(groups) if group.doubted)
    return PageTable("groups", "Groups of observations", columns, _NOTE, emphasised)


def _estimated_errors(solution: Solution) -> Iterator[PageColumn]:
    """Yield the column of variance components, where they were estimated."""
    if not solution.variance_components:
        return
    found = []
    for group in solution.groups:
        # a component is estimated for x and y together, and for the stations of all strips
        of_group = (
            _with_sd(row.factor, row.sd)
            for row in solution.variance_components
            if row.kind == group.kind
            and row.of in {"", group.of}
            and group.component in (row.component or group.component)
        )
        found.append(next(of_group, MISSING))
    yield PageColumn("Estimated / given error", found)


def _p(value: float) -> str:
    return MISSING if math.isnan(value) else probability(value).removeprefix("= ")


def _with_sd(value: float, sd: float) -> str:
    text = significant(0.0 if abs(value) < _NOTHING * sd else value, 2)
    return text if text == MISSING else f"{text} ± {significant(sd, 2)}"


def _worst(group: GroupTest) -> str:
    return f"{group.worst}: {significant(group.worst_size, 2)}" if group.kind == "check" else MISSING
