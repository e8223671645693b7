"""Whether a bundle has to be adjusted; without what adjusts it, which takes its time to import."""

from __future__ import annotations

from orip.files.stores.contents.solution_tables import SolutionHead
from orip.records.names import record_key
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.outputs import stale_solution_outputs
from orip.workflow.project.run_id import WRITTEN_BY, Step, changed_inputs
from orip.workflow.project.texts import Digests, control_input_digests


def solve_step(bundle: BundleState) -> Step:
    """Return whether a bundle has to be adjusted.

    Parameters
    ----------
    bundle : BundleState
        With `ADJUSTED_FROM` and the head of the solution.
    """
    project, command = bundle.project, bundle.command
    head = bundle.state.head(bundle.name)
    if head is None and not bundle.number_of_observations:
        text = f"write 'POINTS {bundle.name} PHOTO' blocks into a .MEA file, then: orip run"
        return Step(command, "missing", f"bundle {bundle.name} has no photo points", text)
    if head is None:
        return Step(command, "missing", f"bundle {bundle.name} has not been adjusted")
    if not bundle.is_measured or record_key(bundle.name) not in bundle.records.bundles:
        return Step(command, "out of date", "its definition or photo observations no longer exist")
    if changed := changed_inputs(head.inputs, inputs_now(bundle)):
        return Step(command, "out of date", f"changed since: {', '.join(changed)}")
    if stale := stale_solution_outputs(project, bundle.name, head.run):
        names = ", ".join(project.shown(path) for path in stale)
        return Step(command, "out of date", f"missing or older than the last adjustment: {names}; {WRITTEN_BY}")
    return _of_head(command, head)


def inputs_now(bundle: BundleState) -> Digests:
    """Return name and digest of all that an adjustment of the bundle would be computed from now."""
    project = bundle.project
    return (*control_input_digests(project, bundle.name), *bundle.digests, project.heading_digest)


def _of_head(command: str, head: SolutionHead) -> Step:
    found = f"{head.status.replace('_', ' ')}, sigma0 {head.sigma0:.4f}"
    if head.status == "stopped":
        return Step(command, "out of date", f"{found}: Ctrl-C ended it before it converged")
    if head.status in ("not_converged", "not_determined"):
        text = f"{found}: do not use its values; correct what the report names, then orip run"
        return Step(command, "failed", text, command.replace("solve", "report"))
    return Step(command, "up to date", found)
