"""Cases on which the compiled loops of preliminary values are compared with NumPy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from support.synthetic_block import synthetic_block

from orip.prelim.rays import ImageRays, image_rays, photo_index
from orip.prelim.relative.solution import Pairs
from orip.prelim.similarity.adjustment import CommonPoints

BLUNDERS = 12


def synthetic_rays() -> ImageRays:
    """Return rays none of which is wrong."""
    return image_rays(synthetic_block("convergent", "compiled loops", noise_mm=0.005).block)


def scene() -> tuple[ImageRays, np.ndarray, np.ndarray, np.ndarray]:
    """Return rays of which some are wrong, and rotations, centres and points that are nearly true."""
    made = synthetic_block("convergent", "compiled loops", noise_mm=0.005)
    rays = image_rays(made.block)
    random = np.random.default_rng(7)
    wrong = random.choice(len(rays.photo), BLUNDERS, replace=False)
    rays.vectors[wrong, :2] += random.normal(0.0, 0.5, (BLUNDERS, 2))
    rotations = Rotation.from_euler("XYZ", made.orientations[:, 3:]).as_matrix()
    return rays, rotations, made.orientations[:, :3].copy(), made.points


def common_pairs(rays: ImageRays, right: int) -> Pairs:
    """Return the points that the first photo shares with another one."""
    rows = photo_index(rays).common_points(0, right)
    return Pairs(rays.vectors[rows[0]], rays.vectors[rows[1]], np.sqrt(2.0) * rays.error[rows[0]])


def common_points(count: int) -> tuple[CommonPoints, np.ndarray]:
    """Return points in two systems, a sixth of them wrong and an eighth without Z, and the rotation between them."""
    random = np.random.default_rng(count)
    rotation = Rotation.random(random_state=count).as_matrix()
    source = random.normal(size=(count, 3))
    target = 2.0 * source @ rotation.T + 3.0 + random.normal(0.0, 1e-3, (count, 3))
    target[: count // 6] += 0.1
    target[count // 2 : count // 2 + count // 8, 2] = np.nan
    # errors that depend on the axis, and one far below all others
    errors = [np.abs(random.normal(1e-3, 2e-4, (count, 3))) for _ in range(2)]
    errors[0][0], errors[1][0, 0] = 0.0, 1e-9
    return CommonPoints(source, target, *errors, np.arange(count) == count - 1), rotation
