"""Blocks that are divided among the workers of Dask, in the process of the tests."""

from __future__ import annotations

import asyncio
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bundle.blocking.divided_blocks import calibrated, largest_difference, with_blunders

from orip.archive.blocking.divided_problem import pose_divided
from orip.archive.cluster import dask_passes, sub_block_files, worker_watch
from orip.archive.cluster import dask_passes as node_groups
from orip.archive.cluster.connection import LostClusterError
from orip.archive.cluster.dask_passes import front_bytes, grouped
from orip.archive.cluster.divided_block import DividedBlocks
from orip.archive.cluster.sub_block_files import FOLDER, StoredSubBlock, marker_of, store_sub_blocks
from orip.bundle.compiled.photo_loop import is_compiled
from orip.bundle.methods import Method, adjust_block
from orip.bundle.problem import pose_problem
from orip.bundle.snooping.search import SnoopingSettings
from orip.bundle.solve import solve_block
from orip.bundle.starting_state import starting_state
from orip.errors import OripError
from orip.structs import replace

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(not is_compiled(), reason="sub-blocks need the compiled loop")

BLOCK = calibrated(50)
LARGEST_PART = 10


@pytest.fixture(scope="module")
def client():
    with distributed.Client(
        processes=False, n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as found:
        yield found


@pytest.fixture
def blocks(client, tmp_path: Path) -> DividedBlocks:
    return DividedBlocks(client, tmp_path, LARGEST_PART)


def test_the_workers_find_the_results_of_one_machine(blocks):
    whole = solve_block(BLOCK, lambda _: None, lambda: False)
    moved = []
    divided = solve_block(BLOCK, lambda _: moved.append(blocks.moved()), lambda: False, pose=blocks.pose)
    assert len(blocks.trees[0]) > 3
    assert len(divided.iterations) == len(whole.iterations)
    assert largest_difference(whole, divided) < 1e-9
    assert [iteration.there > 0 and iteration.back > 0 for iteration in moved] == [True] * len(moved)
    assert moved[0].separators == sum(4 * len(node.border) * (len(node.border) + 3) for node in blocks.trees[0].nodes)


@pytest.mark.long
def test_methods_that_ask_for_single_equations_find_the_same_by_workers(blocks):
    block, method = with_blunders(24), Method(SnoopingSettings(), variance_components=True)
    whole, divided = (
        adjust_block(block, method, lambda _: None, lambda: False, pose=pose)[0] for pose in (pose_problem, blocks.pose)
    )
    assert len(blocks.trees[0]) > 1
    assert len(whole.blunders) >= 10
    assert [(one.photo, one.point) for one in divided.blunders] == [(one.photo, one.point) for one in whole.blunders]
    factors = [[found.factor for found in solution.variance_components] for solution in (divided, whole)]
    # their condition is that of the cofactors, as far as these agree
    assert factors[0] == pytest.approx(factors[1], rel=1e-8, nan_ok=True)


def test_the_sub_blocks_are_written_once(blocks, tmp_path):
    for _ in range(2):
        pose_divided(BLOCK, blocks._spread, LARGEST_PART)
    folders = list((tmp_path / FOLDER).iterdir())
    assert len(folders) == 1
    assert len(list(folders[0].glob("*.npz"))) == len(blocks.trees[0])
    rays = BLOCK.photo_points
    pose_divided(replace(BLOCK, photo_points=replace(rays, xy=rays.xy + 1e-6)), blocks._spread, LARGEST_PART)
    (folder,) = (tmp_path / FOLDER).iterdir()
    assert folder != folders[0]
    assert marker_of(folder).exists()


def refused(blocks) -> str:
    problem = blocks.pose(BLOCK)
    with pytest.raises(OripError) as found:
        problem.linearise(starting_state(BLOCK))
    return str(found.value)


def test_a_worker_with_another_version_is_named(blocks, monkeypatch):
    def of_another(project, sub_blocks):
        return [replace(source, version="0.0") for source in store_sub_blocks(project, sub_blocks)]

    monkeypatch.setattr("orip.archive.cluster.divided_block.store_sub_blocks", of_another)
    assert "and this is 0.0; install the same version on both" in refused(blocks)


def test_a_worker_without_the_compiled_loop_is_named(blocks, monkeypatch):
    monkeypatch.setattr(sub_block_files, "is_compiled", lambda: False)
    assert refused(blocks).startswith("a worker lacks orip's compiled loop; install")


def test_a_worker_that_does_not_see_the_files_is_named(blocks, tmp_path):
    problem = blocks.pose(BLOCK)
    shutil.rmtree(tmp_path / FOLDER)
    with pytest.raises(OripError, match="which needs the same path on all machines"):
        problem.linearise(starting_state(BLOCK))


def test_a_damaged_file_is_named(blocks, tmp_path):
    problem = blocks.pose(BLOCK)
    for file in (tmp_path / FOLDER).rglob("*.npz"):
        file.write_bytes(b"PK\x03\x04 and nothing else")
    with pytest.raises(OripError, match=r"is damaged .*; repeat the command, which writes it again"):
        problem.linearise(starting_state(BLOCK))


def test_workers_that_are_too_small_are_told_before_anything_is_computed(blocks, monkeypatch):
    monkeypatch.setattr(node_groups, "_PROCESS_BYTES", 10**15)
    with pytest.raises(OripError, match=r"the workers are too small; each may use \d+ MB, and needs 10000\d+ MB"):
        blocks.pose(BLOCK)


def test_groups_are_subtrees_and_single_nodes_above_them():
    tree = pose_divided(BLOCK, largest=LARGEST_PART).streamed[0].tree
    everything = sum(map(front_bytes, tree.nodes))
    assert grouped(tree, everything) == (tuple(range(len(tree))),)
    groups = grouped(tree, everything // 2)
    assert [node for group in groups for node in group] == list(range(len(tree)))
    assert groups[-1] == (len(tree) - 1,)
    for group in groups:
        assert [tree.nodes[node].parent in group for node in group] == [True] * (len(group) - 1) + [False]
        assert len(group) == 1 or sum(front_bytes(tree.nodes[node]) for node in group) <= everything // 2
    assert max(map(len, groups)) > 1


def test_sources_are_small_enough_to_be_sent_with_every_task():
    assert len(repr(StoredSubBlock("/folder", 7, "0" * 64))) < 200


@contextmanager
def whose_worker_dies_before_results_are_fetched(folder: Path) -> Iterator[tuple[object, object, object]]:
    """Yield a cluster, passes over a tree, and results that are there; their only worker ends as they are fetched."""
    with (
        distributed.LocalCluster(
            processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
        ) as cluster,
        distributed.Client(cluster) as found,
    ):
        loop, _ = DividedBlocks(found, folder, LARGEST_PART).pose(BLOCK).streamed
        results = loop.passes.each(abs, [-node for node in range(len(loop.tree))])
        distributed.wait(results.futures)
        fetch = found._gather_remote

        async def fetch_too_late(*arguments: object) -> object:
            found._gather_remote = fetch
            cluster.scale(0)
            while cluster.scheduler.workers:
                await asyncio.sleep(0.01)
            return await fetch(*arguments)

        found._gather_remote = fetch_too_late
        yield cluster, loop.passes, results


def test_results_of_a_worker_that_died_are_computed_again(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_passes, "LOOK_SECONDS", 0.05)
    with whose_worker_dies_before_results_are_fetched(tmp_path) as (cluster, passes, results):
        started = threading.Timer(0.3, cluster.scale, [1])
        started.start()
        assert list(passes.gathered(results)) == list(range(len(passes.tree)))
        started.join()


@pytest.mark.timeout(60)
def test_results_that_no_worker_can_compute_again_are_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_passes, "LOOK_SECONDS", 0.05)
    monkeypatch.setattr(worker_watch, "_MOST_LONELY", 3)
    with (
        whose_worker_dies_before_results_are_fetched(tmp_path) as (_, passes, results),
        pytest.raises(LostClusterError, match="no worker is left; start workers again"),
    ):
        list(passes.gathered(results))


def test_what_tasks_are_computed_from_is_in_a_file_as_long_as_they_may_be_repeated(blocks, tmp_path):
    loop, _ = blocks.pose(BLOCK).streamed
    (folder,) = (tmp_path / FOLDER).iterdir()
    first = loop.passes.kept(list(range(len(loop.tree))))
    second = loop.passes.each(abs, first)
    del first
    assert list(loop.passes.gathered(second)) == list(range(len(loop.tree)))
    assert len(list((tmp_path / FOLDER).iterdir())) == 3
    del second
    assert list((tmp_path / FOLDER).iterdir()) == [folder]


def test_a_sub_block_whose_content_was_changed_is_written_again(blocks, tmp_path):
    """A folder is not taken by its name: the project may come from anybody."""
    found = after_an_iteration(blocks)
    file = sorted((tmp_path / FOLDER).rglob("*.npz"))[0]
    arrays = dict(np.load(file))
    arrays["xy"] = arrays["xy"] + 0.5
    np.savez(file, **arrays)
    sub_block_files._loops.clear()  # as of workers that have just started
    assert largest_difference(found, after_an_iteration(blocks)) < 1e-9


def after_an_iteration(blocks):
    return solve_block(BLOCK, lambda _: None, lambda: True, pose=blocks.pose)


def test_folders_that_a_link_leads_to_stay(blocks, tmp_path):
    mine = tmp_path / "home" / "0123456789abcdef0123456789abcdef"
    mine.mkdir(parents=True)
    (mine / "thesis.txt").write_text("mine\n")
    shutil.rmtree(tmp_path / FOLDER, ignore_errors=True)
    (tmp_path / FOLDER).symlink_to("home")
    with pytest.raises(OripError, match="is a link to home; put the folder itself in the place of the link"):
        blocks.pose(BLOCK)
    assert (mine / "thesis.txt").read_text() == "mine\n"


def test_only_folders_of_sub_blocks_are_removed(blocks, tmp_path):
    (tmp_path / FOLDER / "Documents").mkdir(parents=True)
    blocks.pose(BLOCK)
    assert (tmp_path / FOLDER / "Documents").is_dir()
