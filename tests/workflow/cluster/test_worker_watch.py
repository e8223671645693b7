"""Workers that die, stand still or are not there, as the scheduler describes them."""

from __future__ import annotations

import pytest

from orip.archive.cluster import worker_watch
from orip.archive.cluster.connection import LostClusterError
from orip.archive.cluster.worker_watch import WorkerWatch

NEEDED = 700_000_000
LOOKS = 1000


def worker(status="running", *, executing=1, limit=500_000_000):
    return {"status": status, "memory_limit": limit, "metrics": {"task_counts": {"executing": executing}}}


def given_up(described) -> str:
    """Return what is said of workers that are described look by look."""
    watch = WorkerWatch(NEEDED)

    def wait() -> None:
        for look in range(LOOKS):
            watch.look(described(look))

    with pytest.raises(LostClusterError) as found:
        wait()
    return str(found.value)


def test_workers_that_compute_are_waited_for():
    watch = WorkerWatch(NEEDED)
    for _ in range(LOOKS):
        watch.look({"one": worker(), "other": worker("paused", executing=0)})


def test_workers_that_die_again_and_again_are_told_with_their_memory():
    text = given_up(lambda look: {f"worker {look}": worker(), "steady": worker()} if look != 5 else {})
    assert text == (
        "workers died again and again, 6 of them in one pass over the block; each may use 500 MB, and needs 700 MB at "
        "the least for this block, however many there are: give each more (--worker-memory, or --memory-limit of 'dask "
        "worker')"
    )


def test_more_workers_are_advised_where_each_has_room_for_the_largest_part():
    text = given_up(lambda _: {"one": worker("paused", executing=0, limit=2 * NEEDED)})
    assert text.endswith(
        "(--worker-memory, or --memory-limit of 'dask worker'), or take more workers on further machines"
    )


def test_a_few_deaths_are_mended_by_dask():
    watch = WorkerWatch(NEEDED)
    for look in range(LOOKS):
        watch.look({f"worker {min(look, 4)}": worker(), "steady": worker()})


def test_workers_with_full_memory_are_told():
    text = given_up(lambda _: {"one": worker("paused", executing=0), "other": worker("paused", executing=0)})
    assert text.startswith("all workers have stopped, for their memory is full; each may use 500 MB, and needs 700 MB")


def test_workers_that_do_nothing_are_told():
    text = given_up(lambda _: {"one": worker(executing=0, limit=0)})
    assert text.startswith("no worker has computed anything for 10 minutes; each needs 700 MB at the least")


def test_workers_that_pass_on_results_are_waited_for():
    watch = WorkerWatch(NEEDED)
    busy = worker(executing=0)
    busy["metrics"]["transfer"] = {"outgoing_count": 1}
    for _ in range(LOOKS):
        watch.look({"one": busy})


def test_a_cluster_without_workers_is_told_when_none_comes_back():
    assert given_up(lambda _: {}).startswith("no worker is left; start workers again")
    watch = WorkerWatch(NEEDED)
    for look in range(LOOKS):
        watch.look({} if look % worker_watch._MOST_LONELY else {"one": worker()})
