"""`orip check`: gates against the last adjustment."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from orip.errors import ProjectWarning, UsageError
from orip.records.results.tests import GateResult, Status
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.adjust.solve import ADJUSTED_FROM
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.state import Part
from orip.workflow.status import solve_step

CHECKED: tuple[Part, ...] = (*ADJUSTED_FROM, "heads", "solutions")
"""What `check` needs of the stores."""


class CheckOutcome(Struct, frozen=True):
    """What the gates say of the last adjustment of a bundle.

    Parameters
    ----------
    results : tuple of GateResult
        Those of orip.toml first, each gate once.
    """

    bundle: str
    run: str
    status: Status
    results: tuple[GateResult, ...]
    warnings: tuple[ProjectWarning, ...]

    @property
    def solved(self) -> bool:
        """Tell whether the adjustment came to an end by itself."""
        return self.status in {"converged", "doubtful"}

    @property
    def failed(self) -> int:
        """Return how many gates failed."""
        return sum(not result.passed for result in self.results)


def check(bundle: BundleState, expressions: Sequence[str]) -> CheckOutcome:
    """Check gates against the last solution of a bundle.

    Parameters
    ----------
    bundle : BundleState
        With `CHECKED`.
    expressions : sequence of str
        ``name operator number``; those of orip.toml are checked too.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, or a gate of orip.toml is malformed.
    UsageError
        If an expression is malformed, or there is no gate at all.
    """
    gates = project_gates(bundle.project, expressions)
    if not gates:
        message = "there is no gate to check; give one, such as 'sigma0<=1.5', or write [check] gates in orip.toml"
        raise UsageError(message)
    solution, step = bundle.adjusted, solve_step(bundle)
    warnings: tuple[ProjectWarning, ...] = ()
    if step.state == "out of date":
        text = f"the last adjustment is out of date: {step.text}"
        warnings = (ProjectWarning("out-of-date", f"bundle {bundle.name}", text),)
    return CheckOutcome(bundle.name, solution.run, solution.status, check_solution(solution, gates), warnings)
