"""A problem of `against_peers.py` adjusted by pycolmap (Ceres); run by it in an environment of its own.

    python pycolmap_peer.py problem.npz

Prints one line of JSON: CPU seconds to the minimum and of the covariances, cost in pixels, iterations, peak memory.
"""

from __future__ import annotations

import json
import resource
import sys
import time

import numpy as np
import pycolmap

_DENSE_PHOTOS = 50
"""COLMAP's own limit for the dense solver."""


def reconstruction(problem: dict[str, np.ndarray]) -> pycolmap.Reconstruction:
    """Return the problem as COLMAP has it: pixels to the right and down, the camera looks along +z."""
    made = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model="RADIAL", width=int(problem["size"][0]), height=int(problem["size"][1]), params=problem["camera"],
        camera_id=1,
    )  # fmt: skip
    made.add_camera_with_trivial_rig(camera)
    photo, point, pixels = problem["photo"], problem["point"], problem["pixels"]
    order = np.argsort(photo, kind="stable")
    ends = np.searchsorted(photo[order], np.arange(len(problem["rotations"]) + 1))
    number = np.empty(len(photo), dtype=np.int64)
    for row, (rotation, translation) in enumerate(zip(problem["rotations"], problem["translations"], strict=True)):
        mine = order[ends[row] : ends[row + 1]]
        number[mine] = np.arange(len(mine))
        image = pycolmap.Image(name=str(row), camera_id=1, image_id=row + 1, keypoints=pixels[mine])
        made.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), translation))
    by_point = np.argsort(point, kind="stable")
    ends = np.searchsorted(point[by_point], np.arange(len(problem["points"]) + 1))
    for row, xyz in enumerate(problem["points"]):
        mine = by_point[ends[row] : ends[row + 1]]
        track = pycolmap.Track()
        for each in mine:
            track.add_element(int(photo[each]) + 1, int(number[each]))
        made.add_point3D_with_id(row + 1, pycolmap.Point3D(xyz=xyz, track=track))
        for each in mine:
            made.image(int(photo[each]) + 1).set_point3D_for_point2D(int(number[each]), row + 1)
    return made


def main() -> None:
    """Adjust and print."""
    problem = dict(np.load(sys.argv[1]))
    made = reconstruction(problem)
    config = pycolmap.BundleAdjustmentConfig()
    for row in range(len(problem["rotations"])):
        config.add_image(row + 1)
    for row in problem["constant"]:
        config.add_constant_point(int(row) + 1)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.print_summary = False
    options.ceres.auto_select_solver_type = False
    solver = options.ceres.solver_options
    few = len(problem["rotations"]) <= _DENSE_PHOTOS
    types = type(solver.linear_solver_type)
    solver.linear_solver_type = types.DENSE_SCHUR if few else types.SPARSE_SCHUR
    solver.num_threads = 1
    solver.max_num_iterations = 50
    solver.function_tolerance = 1e-8
    solver.gradient_tolerance = 0.0
    options.ceres.solver_options = solver
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, made)
    start = time.process_time()
    summary = adjuster.solve()
    end = time.process_time()
    found = {"minimum": end - start, "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0}
    ceres = getattr(summary, "ceres_summary", summary)
    found["cost"] = float(ceres.final_cost)
    found["iterations"] = int(ceres.num_successful_steps + ceres.num_unsuccessful_steps)
    covariance = pycolmap.BACovarianceOptions()
    covariance.params = pycolmap.BACovarianceOptionsParams.ALL
    start = time.process_time()
    estimated = pycolmap.estimate_ba_covariance(covariance, made, adjuster)
    found["precision"] = time.process_time() - start if estimated is not None else float("nan")
    found["peak_precision"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    found["version"] = pycolmap.__version__
    print(json.dumps(found))


if __name__ == "__main__":
    main()
