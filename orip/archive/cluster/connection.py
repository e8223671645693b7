"""The cluster of Dask that tasks are handed to, and what its workers have to have in common with the program."""

from __future__ import annotations

import importlib.util
import logging
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from orip.errors import OripError, UsageError
from orip.threads import processors
from orip.version import __version__

if TYPE_CHECKING:
    from distributed import Client


_EXTENSIONS = ("orip.bundle.compiled._observation_loop", "orip.prelim._kernels")


class UnfitWorkerError(Exception):
    """A worker has another orip than the program that hands out the tasks."""


class WorkerFacts(Struct, frozen=True):
    """What a worker has to have in common with the program that hands out the tasks.

    Parameters
    ----------
    orip : str
        Version.
    is_compiled : bool
        The compiled loops are there.
    sees_files : bool
        The folder that client and workers share is there, under the same path.
    can_fork : bool
        The system copies processes.
    """

    orip: str
    is_compiled: bool
    sees_files: bool
    can_fork: bool


def worker_facts(marker: str) -> WorkerFacts:
    """Return the facts of this process; `marker` is the path of a file in the shared folder."""
    is_compiled = all(importlib.util.find_spec(name) is not None for name in _EXTENSIONS)
    return WorkerFacts(__version__, is_compiled, Path(marker).is_file(), hasattr(os, "fork"))


_CONNECT_SECONDS = 10
_WORKERS_SECONDS = 30
_CLOSE_SECONDS = 5
_MOST_DEATHS = 20
"""Workers that may die with a project before it is given up: of a cluster on this machine, where Dask would take 3."""

_MOST_STARTS = 5
"""Times that a worker of this machine is started which dies before it is there."""

_RESTART_TIME = "1 hour"
"""For a worker that died to be there again. Dask would take 15 seconds and then give it up for good: a busy machine
takes longer to load what a worker needs."""

INSTALL = "pip install 'orip[archive]'"


_OWN_CLUSTER = {
    "distributed.scheduler.allowed-failures": _MOST_DEATHS,
    "distributed.worker.profile.enabled": False,
    # as they are usually set, what watches over idle processes takes 8 % of a core with two workers
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.system-monitor.disk": False,
    "distributed.deploy.lost-worker-timeout": _RESTART_TIME,
    # Dask begins no node without a web server: without pages it tells nobody what is computed here
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
"""Settings of a cluster on this machine."""

_WITH_VALUES = {
    "distributed.admin.large-graph-warning-threshold": "1 TB",
    # Dask's developers read the last thousand messages: whoever sends keeps them, with their values
    "distributed.admin.low-level-log-length": 1,
}
"""Settings for tasks that have the values with them which they are computed from, so that they can be repeated."""


class LostClusterError(OripError):
    """The scheduler or its workers no longer answer."""


def require_installed(what: str, packages: Sequence[str]) -> None:
    """Raise UsageError if one of the packages is missing that something needs, given as the beginning of a sentence."""
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        message = f"{what} {' and '.join(missing)}: {INSTALL}"
        raise UsageError(message)


@contextmanager
def connected(address: str | None, workers: int | None, memory: int = 0) -> Iterator[Client]:
    """Connect to a scheduler, or start a cluster on this machine and end it afterwards.

    Parameters
    ----------
    address : str or None
        Of a scheduler, such as ``tcp://host:8786``; None: a cluster is started.
    workers : int or None
        Worker processes of that cluster; None: one for each core.
    memory : int
        Bytes that each of them may use; 0: no limit.

    Raises
    ------
    LostClusterError
        If nothing answers at the address, or no worker is there.
    UsageError
        If the address is malformed, or what a cluster on this machine needs is not installed.
    """
    if address is None:
        require_installed("workers on this machine need", ("cryptography",))
    import dask
    import distributed  # its own settings have to be there before any is changed

    del distributed
    logging.disable(logging.CRITICAL)  # what matters is told by the program itself
    try:
        cluster = _own_cluster(workers, memory) if address is None else _scheduler(address)
        with dask.config.set(_WITH_VALUES), cluster as client:
            yield client
    finally:
        logging.disable(logging.NOTSET)


@contextmanager
def _own_cluster(workers: int | None, memory: int) -> Iterator[Client]:
    """Start a cluster on this machine, and end it.

    Whoever can connect to a scheduler or a worker has it run any code. So they speak TLS with each other alone, by a
    key that is made for this run and is in no file.
    """
    import dask
    from distributed import Client, LocalCluster
    from distributed.security import Security

    with _safe_path(), dask.config.set({**_OWN_CLUSTER, "temporary-directory": str(_own_folder())}):
        try:
            cluster = LocalCluster(
                n_workers=workers or processors(),
                threads_per_worker=1,
                memory_limit=memory,
                security=Security.temporary(),
                dashboard_address="127.0.0.1:0",  # of the web server without pages
                scheduler_kwargs={"dashboard": False},
                worker_class=_starting_again(),
                silence_logs=logging.CRITICAL,
            )
        except RuntimeError as error:
            message = (
                f"the workers of Dask ended while they were started, one of them {_MOST_STARTS} times; see whether "
                "the machine has enough memory, or something ends processes, then repeat the command"
            )
            raise LostClusterError(message) from error
        with cluster, Client(cluster) as client:
            yield client


@contextmanager
def _safe_path() -> Iterator[None]:
    """Have processes that are started look for modules elsewhere than in the working directory.

    It may be a folder from elsewhere, with files that are called like modules.
    """
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


def _own_folder() -> Path:
    """Return a folder where nobody else writes, for the files of scheduler and workers.

    Workers write there when memory is full, and unpickle it again, and all look there for modules. It stays, as Dask
    removes in it what killed workers have left.
    """
    import dask

    within = dask.config.get("temporary-directory", None) or tempfile.gettempdir()
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(within, f"orip-dask-{user}")
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    status = folder.lstat()
    if stat.S_ISDIR(status.st_mode) and (os.name != "posix" or (status.st_uid == user and not status.st_mode & 0o077)):
        return folder
    return Path(tempfile.mkdtemp(prefix="orip-dask-", dir=within))


def _starting_again() -> type[Any]:
    """Return what starts a worker: where it dies before it is there, another one is started, as one is later on."""
    from distributed import Nanny, Status

    class Starting(Nanny):  # type: ignore[misc]  # mypy is told to pass over Dask
        async def instantiate(self) -> Any:
            for _ in range(_MOST_STARTS - 1):
                if (reached := await super().instantiate()) == Status.running or self.status == Status.running:
                    return reached
            return await super().instantiate()

    return Starting


@contextmanager
def _scheduler(address: str) -> Iterator[Client]:
    """Connect to a scheduler, and leave it."""
    from distributed import Client

    try:
        client = Client(address, timeout=_CONNECT_SECONDS)
    except (ValueError, TypeError) as error:
        if address.startswith("tls:"):
            message = (
                f"{address} needs certificates ({error}); name them in Dask's configuration, distributed.comm.tls, for "
                "example by DASK_DISTRIBUTED__COMM__TLS__CA_FILE"
            )
            raise UsageError(message) from None
        message = f"'{address}' is not the address of a scheduler ({error}); it is like tcp://HOST:8786"
        raise UsageError(message) from None
    except (OSError, TimeoutError):
        message = f"no scheduler answers at {address}; start it with 'dask scheduler', or correct --dask"
        raise LostClusterError(message) from None
    try:
        _wait_for_workers(client, address)
        yield client
    finally:
        with suppress(Exception):  # the scheduler may be gone
            client.close(timeout=_CLOSE_SECONDS)


def _wait_for_workers(client: Client, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_WORKERS_SECONDS)
    except TimeoutError:
        message = f"the scheduler at {address} has no worker; start one there with 'dask worker {address}'"
        raise LostClusterError(message) from None


def lost_cluster(client: Client, consequence: str) -> LostClusterError:
    """Return the error of a scheduler that no longer answers; the consequence is that of repeating the command."""
    address = client.scheduler.address if client.scheduler is not None else "this address"
    message = f"the scheduler at {address} no longer answers; start it again and repeat the command: {consequence}"
    return LostClusterError(message)


def require_fit_workers(client: Client, marker: Path, *, forking: bool) -> None:
    """See to it that all workers have the same orip as this process, with the same compiled loops, and see the files.

    Parameters
    ----------
    marker : Path
        A file in the folder that client and workers share.
    forking : bool
        Workers have to copy processes.

    Raises
    ------
    OripError
        With everything that is wrong with the workers.
    """
    from distributed.comm import CommClosedError

    found: Mapping[str, object] = client.run(worker_facts, str(marker), on_error="return")
    here = worker_facts(str(marker))
    faults = [
        f"worker {worker}: {fault}"
        for worker, facts in sorted(found.items())
        if not isinstance(facts, CommClosedError)  # it has died: what comes in its place is started like it
        for fault in _faults(facts, here, marker, forking=forking)
    ]
    if faults:
        raise OripError("\n".join(faults))


def _faults(facts: object, here: WorkerFacts, marker: Path, *, forking: bool) -> Iterator[str]:
    """Yield what is wrong with a worker."""
    if not isinstance(facts, WorkerFacts):
        yield f"orip cannot be loaded there ({facts}); install the same version: {INSTALL}, version {__version__}"
        return
    if facts.orip != here.orip:
        yield f"it has orip {facts.orip}, and this is {here.orip}; install the same version on both"
    if facts.is_compiled != here.is_compiled:
        which, other = ("it", "this installation") if here.is_compiled else ("this installation", "it")
        yield f"{which} lacks the compiled loops that {other} has; install its wheel there, or orip with a C compiler"
    if not facts.sees_files:
        yield f"it does not see {marker.parent}; that folder needs the same path on all machines"
    if forking and not facts.can_fork:
        yield "its system does not copy processes (fork), which the limits of projects need; use Linux or macOS"


def require_dask() -> None:
    """Raise UsageError if what archives need is not installed."""
    require_installed("archives need", ("distributed", "pyarrow"))
