"""What the commands of archives print."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from orip.archive.status import duration
from orip.cli.terminal import Terminal
from orip.files.text.shown import printable
from orip.wording import counted

if TYPE_CHECKING:
    from orip.archive.diff import ArchiveDifferences, Changed, Moved
    from orip.archive.results import Collected
    from orip.archive.run import ArchiveRun, ArchiveWatcher
    from orip.archive.run_files import ArchivePlan
    from orip.archive.simulation import SimulatedArchive
    from orip.archive.status import ArchiveStatus, Progress
    from orip.archive.task import TaskReply


_SECONDS_BETWEEN = 10.0
"""Between two lines on progress."""

_SHOWN = 20


def watcher(terminal: Terminal) -> ArchiveWatcher:
    """Return what tells of a run as it goes on."""
    from orip.archive.run import ArchiveWatcher

    told, not_adjusted = time.monotonic(), 0

    def began(plan: ArchivePlan) -> None:
        dashboard = f"; dashboard {plan.dashboard}" if plan.dashboard else ""
        terminal.say(f"archive  {counted(len(plan.projects), 'project')} below {plan.base}{dashboard}")

    def replied(reply: TaskReply, progress: Progress) -> None:
        nonlocal told, not_adjusted
        if reply.state != "adjusted" and not reply.repeated:
            not_adjusted += 1
            if not_adjusted <= _SHOWN or terminal.verbose:
                terminal.say(f"{reply.state:8} {printable(reply.name)}: {printable(reply.message)}", "yellow")
            elif not_adjusted == _SHOWN + 1:
                terminal.say("         further ones are not listed; 'orip archive status -v' does", "yellow")
        if time.monotonic() - told > _SECONDS_BETWEEN:
            told = time.monotonic()
            terminal.say(f"         {progress}")

    return ArchiveWatcher(began, replied)


def run_document(done: ArchiveRun) -> dict[str, object]:
    """Return the JSON document of a run."""
    progress = done.progress
    return {
        "command": "archive run",
        "projects": progress.total,
        "states": dict(progress.states),
        "finished_before": progress.repeated,
        "seconds": round(progress.seconds, 1),
        "tables": str(done.collected.tables),
        "overview": str(done.collected.overview),
    }


def report_document(collected: Collected) -> dict[str, object]:
    """Return the JSON document of tables and overview."""
    return {
        "command": "archive report",
        "rows": dict(collected.rows),
        "tables": str(collected.tables),
        "overview": str(collected.overview),
    }


def tell_run(terminal: Terminal, done: ArchiveRun) -> None:
    """Say how a run ended."""
    terminal.say(f"archive  {done.progress} in {duration(done.progress.seconds)}", "bold")
    tell_collected(terminal, done.collected)


def tell_collected(terminal: Terminal, collected: Collected) -> None:
    """Say what was written."""
    rows = ", ".join(
        counted(count, table.removesuffix("s")) for table, count in collected.rows.items() if table != "runs"
    )
    terminal.point("wrote", f"{collected.tables} ({rows})")
    terminal.point("wrote", f"{collected.overview}; open it in a browser")


def show_status(terminal: Terminal, status: ArchiveStatus) -> None:
    """Print how far a run is."""
    progress, plan = status.progress, status.plan
    ended = progress.ended == progress.total
    state = (
        "running"
        if status.is_running
        else "finished"
        if ended
        else "not running; repeat 'orip archive run' to continue"
    )
    lines = [f"archive  {printable(plan.base)}, {state}", f"         {progress}"]
    lines += [f"         dashboard {printable(plan.dashboard)}"] if status.is_running and plan.dashboard else []
    shown = status.wrong if terminal.verbose else status.wrong[:_SHOWN]
    lines += [f"wrong    {printable(name)}: {printable(message)}" for name, message in shown]
    if len(shown) < len(status.wrong):
        lines.append(f"         {len(status.wrong) - len(shown)} more; -v lists all")
    content = {
        "command": "archive status",
        "base": plan.base,
        "running": status.is_running,
        "projects": progress.total,
        "states": dict(progress.states),
        "projects_a_second": round(progress.rate, 3),
        "seconds_left": progress.seconds_left,
        "dashboard": plan.dashboard,
        "not_adjusted": [{"project": name, "message": message} for name, message in status.wrong],
    }
    terminal.answer("archive-status", content, "\n".join(lines))


def show_differences(terminal: Terminal, found: ArchiveDifferences) -> None:
    """Print what differs between two runs."""
    content = {
        "command": "archive diff",
        "compared": found.compared,
        "changed": [_row(change) for change in found.changed],
        "moved": [
            {**_row(value), "times": value.times if value.times < float("inf") else None} for value in found.moved
        ],
    }
    changes = found.changed if terminal.verbose else found.changed[:_SHOWN]
    values = found.moved if terminal.verbose else found.moved[:_SHOWN]
    lines = [
        printable(f"{_place(change)}: {change.name}: {change.before or '-'} -> {change.after or '-'}")
        for change in changes
    ]
    lines += [
        printable(f"{_place(value)}: {value.name}: {value.before:.10g} -> {value.after:.10g} ({value.times:.1f} sd)")
        for value in values
    ]
    if terminal.json or lines:
        terminal.answer("archive-diff", content, "\n".join(lines))
    hidden = len(found.changed) + len(found.moved) - len(lines)
    more = f" ({hidden} more; -v lists all)" if hidden else ""
    projects = len({change.project for change in found.changed} | {value.project for value in found.moved})
    terminal.say(
        f"diff     {counted(found.compared, 'bundle')} compared, {counted(projects, 'project')} with differences: "
        f"{counted(len(found.changed), 'change')} of result or gate, {counted(len(found.moved), 'value')} moved{more}"
    )


def _place(item: Changed | Moved) -> str:
    return f"{item.project} {item.bundle}".rstrip()


def _row(item: Changed | Moved) -> Mapping[str, object]:
    names: Sequence[str] = ("project", "bundle", "name", "before", "after")
    return {name: getattr(item, name) for name in names}


def tell_simulated(terminal: Terminal, written: SimulatedArchive) -> None:
    """Say what was simulated."""
    kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(written.faults.items()))
    content = {
        "command": "archive simulate",
        "folder": str(written.folder),
        "projects": written.projects,
        "faults": dict(written.faults),
    }
    if terminal.json:
        terminal.document("archive-simulate", content)
    mistakes = f"; with a mistake: {kinds}" if kinds else ""
    terminal.say(f"simulate {counted(written.projects, 'project')} in {written.folder}{mistakes}")
