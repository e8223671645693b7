"""`orip check`."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from orip.cli.options import BundleOption, Invocation, command
from orip.cli.terminal import warning_rows
from orip.errors import GateError, NotSolvableError
from orip.records.results.result_tests import GATE_FIGURES, GateResult

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

    def check_command(invocation: Invocation, expressions: Expressions = None, bundle: BundleOption = None) -> None:
        from orip.workflow.adjust.check import CHECKED, check
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
