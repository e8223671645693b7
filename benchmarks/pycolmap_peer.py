"""A problem of `against_peers.py` adjusted by pycolmap (Ceres); run by it in an environment of its own.

    python pycolmap_peer.py problem.npz
    python pycolmap_peer.py problem.npz --until 13308.406
    python pycolmap_peer.py problem.npz --write model --iterations 3
    python pycolmap_peer.py problem.npz --model model

Prints one line of JSON: CPU seconds to the minimum and of the covariances, cost in pixels, iterations, peak memory.
`--until` looks for the least number of iterations to a cost and prints it, and nothing else; `--iterations` ends there.
`--write` writes what is found into a folder, as a binary model; `--model` starts from it.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path

import numpy as np
import pycolmap

SOLVERS = ("DENSE_SCHUR", "SPARSE_SCHUR")
_DENSE_PHOTOS = 50
"""COLMAP's own limit for the dense solver."""
_MOST_ITERATIONS = 50


def reconstruction(problem: dict[str, np.ndarray]) -> pycolmap.Reconstruction:
    """Return the problem as COLMAP has it: pixels to the right and down, the camera looks along +z."""
    made = pycolmap.Reconstruction()
    width, height = map(int, problem["size"])
    for row, parameters in enumerate(problem["cameras"]):
        camera = pycolmap.Camera(model="RADIAL", width=width, height=height, params=parameters, camera_id=row + 1)
        made.add_camera_with_trivial_rig(camera)
    photo, point, pixels = problem["photo"], problem["point"], problem["pixels"]
    order = np.argsort(photo, kind="stable")
    ends = np.searchsorted(photo[order], np.arange(len(problem["rotations"]) + 1))
    number = np.empty(len(photo), dtype=np.int64)
    for row, (rotation, translation) in enumerate(zip(problem["rotations"], problem["translations"], strict=True)):
        mine = order[ends[row] : ends[row + 1]]
        number[mine] = np.arange(len(mine))
        camera_id = int(problem["camera"][row]) + 1
        image = pycolmap.Image(name=str(row), camera_id=camera_id, image_id=row + 1, keypoints=pixels[mine])
        made.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), translation))
    by_point = np.argsort(point, kind="stable")
    ends = np.searchsorted(point[by_point], np.arange(len(problem["points"]) + 1))
    for row, xyz in enumerate(problem["points"]):
        mine = by_point[ends[row] : ends[row + 1]]
        track = pycolmap.Track()
        for seen in mine:
            track.add_element(int(photo[seen]) + 1, int(number[seen]))
        made.add_point3D_with_id(row + 1, pycolmap.Point3D(xyz=xyz, track=track))
        for seen in mine:
            made.image(int(photo[seen]) + 1).set_point3D_for_point2D(int(number[seen]), row + 1)
    return made


def settings(problem: dict[str, np.ndarray]) -> tuple[pycolmap.BundleAdjustmentConfig, str]:
    """Return what is adjusted and what is constant, and the solver that is COLMAP's choice."""
    config = pycolmap.BundleAdjustmentConfig()
    for row in range(len(problem["rotations"])):
        config.add_image(row + 1)
    for row in problem["constant"]:
        config.add_constant_point(int(row) + 1)
    if problem["free"]:
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    return config, SOLVERS[len(problem["rotations"]) > _DENSE_PHOTOS]


def adjusted(
    problem: dict[str, np.ndarray],
    iterations: int | None,
    covariances: bool,
    solver_type: str | None = None,
    model: Path | None = None,
    write: Path | None = None,
) -> dict[str, float | str]:
    """Return the figures of one adjustment; with a number of iterations it ends by nothing else."""
    made = reconstruction(problem) if model is None else pycolmap.Reconstruction(model)
    config, usual = settings(problem)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = bool(problem["principal_point_unknown"])
    options.print_summary = False
    options.ceres.auto_select_solver_type = False
    solver = options.ceres.solver_options
    types = type(solver.linear_solver_type)
    solver.linear_solver_type = getattr(types, solver_type or usual)
    solver.num_threads = 1
    solver.max_num_iterations = iterations or _MOST_ITERATIONS
    solver.function_tolerance = 0.0 if iterations else 1e-8
    solver.gradient_tolerance = 0.0
    options.ceres.solver_options = solver
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, made)
    start = time.process_time()
    summary = adjuster.solve()
    end = time.process_time()
    if write is not None:
        made.write_binary(write)
    ceres = getattr(summary, "ceres_summary", summary)
    found: dict[str, float | str] = {
        "minimum": end - start,
        "start_cost": float(ceres.initial_cost),
        "cost": float(ceres.final_cost),
        # the first of Ceres' steps is the start itself
        "iterations": int(ceres.num_successful_steps + ceres.num_unsuccessful_steps) - 1,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "version": pycolmap.__version__,
    }
    if covariances:
        wanted = pycolmap.BACovarianceOptions()
        wanted.params = pycolmap.BACovarianceOptionsParams.ALL
        start = time.process_time()
        estimated = pycolmap.estimate_ba_covariance(wanted, made, adjuster)
        found["precision"] = time.process_time() - start if estimated is not None else float("nan")
        found["peak_precision"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return found


def iterations_until(problem: dict[str, np.ndarray], cost: float) -> int:
    """Return the least number of iterations after which the cost is reached.

    Raises
    ------
    SystemExit
        When 800 do not reach it.
    """
    above, reached = 0, 25
    while float(adjusted(problem, reached, covariances=False)["cost"]) > cost:
        above, reached = reached, 2 * reached
        if reached > 800:
            message = f"pycolmap does not reach a cost of {cost}"
            raise SystemExit(message)
    while reached - above > 1:
        middle = (above + reached) // 2
        if float(adjusted(problem, middle, covariances=False)["cost"]) > cost:
            above = middle
        else:
            reached = middle
    return reached


def main() -> None:
    """Adjust and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problem")
    parser.add_argument("--iterations", type=int, help="end after so many")
    parser.add_argument("--solver", choices=SOLVERS, help="not the one that COLMAP would take")
    parser.add_argument("--until", type=float, help="a cost")
    parser.add_argument("--model", type=Path, help="a folder with a model, from which the adjustment starts")
    parser.add_argument("--write", type=Path, help="an empty folder")
    given = parser.parse_args()
    problem = dict(np.load(given.problem))
    if given.until is not None:
        print(json.dumps({"iterations": iterations_until(problem, given.until)}))
        return
    # pycolmap finds no covariances where points are at infinity
    wanted = given.iterations is None and given.model is None
    found = adjusted(problem, given.iterations, wanted, given.solver, given.model, given.write)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
