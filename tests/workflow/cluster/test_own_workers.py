"""Workers that orip starts on this machine: nobody else may use them, and one that dies at the start is replaced."""

from __future__ import annotations

import http.client
import os
import pickle
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from orip.archive.cluster import connection
from orip.archive.cluster.connection import LostClusterError, UnfitWorkerError, connected, require_fit_workers
from orip.archive.cluster.worker_tasks import stored_tasks
from orip.errors import OripError, UsageError

pytest.importorskip("distributed")

USES_THE_SCHEDULER = """
import logging, sys; logging.disable(50)
from distributed import Client
try: Client(f"tcp://{sys.argv[1]}", timeout=1)
except OSError: pass
import os
if os.getuid() == 0: os.setgroups([]); os.setgid(65534); os.setuid(65534); os.environ["HOME"] = "/tmp"; os.chdir("/tmp")
try: Client(f"tcp://{sys.argv[1]}", timeout=2).run_on_scheduler(lambda: open(sys.argv[2], "w"))
except OSError as error: print("refused", type(error).__name__)
else: print("carried out")
"""


def listened_at_by(pids: set[int]) -> set[tuple[str, int]]:
    """Return the addresses at which processes listen."""
    psutil = pytest.importorskip("psutil")
    found = (psutil.Process(pid).net_connections("inet") for pid in pids)
    return {tuple(one.laddr) for many in found for one in many if one.status == psutil.CONN_LISTEN}


def test_code_of_another_program_is_not_run_and_no_port_tells_anything(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    with connected(None, 1) as client:
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        mark = tmp_path / "mark"
        words = [sys.executable, "-c", USES_THE_SCHEDULER, address.removeprefix("tls://"), str(mark)]
        said = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
        assert said.stdout.startswith("refused"), said.stderr
        assert not mark.exists()
        ports = listened_at_by({os.getpid(), *client.run(os.getpid).values()})
        assert len(ports) >= 4  # scheduler, nanny and worker, and the web servers that Dask begins
        for host, port in ports:
            assert host == "127.0.0.1"
            assert _refuses_a_stranger(port), port


def _refuses_a_stranger(port: int) -> bool:
    """Tell whether a port answers neither a request of a browser nor a TLS client without the key."""
    try:
        for page in ("/", "/status", "/info/main/workers.html", "/json/counts.json", "/metrics", "/health"):
            with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=1)) as asking:
                asking.request("GET", page)
                if asking.getresponse().status < 400:
                    return False
    except (http.client.HTTPException, OSError):
        pass
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with (
            socket.create_connection(("127.0.0.1", port), 1) as plain,
            context.wrap_socket(plain) as encrypted,
        ):
            encrypted.settimeout(1)
            return not encrypted.recv(1)  # with TLS 1.3 the refusal comes after the client is done
    except OSError:
        return True


def test_the_key_is_in_no_file_and_on_no_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cryptography")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with connected(None, 1) as client:
        key = client.security.tls_client_key.splitlines()[1]
        for pid in client.run(os.getpid).values():
            for name in ("cmdline", "environ") if Path("/proc").is_dir() else ():
                assert key.encode() not in Path(f"/proc/{pid}/{name}").read_bytes()
        assert not any(key.encode() in path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())


WITH_A_CLUSTER = """
import os
from orip.archive.cluster.connection import connected
if __name__ == "__main__":
    with connected(None, 1) as client:
        assert client.submit(os.getpid).result(timeout=30) != os.getpid()
"""


def test_modules_in_the_working_directory_are_not_those_of_workers(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    program, folder = tmp_path / "program" / "begin.py", tmp_path / "from_elsewhere"
    program.parent.mkdir()
    program.write_text(WITH_A_CLUSTER, encoding="utf-8")
    folder.mkdir()
    for name in ("multiprocessing", "tempfile", "dask", "bisect", "orip", "pickle"):
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / name)!r}, 'w').close()\n", encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, program], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )
    assert ended.returncode == 0, ended.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"program", "from_elsewhere"}


def test_values_that_workers_write_to_the_disk_are_where_nobody_else_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cryptography")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with connected(None, 1) as client:
        (first,) = client.run(lambda dask_worker: dask_worker.local_directory).values()
        second = client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.local_directory)
    own = connection._own_folder()
    assert own in Path(first).parents
    assert own in Path(second).parents
    assert own.parent == tmp_path
    if os.name == "posix":
        assert own.stat().st_mode & 0o777 == 0o700
        own.chmod(0o777)
        assert connection._own_folder() not in {own, tmp_path}
    own.rename(tmp_path / "moved")
    (tmp_path / "elsewhere").mkdir()
    own.symlink_to(tmp_path / "elsewhere")
    assert connection._own_folder() not in {own, tmp_path / "elsewhere"}


def children(begun_before: set[int]) -> set[int]:
    psutil = pytest.importorskip("psutil")
    started = psutil.Process().children(recursive=True)
    return {child.pid for child in started if "spawn_main" in " ".join(_words(child))} - begun_before


def _words(process: object) -> list[str]:
    psutil = pytest.importorskip("psutil")
    try:
        return list(process.cmdline())  # type: ignore[attr-defined]
    except psutil.Error:
        return []


def _killing(wanted: Callable[[int], bool], ended: threading.Event) -> threading.Thread:
    """Kill workers that are being started, as long as so many may be."""

    def kill() -> None:
        killed: set[int] = set()
        before = children(set())
        while not ended.wait(0.02) and wanted(len(killed)):
            for pid in children(killed | before):
                os.kill(pid, signal.SIGKILL)
                killed.add(pid)

    return threading.Thread(target=kill)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no signal that ends at once")
def test_a_worker_that_is_killed_while_it_starts_is_replaced() -> None:
    pytest.importorskip("cryptography")
    ended = threading.Event()
    killer = _killing(lambda number: number < 2, ended)
    killer.start()
    try:
        with connected(None, 1) as client:
            assert client.submit(os.getpid).result(timeout=60) > 0
    finally:
        ended.set()
        killer.join()


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no signal that ends at once")
def test_workers_that_are_killed_at_each_start_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cryptography")
    monkeypatch.setattr(connection, "_MOST_STARTS", 3)
    ended = threading.Event()
    killer = _killing(lambda _: True, ended)
    killer.start()
    try:
        with (
            pytest.raises(LostClusterError, match="ended while they were started, one of them 3 times"),
            connected(None, 1),
        ):
            pass
    finally:
        ended.set()
        killer.join()


def test_a_worker_that_has_died_before_it_was_asked_is_not_called_unfit(tmp_path: Path) -> None:
    from distributed.comm import CommClosedError

    class Asked:
        def run(self, *_: object, **__: object) -> dict[str, object]:
            return {"tls://127.0.0.1:1": CommClosedError("gone"), "tls://127.0.0.1:2": ValueError("no orip")}

    with pytest.raises(OripError, match=r"^worker tls://127\.0\.0\.1:2: orip cannot be loaded there"):
        require_fit_workers(Asked(), tmp_path, forking=False)  # type: ignore[arg-type]


def test_a_scheduler_with_certificates_of_the_users_own(tmp_path: Path) -> None:
    dask = pytest.importorskip("dask")
    pytest.importorskip("cryptography")
    from distributed import LocalCluster, Security

    made = Security.temporary()
    for name, text in (("key", made.tls_client_key), ("certificate", made.tls_client_cert)):
        (tmp_path / name).write_text(text, encoding="ascii")
    tls = {"ca-file": str(tmp_path / "certificate")}
    for role in ("scheduler", "worker", "client"):
        tls |= {f"{role}.key": str(tmp_path / "key"), f"{role}.cert": str(tmp_path / "certificate")}
    with dask.config.set({f"distributed.comm.tls.{name}": value for name, value in tls.items()}):
        cluster = LocalCluster(n_workers=1, processes=False, protocol="tls", dashboard_address="127.0.0.1:0")
        with cluster, connected(cluster.scheduler_address, None) as client:
            assert client.scheduler.address.startswith("tls://")
            assert client.submit(len, "abc").result(timeout=30) == 3
    with pytest.raises(UsageError, match="needs certificates"), connected("tls://127.0.0.1:9", None):
        pass


def test_a_task_file_that_somebody_else_has_written_is_not_unpickled(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    file = stored_tasks(tmp_path / "tasks", [[1, 2, 3], list(range(100_000))])
    (first, second), path = file.tasks, Path(file.tasks[0].path)
    assert (first.read(), second.read()) == ([1, 2, 3], list(range(100_000)))

    class Code:
        def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
            return Path.touch, (mark,)

    code = pickle.dumps(Code())
    path.write_bytes(code + path.read_bytes()[len(code) :])
    with pytest.raises(UnfitWorkerError, match="has been changed since it was written"):
        first.read()
    other = tmp_path / "other"
    path.rename(other)
    path.symlink_to(other)
    with pytest.raises(UnfitWorkerError, match="cannot read"):
        second.read()
    path.unlink()
    if hasattr(os, "mkfifo"):
        os.mkfifo(path)
        began = time.monotonic()
        with pytest.raises(UnfitWorkerError):
            second.read()
        assert time.monotonic() - began < 5.0
    assert not mark.exists()
