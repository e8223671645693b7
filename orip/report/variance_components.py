"""The a-priori errors of the groups of observations, as they were estimated."""

from __future__ import annotations

import math

from orip.records.results.solution import Solution
from orip.report.numbers import MISSING, probability, significant
from orip.report.table import PageColumn, PageTable

_NOTE = (
    "Factor: estimated over given a-priori error (Helmert's variance components, iterated); the adjustment uses the "
    "estimated errors. p: two-sided probability of a factor as far from 1 by chance if the given errors are right. "
    "Groups with a redundancy below 1, or that cannot be told from another one, keep the given errors."
)
_UNLIKELY = 0.001


def variance_component_table(solution: Solution) -> PageTable | None:
    """Return the estimated a-priori errors; None where they were not estimated."""
    rows = solution.variance_components
    if not rows:
        return None
    columns = (
        PageColumn("Group", [row.name for row in rows], words=True),
        PageColumn("Number", [str(row.number) for row in rows], key="number"),
        PageColumn("Redundancy", [significant(row.redundancy) for row in rows], key="redundancy"),
        PageColumn("Factor", [significant(row.factor, 3) for row in rows], key="factor.value"),
        PageColumn("sd", [significant(row.sd, 2) for row in rows], key="factor.sd"),
        PageColumn("p", [MISSING if math.isnan(row.p) else probability(row.p).removeprefix("= ") for row in rows]),
    )
    emphasised = frozenset(place for place, row in enumerate(rows) if row.p < _UNLIKELY)
    return PageTable("variance_components", "Estimated a-priori errors", columns, _NOTE, emphasised)
