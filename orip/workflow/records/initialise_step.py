"""Whether orip.toml has to be applied to the stores; without what tries a replay, which takes its time to import."""

from __future__ import annotations

from orip.workflow.project.run_id import Step
from orip.workflow.project.state import ProjectState
from orip.workflow.records.reconcile import apply_text, counted_changes


def initialise_step(state: ProjectState) -> Step:
    """Return whether orip.toml has to be applied to the stores."""
    applied, command = apply_text(state.project, state.definitions, prefer=None), "orip init"
    if applied.complaints:
        text = f"changed both in orip.toml and in the stores: {len(applied.complaints)} of the records"
        return Step(command, "out of date", text)
    if applied.changes and state.definitions.are_empty:
        return Step(command, "missing", "orip.toml has not been applied to the stores")
    if applied.changes:
        return Step(command, "out of date", f"to be applied to the stores: {counted_changes(applied.changes)}")
    return Step(command, "up to date", "the stores hold what orip.toml says")
