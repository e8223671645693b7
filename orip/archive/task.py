"""One project of an archive: adjusted, unless it is finished, and what is kept of it written."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from msgspec import Struct

from orip.archive.run_files import FinishedHead, ResultsFolder, read_head, write_finished
from orip.archive.tables import AdjustedBundle, ProjectOutcome, Row, State, Tables, rows_of_bundles, rows_of_error
from orip.bundle.methods import Method
from orip.errors import InputError, LockedError, OripError
from orip.files.stores.identity import OLDER_STORES, TABLES_OF_KIND, set_older_stores_aside
from orip.files.text.regular_file import file_digest
from orip.solving.solve import NOBODY, PLAIN
from orip.version import __version__
from orip.wording import counted
from orip.workflow.adjust.report import REPORTED_FROM, report_of
from orip.workflow.adjust.solve import SolveOutcome
from orip.workflow.project.commit import commit
from orip.workflow.project.folder import PROJECT_FILE
from orip.workflow.project.state import ProjectState, read_project
from orip.workflow.project.texts import control_input_digests, measurement_files
from orip.workflow.records.initialise import INITIALISED_FROM
from orip.workflow.run import RunSettings, RunWatcher, run
from orip.workflow.status import STATUS_FROM, project_status

_BYTES = 1 if sys.platform == "darwin" else 1024
"""Of the unit in which the system tells the largest memory."""
_FORGET_PEAK = "5"


class ResourceUse(NamedTuple):
    """What a project has used: seconds on the clock, of the processor, largest memory in MB; None: not known."""

    seconds: float
    cpu_seconds: float | None = None
    peak_mb: float | None = None


NOT_MEASURED = ResourceUse(0.0)
"""Of what was given up from outside."""


def begin_use() -> Callable[[], ResourceUse]:
    """Return what tells the use of this process since now.

    Its largest memory is that since then on Linux; elsewhere it is that since the process began.
    """
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(_FORGET_PEAK)
    began, used = time.monotonic(), time.process_time()
    return lambda: ResourceUse(time.monotonic() - began, time.process_time() - used, peak_megabytes())


def peak_megabytes() -> float | None:
    """Return the largest memory of this process; None where the system does not tell."""
    if os.name != "posix":
        return None
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _BYTES / (1 << 20)


class Limits(Struct, frozen=True):
    """What the process of a project may use: seconds on the clock, megabytes of memory."""

    seconds: float
    megabytes: int


class TaskSettings(Struct, frozen=True):
    """How the projects of an archive are adjusted.

    Parameters
    ----------
    gates : tuple of str
        Besides those of orip.toml.
    report : bool
        Write the report of each bundle.
    again : bool
        Adjust projects that are finished, too.
    """

    method: Method = PLAIN
    gates: tuple[str, ...] = ()
    report: bool = True
    again: bool = False
    limits: Limits = Limits(3600.0, 4000)

    @property
    def digest(self) -> str:
        """Return the digest of what the results depend on besides the project."""
        text = "\n".join((__version__, repr(self.method), *self.gates, str(self.report)))
        return hashlib.sha256(text.encode()).hexdigest()


AS_USUAL = TaskSettings()
"""As `orip run` adjusts a project."""


class ProjectTask(Struct, frozen=True):
    """A project to adjust: its name in the archive, its folder, the folder of the results, and how."""

    name: str
    folder: str
    results: str
    settings: TaskSettings


class TaskReply(Struct, frozen=True):
    """How a task ended; `repeated`: the project was finished before, and nothing was done."""

    name: str
    state: State
    message: str = ""
    repeated: bool = False


def carry_out(task: ProjectTask) -> TaskReply:
    """Adjust a project unless it is finished; what is kept of it is written when this returns.

    What the machine is to blame for is returned and not written: the same may go well next time.

    Raises
    ------
    MemoryError
    """
    renewed = _set_older_stores_aside(Path(task.folder))
    texts = _digest_of_texts(Path(task.folder))
    head = read_head(ResultsFolder(Path(task.results)), task.name)
    if head is not None and not task.settings.again and _is_finished(task, head, texts):
        return TaskReply(task.name, head.state, head.message, repeated=True)
    used = begin_use()
    state, message, tables = _ended(lambda: _adjusted(task))
    message = message or renewed
    if state != "machine":
        keep(task, state, message, tables, texts, used())
    return TaskReply(task.name, state, message)


def _is_finished(task: ProjectTask, head: FinishedHead, texts: str) -> bool:
    """Tell whether what is kept of a project is what would be found now."""
    if head.state == "machine" or head.settings != _settings_of(task, head.state) or head.texts != texts:
        return False
    # a project that was ended by its limits may have got anywhere
    return head.state == "over limit" or head.steps == _digest_of_steps(Path(task.folder))


def keep(
    task: ProjectTask,
    state: State,
    message: str,
    tables: Tables | None = None,
    texts: str = "",
    used: ResourceUse = NOT_MEASURED,
) -> None:
    """Write what is kept of a project.

    Raises
    ------
    OSError
    """
    steps = _digest_of_steps(Path(task.folder)) if state in {"adjusted", "wrong"} else ""
    rows = tables or rows_of_error(task.name, state, message)
    outcome = ProjectOutcome(task.name, state, message, texts, steps, rows, _of_computation(task.name, used))
    write_finished(ResultsFolder(Path(task.results)), outcome, _settings_of(task, state), time.time())


def keep_over_limit(task: ProjectTask, message: str, seconds: float) -> TaskReply:
    """Write that a project needs more than it may have, from outside of its process."""
    keep(task, "over limit", message, texts=_digest_of_texts(Path(task.folder)), used=ResourceUse(seconds))
    return TaskReply(task.name, "over limit", message)


def _settings_of(task: ProjectTask, state: State) -> str:
    """Return what has to be the same for an outcome to stand: the limits too where the project is over one."""
    settings = task.settings
    return f"{settings.digest} {settings.limits}" if state == "over limit" else settings.digest


def _set_older_stores_aside(folder: Path) -> str:
    """Move stores of a project that an older orip wrote out of the way, and say so; empty if there are none.

    Stores of other projects, of shared cameras, are left to the tasks of these.
    """
    with suppress(OSError):  # whatever it is, opening the project tells it
        stores = (path for path in folder.iterdir() if path.suffix[1:] in TABLES_OF_KIND)
        if moved := set_older_stores_aside(sorted(stores)):
            return (
                f"{counted(len(moved), 'store')} of an older orip made again from the texts; the old ones, with what "
                f"commands may have changed in them alone, are in {OLDER_STORES}"
            )
    return ""


def _ended(adjust: Callable[[], Tables]) -> tuple[State, str, Tables | None]:
    """Return how an adjustment ended; the end of the memory is for the caller, who may have some left."""
    try:
        return "adjusted", "", adjust()
    except OSError as error:
        return "machine", f"the system refused: {error}", None
    except OripError as error:
        is_refused = isinstance(error, LockedError) or isinstance(error.__cause__, OSError)
        return "machine" if is_refused and not isinstance(error, InputError) else "wrong", first_line(error), None
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001  # one faulty project must not end the archive
        return "wrong", f"internal error: {type(error).__name__}: {error}; please report it", None


def first_line(error: OripError) -> str:
    """Return the first line that a user would see of an error."""
    text = str(error.told[0]) if isinstance(error, InputError) else str(error)
    return text.partition("\n")[0]


def _adjusted(task: ProjectTask) -> Tables:
    folder, settings = Path(task.folder), task.settings
    state = read_project(folder, *INITIALISED_FROM)
    outcomes = run(state, None, _SILENT, RunSettings(None, settings.method, settings.gates))
    if settings.report and outcomes:
        state = state.read_again(*REPORTED_FROM)
        for outcome in outcomes:
            commit(report_of(state, outcome.solution, outcome.gates))
    return rows_of_bundles(task.name, [_bundle(state, outcome, report=settings.report) for outcome in outcomes])


_SILENT = RunWatcher(
    initialised=lambda _: None,
    measured=lambda _: None,
    solving=NOBODY,
    solved=lambda _: None,
    driven=lambda _: None,
    processed=lambda *_: None,
)


def _bundle(state: ProjectState, outcome: SolveOutcome, *, report: bool) -> AdjustedBundle:
    project = state.project
    page = project.shown(project.report(outcome.solution.bundle)) if report else ""
    return AdjustedBundle(outcome.solution, outcome.gates, page, str(project.definition.crs or ""))


def _of_computation(name: str, used: ResourceUse) -> Row:
    return {
        "project": name,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": round(used.seconds, 3),
        "cpu_seconds": None if used.cpu_seconds is None else round(used.cpu_seconds, 3),
        "peak_mb": None if used.peak_mb is None else round(used.peak_mb, 1),
        "host": platform.node(),
        "orip": __version__,
    }


def _digest_of_texts(folder: Path) -> str:
    """Return the digest of the texts of a project; of orip.toml alone where that cannot be read."""
    digests = []
    with suppress(OSError):
        digests.append((PROJECT_FILE, file_digest(folder / PROJECT_FILE)))
    with suppress(OripError, OSError):
        project = read_project(folder).project
        digests += ((project.shown(path), file_digest(path)) for path in measurement_files(project).value)
        for bundle in project.bundle_names:
            digests += control_input_digests(project, bundle)
    return hashlib.sha256(repr(digests).encode("utf-8", "surrogatepass")).hexdigest()


def _digest_of_steps(folder: Path) -> str:
    """Return the digest of what `orip status` shows: it changes with stores, shared cameras, and outputs."""
    try:
        state = read_project(folder, *STATUS_FROM)
        shown: object = (project_status(state).steps, [str(state.head(name)) for name in state.project.bundle_names])
    except OripError as error:
        shown = str(error)
    return hashlib.sha256(repr(shown).encode("utf-8", "surrogatepass")).hexdigest()
