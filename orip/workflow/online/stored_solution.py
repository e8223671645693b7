"""The stored solution of a bundle, where a session may start from it."""

from __future__ import annotations

from orip.records.results.solution import Solution
from orip.workflow.adjust.solve_step import inputs_now
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.run_id import changed_inputs
from orip.workflow.project.state import read_state

_ENDED = ("converged", "doubtful")
"""What is doubtful about a solution shows in a session again."""


def solution_of_what_is_measured(bundle: BundleState) -> Solution | None:
    """Return the last solution of a bundle if it has converged and nothing that it was computed from has changed.

    Parameters
    ----------
    bundle : BundleState
        With definitions, what is measured, and heads.
    """
    head = bundle.state.head(bundle.name)
    if head is None or head.status not in _ENDED or changed_inputs(head.inputs, inputs_now(bundle)):
        return None
    solution = read_state(bundle.project, ["solutions"], [bundle.name]).solution(bundle.name)
    # another run may have replaced it meanwhile
    return solution if solution is not None and solution.run == head.run else None
