"""A problem of Bundle Adjustment in the Large (Agarwal et al. 2010): Ladybug, 49 photos with a camera each, no control.

Ten of its points lie behind all cameras that they were measured in, at the start and at the published minimum: their 31
rays have a residual by the formula of the collection, but no camera can see these points, and orip does not count them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bal import ALL_RAYS_COST, COST_TOLERANCE, MINIMUM_COST, RAYS_FROM_BEHIND, bal_block
from reference.published_data import data_set
from scipy.spatial.transform import Rotation
from support.long_cases import every

from orip.bundle.compiled import loop_pattern
from orip.bundle.problem import pose_problem
from orip.bundle.solve import solve_block
from orip.bundle.starting_state import starting_state


@pytest.fixture(scope="module")
def ladybug() -> Path:
    return data_set("bal") / "problem-49-7776-pre.txt"


def residuals_by_formula(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals (n, 2) at the start, straight from the file's numbers, and which rays come from behind."""
    photos, points, count, *numbers = map(float, path.read_text(encoding="ascii").split())
    photo, point, *measured = np.reshape(numbers[: 4 * int(count)], (-1, 4)).T
    of_cameras = np.reshape(numbers[4 * int(count) : 4 * int(count) + 9 * int(photos)], (-1, 9))
    camera = of_cameras[photo.astype(int)]
    ground = np.reshape(numbers[-3 * int(points) :], (-1, 3))[point.astype(int)]
    seen = Rotation.from_rotvec(camera[:, :3]).apply(ground) + camera[:, 3:6]
    p = -seen[:, :2] / seen[:, 2:]
    f, k1, k2 = camera[:, 6:].T[:, :, None]
    r2 = np.sum(p**2, axis=1, keepdims=True)
    return f * (1.0 + k1 * r2 + k2 * r2**2) * p - np.transpose(measured), seen[:, 2] > 0.0


def test_start_has_the_residuals_of_the_collections_formula(ladybug: Path) -> None:
    block = bal_block(ladybug)
    equations = pose_problem(block).linearise(starting_state(block))
    residual, behind = residuals_by_formula(ladybug)
    assert np.count_nonzero(behind) == RAYS_FROM_BEHIND
    np.testing.assert_array_equal(equations.active, np.repeat(~behind, 2))
    # pixels; residuals are up to hundreds of them
    np.testing.assert_allclose(equations.residual[equations.active], residual[~behind].ravel(), rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("cost_of_a_group", every(2, [3.0, 8.0]))
def test_minimum_is_reached(ladybug: Path, monkeypatch: pytest.MonkeyPatch, cost_of_a_group: float) -> None:
    # the order of sums decides where an adjustment leads in which points at infinity are held at their start
    monkeypatch.setattr(loop_pattern, "_OF_A_GROUP", cost_of_a_group)
    solved = solve_block(bal_block(ladybug), lambda _: None, lambda: False)
    equations = solved.equations
    assert np.count_nonzero(~equations.active) == 2 * RAYS_FROM_BEHIND
    cost = 0.5 * float(np.sum(equations.residual[equations.active] ** 2))
    assert cost == pytest.approx(MINIMUM_COST, rel=COST_TOLERANCE)
    assert cost < ALL_RAYS_COST
