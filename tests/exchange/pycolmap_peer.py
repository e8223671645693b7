"""COLMAP's own adjustment of a model, as JSON: run by a Python that has pycolmap.

    python pycolmap_peer.py MODEL [POINT ...]

Points are held at their places; without any, one photo and a coordinate of another one are.
"""

from __future__ import annotations

import json
import sys

import pycolmap


def main() -> None:
    """Adjust and print."""
    model = pycolmap.Reconstruction(sys.argv[1])
    counts = [model.num_reg_images(), model.num_points3D(), model.compute_num_observations()]
    stated = model.compute_mean_reprojection_error()
    model.update_point_3d_errors()
    found = {"counts": counts, "stated": stated, "mean": model.compute_mean_reprojection_error()}
    config = pycolmap.BundleAdjustmentConfig()
    for number in model.images:
        config.add_image(number)
    for number in sys.argv[2:]:
        config.add_constant_point(int(number))
    if not sys.argv[2:]:
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    solver = options.ceres.solver_options
    solver.function_tolerance, solver.gradient_tolerance = 1e-12, 0.0
    solver.max_num_iterations = 30
    options.ceres.solver_options = solver
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    summary = adjuster.solve()
    summary = getattr(summary, "ceres_summary", summary)
    wanted = pycolmap.BACovarianceOptions()
    wanted.params = pycolmap.BACovarianceOptionsParams.ALL
    covariance = pycolmap.estimate_ba_covariance(wanted, model, adjuster)
    cameras = [covariance.get_other_params_cov(camera.params).tolist() for camera in model.cameras.values()]
    photos = {}
    for number, image in model.images.items():
        pose, of_pose = image.cam_from_world(), covariance.get_cam_cov_from_world(number)
        if of_pose is not None and of_pose.shape == (6, 6):
            photos[image.name] = [pose.rotation.matrix().tolist(), list(pose.translation), of_pose.tolist()]
    costs = {"initial_cost": summary.initial_cost, "final_cost": summary.final_cost}
    sys.stdout.write(json.dumps({**found, **costs, "cameras": cameras, "photos": photos}))


if __name__ == "__main__":
    main()
