"""Time, memory and bytes of blocks that Dask's workers adjust, and what a cost model predicts for larger ones.

    OPENBLAS_NUM_THREADS=1 python benchmarks/divided_blocks.py 500 2000 --workers 4 --memory 2000 --out measured.json
    python benchmarks/divided_blocks.py --model measured.json
    python benchmarks/divided_blocks.py --tree 100000

Blocks are those of `aerial_blocks` with a hundred points in each photo. The model and what it predicts is described in
docs/scaling.md.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from aerial_blocks import FLYING_HEIGHT, FRAME_MM, PRINCIPAL_DISTANCE_MM, aerial_block
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from orip.adjustment.factorisation.dissection import DissectionTree, dissected
from orip.archive.blocking.divided_problem import LARGEST_PART
from orip.archive.cluster.divided_block import ClusterRequest, divided_blocks
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock, iteration_settings, solve_problem
from orip.bundle.starting_state import starting_state

POINTS_A_PHOTO = 100
MEGABYTE = 1e6
PREDICTED = (100_000, 1_000_000)
WORKERS = (32, 1000)

RATE = 5e9
"""Multiplications a second of LAPACK on one core of the machine of the measurements."""

NETWORK = 1e9
"""Bytes a second into one machine (10 Gbit/s)."""


def measured(photos: int, points: int, workers: int, memory_mb: int) -> dict[str, float]:
    """Return the figures of one block."""
    block = aerial_block(photos, points)
    clock: list[float] = []
    moved = []
    with (
        tempfile.TemporaryDirectory() as folder,
        divided_blocks(ClusterRequest(None, workers, int(memory_mb * MEGABYTE)), Path(folder)) as blocks,
    ):
        posed = time.perf_counter()
        problem = blocks.pose(block)
        posing = time.perf_counter() - posed
        settings = iteration_settings(block.definition)
        workers_cpu, own_cpu, addresses = [], [], set()
        began = time.perf_counter()

        def passed(_: object) -> None:
            clock.append(time.perf_counter() - began)
            moved.append(blocks.moved())
            workers_cpu.append(_cpu(blocks.client))
            own_cpu.append(time.process_time())
            peaks = blocks.client.run(_peak)
            print(
                f"{clock[-1]:.0f} s, {workers_cpu[-1]:.0f} + {own_cpu[-1]:.0f} CPU s, MB of workers "
                f"{' '.join(f'{peak:.0f}' for peak in peaks.values())}, of the client {_peak():.0f}, {moved[-1]}",
                file=sys.stderr, flush=True,
            )  # fmt: skip
            addresses.update(peaks)

        solved = solve_problem(problem, starting_state(block), settings, passed, lambda: False)
        total = time.perf_counter() - began
        workers_cpu.append(_cpu(blocks.client))
        own_cpu.append(time.process_time())
        in_names = solution_of(solved)
        results = time.process_time() - own_cpu[-1]
        peaks = blocks.client.run(_peak)
        addresses.update(peaks)
        tree = blocks.trees[-1]
    # the first iteration loads programs and files; after the last one come cofactors
    iterations = len(clock)
    rounds = iterations - 1
    most = max(moved, key=lambda one: one.total)
    return {
        "photos": photos, "rays": len(block.photo_points.photo), "workers": workers, "nodes": len(tree),
        "iterations": iterations, "posing": posing, "iteration": (clock[-1] - clock[0]) / rounds,
        "total": total, "results_client": results, "photos_with_sd": int(np.isfinite(in_names.photos.sd).all(1).sum()),
        "died": len(addresses) - len(peaks),
        "cpu_workers": (workers_cpu[-2] - workers_cpu[0]) / rounds, "cpu_client": (own_cpu[-2] - own_cpu[0]) / rounds,
        "cofactors_workers": workers_cpu[-1] - workers_cpu[-2], "cofactors_client": own_cpu[-1] - own_cpu[-2],
        "there": most.there, "back": most.back,
        "between": most.between, "separators": most.separators, "flops": flops(tree), "root": root(tree),
        "peak_worker": max(peaks.values()), "peak_client": _peak(), "sigma0": _sigma0(solved),
    }  # fmt: skip


def _sigma0(solved: SolvedBlock) -> float:
    return solved.variance.sigma0


def _cpu(client) -> float:
    return sum(client.run(time.process_time).values())


def _peak() -> float:
    """Return the largest MB of this process; its resource usage would count that of the process that started it."""
    words = Path("/proc/self/status").read_text().split()
    return float(words[words.index("VmHWM:") + 1]) * 1024.0 / MEGABYTE


def flops(tree: DissectionTree) -> float:
    """Return the multiplications of factorisation and selected inverse of all fronts."""
    return float(sum(_front(len(node.own), len(node.border)) for node in tree.nodes))


def _front(own: int, border: int) -> float:
    return own**3 / 3 + own**2 * border + own * border**2


def root(tree: DissectionTree) -> int:
    """Return the number of unknowns of the root."""
    return len(tree.nodes[-1].own)


def longest(tree: DissectionTree) -> float:
    """Return the multiplications on the longest way from a leaf to the root: no number of workers divides these."""
    ways = np.zeros(len(tree))
    for number, node in enumerate(tree.nodes):
        ways[number] += _front(len(node.own), len(node.border))
        if node.parent >= 0:
            ways[node.parent] = max(ways[node.parent], ways[number])
    # the children's maximum was there before a node's own was added
    return float(ways[-1])


def tree_of(photos: int) -> dict[str, float]:
    """Return the figures of the tree of a block, from where its photos are: nothing is measured or adjusted."""
    base, distance = (np.array(FRAME_MM) * [0.4, 0.7] * FLYING_HEIGHT / PRINCIPAL_DISTANCE_MM).tolist()
    along = max(2, round(np.sqrt(photos * distance / base)))
    number = np.arange(photos)
    centres = np.column_stack([base * (number % along), distance * (number // along), np.full(photos, FLYING_HEIGHT)])
    reach = 0.5 * np.array(FRAME_MM) * FLYING_HEIGHT / PRINCIPAL_DISTANCE_MM
    # points at the corners of what the photos share, seen by all photos that reach them
    points = np.vstack([centres[:, :2] + reach * side for side in ([-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5])])
    near = cKDTree(centres[:, :2] / reach).query_ball_point(points / reach, 1.0, p=np.inf)
    counts = np.array([len(shown) for shown in near])
    pattern = csr_array(
        (np.ones(counts.sum()), np.concatenate(near), np.append(0, np.cumsum(counts))), shape=(len(points), photos)
    )
    groups = np.repeat(np.arange(photos), 6)
    tree = dissected(groups, pattern, np.zeros(photos, dtype=bool), centres, LARGEST_PART)
    return {
        "photos": photos, "nodes": len(tree), "separators": tree.border_bytes, "flops": flops(tree),
        "longest": longest(tree), "root": root(tree),
    }  # fmt: skip


def model(found: list[dict[str, float]]) -> None:
    """Fit the cost of an iteration to what was measured, and print what it predicts for larger blocks.

    Workers: seconds a ray and multiplications at `RATE`, which the workers share, and what is above their parts, which
    they do not. Client: seconds a ray. Bytes: those of a ray, and those of the separators.
    """
    rays = np.array([one["rays"] for one in found])
    ones = np.ones(len(found))
    of_workers = np.array([one["cpu_workers"] - one["flops"] / RATE for one in found])
    of_client = np.array([one["cpu_client"] for one in found])
    (a, a0), (c, c0) = (_fitted(np.column_stack([rays, ones]), of) for of in (of_workers, of_client))
    (s,) = _fitted(rays[:, None], np.array([one["there"] + one["back"] for one in found]))
    # neighbouring nodes of small blocks are with the same worker: the largest one counts
    e = max(found, key=lambda one: one["photos"])["between"] / max(found, key=lambda one: one["photos"])["separators"]
    print(f"workers {1e6 * a:.1f} us a ray + {a0:.2f} s; client {1e6 * c:.1f} us a ray + {c0:.2f} s")
    print(f"bytes {s:.0f} a ray to and from the client, {e:.2f} times the separators between workers")
    tree, known = tree_of(PREDICTED[0]), tree_of(int(found[-1]["photos"]))
    # points of real blocks are seen from farther than those that trees are made from here
    tree = {name: value * found[-1][name] / known[name] for name, value in tree.items() if name in found[-1]} | {
        "longest": tree["longest"] * found[-1]["flops"] / known["flops"]
    }
    for photos in PREDICTED:
        # of a square block the multiplications grow with N^1.5, the separators with N
        larger, n = photos / PREDICTED[0], photos * found[-1]["rays"] / found[-1]["photos"]
        work, way, borders = tree["flops"] * larger**1.5, tree["longest"] * larger**1.5, tree["separators"] * larger
        for workers in WORKERS:
            divided = (a * n + work / RATE) / workers
            figures = {
                "workers": divided, "longest way": way / RATE, "client": c * n, "client's network": s * n / NETWORK,
                "between": e * borders / NETWORK / workers,
            }  # fmt: skip
            print(photos, workers, {name: round(float(value), 1) for name, value in figures.items()})


def _fitted(columns: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return the coefficients (k,) of columns (n, k) that leave the least relative differences."""
    return np.linalg.lstsq(columns / measured[:, None], np.ones(len(measured)), rcond=None)[0]


def main() -> None:
    """Measure, or show what the trees of larger blocks are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", nargs="*", type=int)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--memory", type=int, default=2000, help="MB of each worker")
    parser.add_argument("--points", type=int, default=POINTS_A_PHOTO, help="in a photo")
    parser.add_argument("--tree", type=int, nargs="*", default=[])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--model", type=Path)
    words = parser.parse_args()
    found = []
    for photos in words.photos:
        found.append(measured(photos, words.points, words.workers, words.memory))
        print(json.dumps(found[-1]), flush=True)
        if words.out:
            words.out.write_text(json.dumps(found, indent=1))
    if words.model:
        model(json.loads(words.model.read_text()))
    for photos in words.tree:
        print(json.dumps(tree_of(photos)), flush=True)


if __name__ == "__main__":
    main()
