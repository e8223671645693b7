"""The aerial blocks adjusted by orip and by pycolmap (Ceres), alternately, from the same start, one thread each.

    python benchmarks/against_peers.py --peer /path/to/environment/bin/python 50 500

Control points are constants here, as COLMAP knows no weighted ones. CPU seconds, smallest of the repetitions. `--write`
makes the results the new baseline.json; without it they are compared with what stands there.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from aerial_blocks import FRAME_MM, NOISE_MM, aerial_block
from threadpoolctl import threadpool_limits

from orip.adjustment.iteration import adjust
from orip.adjustment.precision import cofactors
from orip.bundle.problem import pose_problem, starting_state
from orip.bundle.solve import iteration_settings
from orip.model.block import Block

PIXEL_MM = 2.0 * NOISE_MM
HERE = Path(__file__).parent
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
_SLOWER = 1.25
"""Times that differ by less say nothing on a machine that others use."""


def constant_control(photos: int) -> Block:
    """Return a benchmark block with its control points as constants."""
    block = aerial_block(photos)
    place = block.point_index()
    rows = [place[point.name] for point in block.control_points]
    start, constant = block.point_start.copy(), block.constant_points.copy()
    start[rows] = [point.coordinates for point in block.control_points]
    constant[rows] = True
    control = tuple(replace(point, errors=(0.0, 0.0, 0.0)) for point in block.control_points)
    return replace(block, point_start=start, constant_points=constant, control_points=control)


def save_for_peer(block: Block, path: Path) -> None:
    """Write the problem with pixels to the right and down."""
    state = starting_state(block)
    width, height = (round(each / PIXEL_MM) for each in FRAME_MM)
    turned = np.diag([1.0, -1.0, -1.0]) @ np.swapaxes(state.rotations, 1, 2)
    points = block.photo_points
    np.savez(
        path,
        size=[width, height],
        camera=[block.cameras[0].parameters[0] / PIXEL_MM, width / 2.0, height / 2.0, 0.0, 0.0],
        rotations=turned,
        translations=-np.einsum("nij,nj->ni", turned, state.centres),
        points=state.points,
        constant=np.flatnonzero(block.constant_points.all(axis=1)),
        photo=points.photo,
        point=points.point,
        pixels=points.xy / PIXEL_MM * [1.0, -1.0] + [width / 2.0, height / 2.0],
    )


def by_orip(photos: int) -> dict[str, float]:
    """Return CPU seconds, cost in pixels, iterations and peak memory of one adjustment."""
    block = constant_control(photos)
    before = time.process_time()
    problem, state, settings = pose_problem(block), starting_state(block), iteration_settings(block.definition)
    start = time.process_time()
    adjusted = adjust(problem, state, settings, lambda _: None, lambda: False)
    end = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    equations = adjusted.linearised.equations
    precise = time.process_time()
    cofactors(equations, adjusted.normals)
    done = time.process_time()
    cost = 0.5 * float(np.sum(equations.residual[equations.active] ** 2)) * (NOISE_MM / PIXEL_MM) ** 2
    return {
        "minimum": end - start,
        "setup": start - before,
        "precision": done - precise,
        "cost": cost,
        "iterations": len(adjusted.passes),
        "peak": peak,
        "peak_precision": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def run(*command: str) -> dict[str, float]:
    """Run a program that prints its results as JSON in its last line."""
    done = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, text=True, env={**os.environ, **ONE_THREAD}, cwd=HERE
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def compared(photos: int, peer: str, repetitions: int) -> dict[str, dict[str, float]]:
    """Return the smallest figures of both programs, run in turn."""
    runs: dict[str, list[dict[str, float]]] = {"orip": [], "pycolmap": []}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.npz"
        save_for_peer(constant_control(photos), path)
        for _ in range(repetitions):
            runs["orip"].append(run(sys.executable, __file__, "--only-orip", str(photos)))
            runs["pycolmap"].append(run(peer, str(HERE / "pycolmap_peer.py"), str(path)))
    return {name: {key: min(each[key] for each in found) for key in found[0]} for name, found in runs.items()}


def main() -> None:
    """Compare and print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", nargs="*", type=int, default=[50, 500])
    parser.add_argument("--peer", help="the Python that has pycolmap")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--only-orip", action="store_true", help="adjust once and print JSON")
    parser.add_argument("--write", action="store_true", help="make the results the new baseline")
    given = parser.parse_args()
    if given.only_orip:
        with threadpool_limits(1):
            print(json.dumps(by_orip(given.photos[0])))
        return
    baseline_path = HERE / "baseline.json"
    baseline = json.loads(baseline_path.read_text()) if baseline_path.exists() else {}
    print("| photos | program | iterations | minimum s | ratio | covariances s | ratio | peak MB | cost |")
    print("|---|---|---|---|---|---|---|---|---|")
    for photos in given.photos:
        found = compared(photos, given.peer, given.repetitions)
        for name, each in found.items():
            ratios = [each[key] / found["orip"][key] for key in ("minimum", "precision")]
            print(
                f"| {photos} | {name} | {each['iterations']} | {each['minimum']:.3f} | {ratios[0]:.1f} "
                f"| {each['precision']:.3f} | {ratios[1]:.1f} | {each['peak_precision']:.0f} | {each['cost']:.8g} |",
                flush=True,
            )
        for key in ("minimum", "precision"):
            before = baseline.get(str(photos), {}).get("orip", {}).get(key)
            if before is not None and found["orip"][key] > _SLOWER * before:
                print(f"slower than the baseline: {photos} photos, {key}: {before:.3f} s then", file=sys.stderr)
        if given.write:
            baseline[str(photos)] = found
    if given.write:
        baseline_path.write_text(json.dumps(baseline, indent=2, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
