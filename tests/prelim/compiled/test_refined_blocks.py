"""What a refinement ends with fulfils the conditions of least squares: weights of the residuals, and no step left.

The partials are differences of residuals; nothing is taken from the program but the rays.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from compiled_cases import scene
from scipy.spatial.transform import Rotation

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS, danish_weights
from orip.prelim.rays import ALL_KNOWN, UnknownCameras
from orip.prelim.refinement import EXPECTED, refine
from orip.structs import replace


@pytest.mark.parametrize("cameras", [0, 1, 2])
@pytest.mark.parametrize("held", [False, True])
def test_it_ends_where_least_squares_has_no_step_left(held: bool, cameras: int) -> None:
    rays, rotations, centres, points = scene()
    # of two cameras one is unknown except for its principal point
    of_photo = np.arange(len(centres)) % 3 - 1 if cameras == 2 else np.zeros(len(centres), dtype=int)
    unknown = np.array([[True, True, True, True], [True, False, False, True]])[:cameras]
    rays = replace(rays, cameras=UnknownCameras(of_photo, unknown) if cameras else ALL_KNOWN)
    camera = of_photo[rays.photo] if cameras else np.full(len(rays.photo), -1)
    start = points + 0.001 * np.random.default_rng(3).normal(size=points.shape)
    free = np.flatnonzero(np.arange(len(points)) >= (5 if held else 0))
    found = refine(
        rays, rotations, centres, np.ones(len(centres), dtype=bool), start,
        held_points=~np.isin(np.arange(len(points)), free),
    )  # fmt: skip
    assert (found.coordinates[: free[0]] == start[: free[0]]).all()
    assert (found.corrections[~unknown] == 0.0).all()
    photos, size = len(centres), 6 * len(centres)

    def residuals(x: np.ndarray) -> np.ndarray:
        turns, shifts = x[:size].reshape(2, photos, 3)
        moved, corrections = found.coordinates.copy(), found.corrections.copy()
        moved[free] += x[size : size + 3 * len(free)].reshape(-1, 3)
        corrections[unknown] += x[size + 3 * len(free) :]
        scale, right, up, radial = np.vstack([corrections, np.zeros(4)])[camera].T
        turned = (Rotation.from_rotvec(turns).as_matrix() @ found.rotations)[rays.photo]
        seen = np.einsum("nji,nj->ni", turned, moved[rays.point] - (found.centres + shifts)[rays.photo])
        c = -rays.vectors[:, 2]
        image = -(c * np.exp(scale))[:, None] * seen[:, :2] / seen[:, 2:]
        xy = rays.vectors[:, :2]
        factor = 1.0 + radial * (xy**2).sum(axis=1) / c**2
        return (image - factor[:, None] * xy - c[:, None] * np.column_stack([right, up])) / rays.error[:, None]

    at = np.zeros(size + 3 * len(free) + np.count_nonzero(unknown))
    lengths = np.linalg.norm(residuals(at), axis=1)
    share = 1.0 - (size + 3 * len(free)) / (2 * len(lengths))
    assert found.s0 == pytest.approx(np.median(lengths) / math.sqrt(2.0 * math.log(2.0) * share), rel=1e-9)
    weights = danish_weights(lengths / max(found.s0, 1.0), LIMIT_OF_TWO_COMPONENTS)
    assert found.weight_factors == pytest.approx(weights, abs=1e-9)
    assert np.count_nonzero(weights < 0.5) > 5
    root = np.sqrt(weights)[:, None]
    steps = 1e-6 * np.eye(len(at))
    design = np.column_stack([(root * (residuals(step) - residuals(-step))).ravel() / 2e-6 for step in steps])
    observed = np.diag(1.0 / np.broadcast_to(EXPECTED, unknown.shape)[unknown])
    design = np.vstack([design, np.hstack([np.zeros((len(observed), size + 3 * len(free))), observed])])
    misclosures = np.concatenate([(root * residuals(at)).ravel(), observed @ found.corrections[unknown]])
    left, values, _ = np.linalg.svd(design, full_matrices=False)
    determined = left[:, values > 1e-7 * values[0]]
    # what one more step of Gauss and Newton would gain, in the units of the square sum: no unknown is off by much more
    # than its standard deviation
    assert np.sum((determined.T @ misclosures) ** 2) < 2.0 * max(found.s0, 1.0) ** 2
