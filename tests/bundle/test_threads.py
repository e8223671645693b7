"""However many threads share the work, every result is the same to the last bit."""

from __future__ import annotations

import _thread
import hashlib
import os
import platform
import subprocess
import sys
import threading
from collections.abc import Callable

import numpy as np
import pytest
from aerial_blocks import aerial_block
from bundle.test_banded_block import BLOCK as BANDED
from bundle.test_photo_loop import two_cameras_with_sets
from support.wrong_calls import recorded

from orip import arrays, threads
from orip.adjustment.factorisation import band as band_panels
from orip.adjustment.factorisation import band_cholesky as two_ends
from orip.bundle.compiled import photo_loop
from orip.bundle.solve import solve_block
from orip.records.block import Block
from orip.structs import replace
from orip.threads import at_once, available_threads, begin_thread, by_threads, limited_threads

THREADS = (1, 2, 4, 16)


def free_network() -> Block:
    return replace(BANDED, definition=replace(BANDED.definition, datum="free"), control_points=())


BLOCKS = {
    "band": lambda: BANDED,
    "full matrix": lambda: aerial_block(20, 60),
    "free network": free_network,
    "sets": two_cameras_with_sets,
}


def digest_of(block: Block) -> str:
    """Return the digest of all that an adjustment finds."""
    solved = solve_block(block, lambda _: None, lambda: False)
    state, found = solved.state, solved.cofactors
    every = np.arange(solved.problem.layout.reduced)
    arrays = (
        state.cameras, state.centres, state.rotations, state.points, solved.equations.residual, found.blocks,
        found.leverage, found.reduced.diagonal() if len(every) > 1000 else found.reduced[every, every],
    )  # fmt: skip
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@pytest.mark.parametrize("name", BLOCKS)
def test_results_do_not_depend_on_the_number_of_threads(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    block = BLOCKS[name]()
    # even these small blocks are shared out
    monkeypatch.setattr(photo_loop, "_RAYS_OF_A_THREAD", 10)
    monkeypatch.setattr(two_ends, "_WORK_OF_A_THREAD", 0.0)
    monkeypatch.setattr(threads, "_PARTS_OF_A_THREAD", 1)
    monkeypatch.setattr(band_panels, "_PANELS_OF_A_THREAD", 1)
    monkeypatch.setattr(arrays, "_AT_A_TIME", 100)
    shared: list[int] = []
    for module in (photo_loop, two_ends):
        monkeypatch.setattr(module, "at_once", lambda tasks: shared.append(len(tasks)) or at_once(tasks))
    digests = []
    for count in THREADS:
        with limited_threads(count):
            digests.append(digest_of(block))
    assert digests == digests[:1] * len(THREADS)
    assert max(shared, default=16) == 16 or not photo_loop.is_compiled()


def test_the_limit_is_that_of_the_block_then_of_the_variable_then_the_processors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(threads.VARIABLE, "3,2")
    assert available_threads() == 3
    with limited_threads(5):
        assert available_threads() == 5
        with limited_threads(None):
            assert available_threads() == 5
    for nothing in ("", "0", "many"):
        monkeypatch.setenv(threads.VARIABLE, nothing)
        assert 1 <= available_threads() <= (os.cpu_count() or 1)


def test_tasks_run_at_the_same_time_and_the_first_error_is_raised() -> None:
    together = threading.Barrier(3, timeout=10.0)

    def arrive(number: int) -> int:
        together.wait()
        return number

    assert at_once([lambda number=number: arrive(number) for number in range(3)]) == [0, 1, 2]

    def fail() -> int:
        message = "no memory"
        raise MemoryError(message)

    with pytest.raises(MemoryError, match="no memory"):
        at_once([lambda: 1, fail])


def test_threads_share_parts_whose_results_stay_in_order() -> None:
    together, takers = threading.Barrier(3, timeout=10.0), set[int]()

    def take(part: int) -> int:
        if threading.get_ident() not in takers:
            takers.add(threading.get_ident())
            together.wait()
        return 2 * part

    with limited_threads(3):
        assert by_threads(take, range(100)) == list(range(0, 200, 2))
    assert len(takers) == 3
    assert by_threads(take, []) == []


def _refuse(_task: object, _arguments: object) -> int:
    message = "can't start new thread"
    raise RuntimeError(message)


def _refuse_for_memory(_task: object, _arguments: object) -> int:
    raise MemoryError


def _never_begin(_task: object, _arguments: object) -> int:
    """Do as the system does where the new thread has no memory for its first step: it ends without a word."""
    return 0


@pytest.mark.parametrize("start", [_refuse, _refuse_for_memory, _never_begin])
def test_without_further_threads_the_calling_one_does_all(
    start: Callable[[object, object], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_thread, "start_new_thread", start)
    assert at_once([lambda number=number: number for number in range(4)]) == [0, 1, 2, 3]
    monkeypatch.setattr(photo_loop, "_RAYS_OF_A_THREAD", 10)
    block = two_cameras_with_sets()
    with limited_threads(4):
        found = digest_of(block)
    with limited_threads(1):
        assert digest_of(block) == found


@pytest.mark.parametrize("start", [_refuse_for_memory, _never_begin])
def test_a_thread_that_cannot_begin_is_an_error_and_not_waited_for(
    start: Callable[[object, object], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_thread, "start_new_thread", start)
    monkeypatch.setattr("orip.threads.BEGINS_WITHIN_S", 0.05)
    with pytest.raises(MemoryError, match="no thread for reading"):
        begin_thread(lambda: None, "reading")


def test_a_thread_that_begins_does_its_task_beside_the_calling_one() -> None:
    ends, doers = threading.Event(), []

    def task() -> None:
        doers.append(threading.get_ident())
        ends.set()

    begin_thread(task, "the task")
    assert ends.wait(20.0)
    assert doers != [threading.get_ident()]


@pytest.mark.skipif(not photo_loop.is_compiled(), reason="the extension was not built: no compiler here")
def test_a_thread_that_comes_late_repeats_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once as many threads as the turns are made for have left, they serve for another call."""
    block = two_cameras_with_sets()
    call = recorded(photo_loop.compiled, lambda: digest_of(block), monkeypatch)["residuals"]
    turns = photo_loop.compiled.turns(2.0)
    written = []
    for _ in range(4):
        residual, in_front = np.full_like(call[-2], np.nan), call[-1].copy()
        photo_loop.compiled.residuals(call[0], turns, *call[2:-2], residual, in_front)
        written.append(bool(np.isfinite(residual).all()))
    assert written == [True, False, True, False]


@pytest.mark.skipif(not photo_loop.is_compiled(), reason="the extension was not built: no compiler here")
@pytest.mark.parametrize("threads", [0.0, 257.0, 1.5, np.nan, -1.0])
def test_turns_of_no_sound_number_of_threads_are_refused(threads: float) -> None:
    with pytest.raises(ValueError, match=r"number|belong"):
        photo_loop.compiled.turns(threads)


_FAULTS = """
import resource, sys, tempfile
from pathlib import Path
import numpy as np
from orip.set_aside import columns_in_files
from orip.threads import limited_threads

def faults():
    # of arrays that are too small for large pages
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        sum(part[0] for part in [np.ones(1 << 17) for _ in range(20)])
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

with limited_threads(1):
    faults()
    kept = faults()
with columns_in_files(Path(tempfile.mkdtemp())), limited_threads(1):
    faults()
    print(kept, faults())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries keep what they like")
def test_freed_memory_is_kept_for_the_next_arrays_unless_columns_are_in_files():
    found = subprocess.run([sys.executable, "-c", _FAULTS], capture_output=True, text=True, check=True)
    kept, given_back = map(int, found.stdout.split())
    # twenty times twenty arrays of a megabyte have 256 pages each
    assert kept < 20 * 256
    assert given_back > 15 * 20 * 256
