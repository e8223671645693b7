"""`orip compare`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import Invocation, command
from orip.cli.terminal import Terminal
from orip.errors import GateError

if TYPE_CHECKING:
    from orip.solving.differences import Comparison, Difference
    from orip.workflow.adjust.compare import CompareOutcome

A = Annotated[Path, typer.Argument(metavar="A", help="A result.json, or a project folder with one.")]
B = Annotated[Path, typer.Argument(metavar="B", help="The one to compare it with.")]
ToleranceOption = Annotated[
    float, typer.Option("--tolerance", min=0.0, help="Allowed difference, in each figure's own unit.")
]
RelativeOption = Annotated[
    float,
    typer.Option(
        "--relative",
        min=0.0,
        help="Relative tolerance, multiplied by the block's extent for ground coordinates and by 1 rad for angles.",
    ),
]
SigmaOption = Annotated[
    float | None,
    typer.Option("--sigma", min=0.0, help="Tolerance in standard deviations instead; compares adjusted values only."),
]

_SHOWN = 20


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "compare", reads_only=True)
    def compare_command(
        invocation: Invocation,
        a: A,
        b: B,
        tolerance: ToleranceOption = 1e-9,
        relative: RelativeOption = 1e-6,
        sigma: SigmaOption = None,
    ) -> None:
        """Compare the figures of two results: exit code 0 if they are equal within the tolerance, 5 if not.

        Differences are listed largest first, measured by what is allowed; angles are compared on the circle.

        Example: orip compare before/result.json . --tolerance 0.001
        """
        from orip.solving.differences import Tolerance
        from orip.workflow.adjust.compare import compare

        outcome = compare(invocation.folder, a, b, Tolerance(tolerance, relative, sigma))
        terminal = invocation.terminal
        if terminal.json:
            terminal.document("compare", _document(outcome))
        else:
            _list(terminal, outcome.comparison)
        _tell(terminal, outcome)
        if not outcome.comparison.equal:
            raise typer.Exit(GateError.exit_code)


def _document(outcome: CompareOutcome) -> dict[str, object]:
    comparison, tolerance = outcome.comparison, outcome.tolerance
    return {
        "command": "compare",
        "a": outcome.a,
        "b": outcome.b,
        "tolerance": tolerance.absolute,
        "relative": tolerance.relative,
        "sigma": tolerance.sigma,
        "equal": comparison.equal,
        "compared": comparison.compared,
        "differences": [
            {
                "name": difference.name,
                "a": difference.a,
                "b": difference.b,
                "difference": difference.size if math.isfinite(difference.size) else None,
                "allowed": difference.allowed,
            }
            for difference in comparison.differences
        ],
        "only_in_a": list(comparison.only_a),
        "only_in_b": list(comparison.only_b),
    }


def _list(terminal: Terminal, comparison: Comparison) -> None:
    from orip.files.text.table import Column, table_lines

    shown = comparison.differences if terminal.verbose else comparison.differences[:_SHOWN]
    if shown:
        columns = (
            Column("Figure", [difference.name for difference in shown], align="left"),
            Column("A", [_shown(difference.a, difference) for difference in shown], align="point"),
            Column("B", [_shown(difference.b, difference) for difference in shown], align="point"),
            Column(
                "Difference",
                [f"{difference.size:.2g}" if math.isfinite(difference.size) else "" for difference in shown],
            ),
            Column("Allowed", [f"{difference.allowed:.2g}" for difference in shown]),
        )
        terminal.tables("\n".join(table_lines(columns, indent=0)))
    for names, which in ((comparison.only_a, "A"), (comparison.only_b, "B")):
        for name in names if terminal.verbose else names[:_SHOWN]:
            terminal.data(f"only in {which}: {name}")


def _shown(value: float | str | None, difference: Difference) -> str:
    """Return a value with the digits in which the two differ, and one more."""
    if not isinstance(value, float):
        return "null" if value is None else value
    if not 0.0 < difference.size < math.inf:
        return repr(value)
    size = max(abs(value), difference.size)
    digits = math.floor(math.log10(size)) - math.floor(math.log10(difference.size)) + 2
    return f"{value:.{min(max(digits, 4), 17)}g}"


def _tell(terminal: Terminal, outcome: CompareOutcome) -> None:
    comparison = outcome.comparison
    if comparison.equal:
        terminal.say(f"compare  equal: {comparison.compared} figures agree within the tolerance", "green")
        return
    parts = [f"{len(comparison.differences)} of {comparison.compared} figures differ"]
    for names, shown in ((comparison.only_a, outcome.a), (comparison.only_b, outcome.b)):
        if names:
            parts.append(f"{len(names)} are in {shown} only")
    hidden = max(len(rows) for rows in (comparison.differences, comparison.only_a, comparison.only_b)) > _SHOWN
    more = f" (at most {_SHOWN} of each are listed; -v lists all)" if hidden and not terminal.verbose else ""
    terminal.say(f"compare  {'; '.join(parts)}{more}", "red")
