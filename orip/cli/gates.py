"""`orip check` and `orip compare`: whether results are as they have to be."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import BundleOption, Invocation, command
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import GateError, NotSolvableError
from orip.records.results.tests import GATE_FIGURES, GateResult

if TYPE_CHECKING:
    from orip.solving.differences import Comparison, Difference
    from orip.workflow.adjust.compare import CompareOutcome


Expressions = Annotated[
    list[str] | None, typer.Argument(metavar="EXPR", help="'name operator number'; those of orip.toml are checked too.")
]

_HELP = """Check gates against the last adjustment: exit code 5 if one fails, 4 if it did not converge.

A gate is a figure's name, one of < <= > >= == != and a number. A figure that the solution does not have fails.

Example: orip check 'sigma0<=1.5' 'singular==0'

\b
Figures:
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    _register_compare(app)

    def check_command(invocation: Invocation, expressions: Expressions = None, bundle: BundleOption = None) -> None:
        from orip.workflow.adjust.checked_gates import CHECKED, check
        from orip.workflow.project.bundle_state import read_bundle

        outcome = check(read_bundle(invocation.folder, bundle, *CHECKED), expressions or ())
        terminal = invocation.terminal
        terminal.warn(outcome.warnings)
        if terminal.json:
            terminal.document(
                "check",
                {
                    "command": "check",
                    "bundle": outcome.bundle,
                    "run": outcome.run,
                    "status": outcome.status,
                    "gates": gate_rows(outcome.results),
                    "pass": outcome.solved and not outcome.failed,
                    "warnings": warning_rows(outcome.warnings),
                },
            )
        else:
            for result in outcome.results:
                terminal.data(str(result))
        if not outcome.solved:
            terminal.result("check", f"the last adjustment of {outcome.bundle} {_ENDED[outcome.status]}", "red")
            raise typer.Exit(NotSolvableError.exit_code)
        if outcome.failed:
            terminal.result("check", f"{outcome.failed} of {len(outcome.results)} gates failed", "red")
            raise typer.Exit(GateError.exit_code)

    width = max(map(len, GATE_FIGURES))
    figures = (f"{name:{width}}  {meaning}" for name, meaning in GATE_FIGURES.items())
    check_command.__doc__ = _HELP + "\n".join(figures)
    command(app, "check", reads_only=True)(check_command)


_ENDED = {"not_converged": "did not converge", "not_determined": "is not determined", "stopped": "was stopped"}


def gate_rows(results: tuple[GateResult, ...]) -> list[dict[str, object]]:
    """Return results of gates as JSON rows; `reason` says why a value is null."""
    return [
        {
            "name": result.gate.name,
            "operator": result.gate.operator,
            "limit": result.gate.limit,
            "value": result.value if math.isfinite(result.value) else None,
            "pass": result.passed,
            "reason": result.reason or None,
        }
        for result in results
    ]


A = Annotated[Path, typer.Argument(metavar="A", help="A result.json, a project folder with one, or a bundle.")]
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


def _register_compare(app: typer.Typer) -> None:
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

        Example: orip compare before/result.json . --tolerance 0.001, or orip compare MAIN B2 --sigma 1
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
