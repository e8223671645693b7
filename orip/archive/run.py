"""`orip archive run`: all projects of an archive, as tasks of Dask."""

from __future__ import annotations

import math
import os
import pickle
import secrets
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from graphlib import CycleError, TopologicalSorter
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from msgspec import Struct, field

from orip.archive.cluster.connection import connected, lost_cluster, require_dask, require_fit_workers
from orip.archive.results import Collected, collect
from orip.archive.run_files import ArchivePlan, ResultsFolder, write_plan
from orip.archive.status import Progress
from orip.archive.task import AS_USUAL, ProjectTask, TaskReply, TaskSettings, keep
from orip.archive.worker import MachineFailureError, run_project
from orip.errors import LockedError, OripError, UsageError
from orip.files.project.tables import ProjectTable
from orip.files.project.toml_lines import toml_document
from orip.files.text.atomic import reporting_failure
from orip.files.text.own_files import locked, make_file, make_named_folder
from orip.files.text.regular_file import regular_bytes
from orip.threads import processors
from orip.version import __version__
from orip.workflow.project.folder import PROJECT_FILE

if TYPE_CHECKING:
    from distributed import Client, Future


class ArchiveProject(Struct, frozen=True):
    """A project of an archive.

    Parameters
    ----------
    name : str
        Its folder from the top of the archive, with slashes; unique in the archive.
    folder : str
        Its folder, absolute.
    stores : tuple of str
        Paths of the stores of cameras and tick marks that it uses, absolute.
    """

    name: str
    folder: str
    stores: tuple[str, ...] = ()


def in_order(projects: Iterable[ArchiveProject]) -> tuple[tuple[ArchiveProject, tuple[str, ...]], ...]:
    """Return the projects so that each comes after those that it waits for, whose names are beside it.

    A project waits for the one in whose folder a store of its cameras or tick marks lies. Where a store lies in the
    folder of none of its projects, all wait for the first of them by name, which makes the store. Projects that would
    wait for each other are taken by name.
    """
    named = {project.name: project for project in sorted(projects, key=lambda project: project.name)}
    waits = _without_circles(_waits(named))
    order = TopologicalSorter(waits).static_order()
    return tuple((named[name], tuple(sorted(waits[name]))) for name in order)


def _waits(named: Mapping[str, ArchiveProject]) -> dict[str, set[str]]:
    users: dict[str, list[str]] = defaultdict(list)
    for project in named.values():
        for store in dict.fromkeys(project.stores):
            users[store].append(project.name)
    waits: dict[str, set[str]] = {name: set() for name in named}
    for store, names in users.items():
        owners = [name for name in names if PurePath(store).parent == PurePath(named[name].folder)]
        first = owners[0] if owners else names[0]
        for name in names:
            if name != first:
                waits[name].add(first)
    return waits


def _without_circles(waits: dict[str, set[str]]) -> dict[str, set[str]]:
    while True:
        try:
            TopologicalSorter(waits).prepare()
        except CycleError as error:
            circle: list[str] = error.args[1]
            # each name of the circle is waited for by the next one: the first by name no longer waits
            place = circle.index(min(circle[1:]), 1)
            waits[circle[place]].discard(circle[place - 1])
        else:
            return waits


_STORE_KEYS = ("camera_file", "temtick_file")


def find_projects(roots: Sequence[Path], results: Path) -> tuple[Path, tuple[ArchiveProject, ...]]:
    """Return the folder from which projects are named, and the projects below some folders, by name.

    Hidden folders and the folder of results are left out; links are not followed.

    Raises
    ------
    UsageError
        If a folder is missing, or there is no project at all.
    """
    missing = [str(root) for root in roots if not root.is_dir()]
    if missing:
        message = f"there is no folder {', '.join(missing)}; name the folders that the projects are in"
        raise UsageError(message)
    tops = [Path(os.path.realpath(root)) for root in roots]
    base = Path(os.path.commonpath(tops))
    avoided = Path(os.path.realpath(results))
    folders = dict.fromkeys(folder for top in tops for folder in _project_folders(top, avoided))
    if not folders:
        named = ", ".join(map(str, roots))
        message = f"there is no project below {named}: no folder there has an {PROJECT_FILE}"
        raise UsageError(message)
    found = (ArchiveProject(_name(folder, base), str(folder), _stores(folder)) for folder in folders)
    return base, tuple(sorted(found, key=lambda project: project.name))


def _project_folders(top: Path, avoided: Path) -> Iterator[Path]:
    for folder, inner, files in os.walk(top):
        inner[:] = sorted(name for name in inner if not name.startswith(".") and Path(folder, name) != avoided)
        if PROJECT_FILE in files:
            yield Path(folder)


def _name(folder: Path, base: Path) -> str:
    return folder.relative_to(base).as_posix() if folder != base else folder.name


def _stores(folder: Path) -> tuple[str, ...]:
    """Return the stores of cameras and tick marks of a project; none where orip.toml cannot be read."""
    try:
        table = toml_document(regular_bytes(folder / PROJECT_FILE).decode("utf-8")).get("project")
    except (OSError, ValueError):
        return ()
    given = table if isinstance(table, dict) else {}
    usual = ProjectTable(name="")
    names = (given.get(key, getattr(usual, key)) for key in _STORE_KEYS)
    return tuple(os.path.realpath(folder / name) for name in names if isinstance(name, str) and "\0" not in name)


_GO_ON = "what is finished is not repeated"
"""What happens when the command is repeated after the scheduler was lost."""

_RETRIES = 2
"""How often a project is repeated whose process died or whom the system refused something."""

_CORES_A_FURTHER_WORKER = 8
"""So many cores have one worker more, which computes while others wait: a project waits a tenth of its time until the
disk has what it writes."""


class ArchiveRequest(Struct, frozen=True):
    """What is to be run, and where.

    Parameters
    ----------
    roots : sequence of Path
        Folders whose projects are run.
    results : Path
        The folder of results.
    method : str
        The method in words, for the overview.
    scheduler : str or None
        Its address; None: a cluster on this machine.
    workers : int or None
        Worker processes on this machine; None: as many as keep its cores busy.
    """

    roots: Sequence[Path]
    results: Path
    settings: TaskSettings = AS_USUAL
    method: str = ""
    scheduler: str | None = None
    workers: int | None = None


class ArchiveWatcher(Struct, frozen=True):
    """Functions that are called as a run goes on: with the plan, when the cluster is there; with each reply."""

    began: Callable[[ArchivePlan], None]
    replied: Callable[[TaskReply, Progress], None]


class ArchiveRun(Struct, frozen=True):
    """A run that has come to its end."""

    progress: Progress
    collected: Collected


def run_archive(request: ArchiveRequest, watcher: ArchiveWatcher) -> ArchiveRun:
    """Adjust all projects that are not finished, and write tables and overview.

    Raises
    ------
    UsageError
        If there is no project, or Dask is not installed.
    LockedError
        If another run writes the same results.
    LostClusterError
        If the scheduler is lost; what is finished stays so.
    OripError
        If the workers do not fit, or the results cannot be written.
    """
    require_dask()
    base, projects = find_projects(request.roots, request.results)
    results = ResultsFolder(request.results.resolve())
    workers = request.workers or processors() + math.ceil(processors() / _CORES_A_FURTHER_WORKER)
    with _alone(results), connected(request.scheduler, workers) as client:
        require_fit_workers(client, results.lock, forking=True)
        names = tuple(project.name for project in projects)
        dashboard = client.dashboard_link if request.scheduler else ""
        plan = ArchivePlan(
            str(base), names, request.settings.digest, request.method, __version__, dashboard, time.time()
        )
        write_plan(results, plan)
        watcher.began(plan)
        progress = Progress(len(projects))
        tasks = _Tasks(client, request.settings, str(results.folder))
        for reply in tasks.replies(projects):
            progress.states[reply.state] += 1
            progress.repeated += reply.repeated
            progress.seconds = time.time() - plan.began
            watcher.replied(reply, progress)
    return ArchiveRun(progress, collect(results, plan))


@contextmanager
def _alone(results: ResultsFolder) -> Iterator[None]:
    """Hold the lock of the results."""
    with reporting_failure(results.folder, "remove the cause, or name another folder with --out"):
        make_named_folder(results.folder)
        make_file(results.lock)
    try:
        with locked(results.lock, str(results.folder), timeout=0.0):
            yield
    except LockedError:
        message = f"another 'orip archive run' is writing {results.folder}; 'orip archive status' shows how far it is"
        raise LockedError(message) from None


class _Tasks(Struct):
    """The tasks of a run at the scheduler."""

    client: Client
    settings: TaskSettings
    results: str
    token: str = field(default_factory=lambda: secrets.token_hex(4))
    again: dict[str, int] = field(default_factory=dict)

    def replies(self, projects: Iterable[ArchiveProject]) -> Iterator[TaskReply]:
        """Hand out all projects, and yield how they end, in the order in which they end."""
        from distributed import as_completed

        futures: dict[str, Future] = {}
        tasks: dict[str, ProjectTask] = {}
        for project, waits in in_order(projects):
            task = ProjectTask(project.name, project.folder, self.results, self.settings)
            tasks[project.name] = task
            futures[project.name] = self._submitted(task, [futures[name] for name in waits])
        names = {future.key: name for name, future in futures.items()}
        ended = as_completed(futures.values())
        futures.clear()  # what nobody holds any longer leaves the scheduler's memory
        for future in ended:
            task = tasks[names.pop(future.key)]
            reply = self._reply(future, task)
            if reply is None:
                repeated = self._submitted(task, [])
                names[repeated.key] = task.name
                ended.add(repeated)
            else:
                yield reply

    def _submitted(self, task: ProjectTask, waits: Sequence[Future]) -> Future:
        number = self.again.get(task.name, 0)
        key = f"{task.name}-{self.token}-{number}"
        return self.client.submit(
            run_project, __version__, pickle.dumps(task), *waits, key=key, retries=_RETRIES, pure=False
        )

    def _reply(self, future: Future, task: ProjectTask) -> TaskReply | None:
        """Return how a project ended; None if it is to be tried again."""
        if future.status == "finished":
            try:
                reply: TaskReply = pickle.loads(future.result())
            except Exception as error:
                raise lost_cluster(self.client, _GO_ON) from error
            return reply
        if future.status != "error":  # cancelled, as all are when the scheduler goes
            raise lost_cluster(self.client, _GO_ON)
        failure = future.exception()
        is_killed = type(failure).__name__ == "KilledWorker"
        if not is_killed and not isinstance(failure, MachineFailureError):
            message = f"a worker cannot adjust projects: {failure}"
            raise OripError(message)
        if is_killed and self.again.get(task.name, 0) < _RETRIES:
            self.again[task.name] = self.again.get(task.name, 0) + 1
            return None
        what = "its workers died again and again" if is_killed else str(failure)
        message = f"{what}; tried {_RETRIES + 1} times, and again by the next 'orip archive run'"
        with reporting_failure(self.results, "remove the cause, then repeat the command"):
            keep(task, "machine", message)
        return TaskReply(task.name, "machine", message)
