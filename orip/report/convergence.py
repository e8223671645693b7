"""How the iterations went: ENP, sigma0 and down-weighted components over the iteration."""

from __future__ import annotations

from markupsafe import Markup

from orip.records.results.solution import Solution
from orip.report.drawings.svg import ChartFrame, Curve, line_chart
from orip.report.numbers import fixed, significant
from orip.report.report_input import ReportInput
from orip.report.table import PageColumn, PageTable


def convergence_charts(given: ReportInput) -> tuple[Markup, ...]:
    """Return the three curves, each in a chart of its own: they have no common scale."""
    passes = given.solution.iterations
    if not passes:
        return ()
    ends = [(float(passes[0].iteration), given.bundle.enp_stop), (float(passes[-1].iteration), given.bundle.enp_stop)]
    enp = [Curve([(step.iteration, step.enp) for step in passes], "ENP", "first"), Curve(ends, "enp_stop", "limit")]
    sigma0 = [Curve([(step.iteration, step.sigma0) for step in passes], "sigma0", "second")]
    down = [Curve([(step.iteration, float(step.down_weighted)) for step in passes], "down-weighted", "third")]
    wide = max((step.sigma0 for step in passes), default=1.0) > 10.0 * min(step.sigma0 for step in passes)
    return (
        line_chart("ENP over the iterations", _frame("ENP"), enp),
        line_chart("sigma0 over the iterations", _frame("sigma0", logarithmic=wide), sigma0),
        line_chart("Down-weighted components over the iterations", _frame("down-weighted", counts=True), down),
    )


def iteration_table(solution: Solution) -> PageTable:
    """Return the iterations in numbers."""
    passes = solution.iterations
    columns = (
        PageColumn("Iteration", [str(step.iteration) for step in passes], key="iteration"),
        PageColumn("ENP", [fixed(step.enp, 2) for step in passes], key="enp"),
        PageColumn("sigma0", [significant(step.sigma0, 5) for step in passes], key="sigma0"),
        PageColumn("Down-weighted", [str(step.down_weighted) for step in passes], key="down_weighted"),
        PageColumn("Singular", [str(step.singular) for step in passes], key="singular"),
    )
    shortened = [str(step.iteration) for step in passes if step.step_limited]
    note = f"Steps were shortened in iteration {', '.join(shortened)}." if shortened else ""
    return PageTable("iterations", "Iterations", columns, note)


def _frame(up: str, *, logarithmic: bool = False, counts: bool = False) -> ChartFrame:
    return ChartFrame("iteration", up, 340.0, 200.0, True, logarithmic, counts)
