"""Imported blocks are moved to their control where they are elsewhere, and heights of two origins are recognised."""

from __future__ import annotations

import numpy as np
import pytest

from orip.exchange.conversion.control_datum import ControlRays, ObservedCentres, control_datum
from orip.geometry.rotation import rotation_from_angles
from orip.geometry.similarity import Similarity

TRUE = Similarity(1.6, rotation_from_angles(np.array([[0.05, -0.1, 0.3]]))[0], np.array([120.0, -40.0, -30.0]))
POINTS = np.array([[0.0, 0.0, 0.0], [40.0, 5.0, 3.0], [10.0, 35.0, -4.0], [55.0, 45.0, 1.0]])
CENTRES = np.array([[0.0, 5.0, 60.0], [20.0, 0.0, 62.0], [45.0, 10.0, 59.0], [15.0, 40.0, 61.0], [50.0, 42.0, 64.0]])
NO_CENTRES = np.zeros((0, 3))


def rays_to(points: np.ndarray, control: np.ndarray) -> ControlRays:
    """Return the rays from all centres to points in the block that have control coordinates."""
    photo, point = (a.ravel() for a in np.meshgrid(np.arange(len(CENTRES)), np.arange(len(points)), indexing="ij"))
    vectors = points[point] - CENTRES[photo]
    directions = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return ControlRays(CENTRES[photo], directions, point, control[point])


def observed(positions: np.ndarray, error: float = 2.0) -> ObservedCentres:
    return ObservedCentres(CENTRES[: len(positions)], positions, np.full_like(positions, error))


def test_a_block_at_its_control_stays() -> None:
    assert control_datum(rays_to(POINTS, POINTS), observed(CENTRES), 60.0) is None
    # within the errors of the positions
    assert control_datum(rays_to(POINTS, POINTS), observed(CENTRES + np.array([3.0, -2.0, 4.0])), 60.0) is None


@pytest.mark.parametrize("has_positions", [True, False])
@pytest.mark.parametrize("turn", [0.3, 2.5])
def test_a_block_elsewhere_is_moved(has_positions: bool, turn: float) -> None:
    true = Similarity(TRUE.scale, rotation_from_angles(np.array([[0.05, turn, 0.3]]))[0], TRUE.shift)
    positions = observed(true.apply(CENTRES) if has_positions else NO_CENTRES)
    found = control_datum(rays_to(POINTS, true.apply(POINTS)), positions, 60.0)
    assert found is not None
    assert found.height_step == 0.0
    assert found.similarity.scale == pytest.approx(true.scale, rel=1e-6)
    assert found.similarity.rotation == pytest.approx(true.rotation, abs=1e-6)
    assert found.similarity.apply(CENTRES) == pytest.approx(true.apply(CENTRES), abs=1e-4)
    assert found.misfit_before > 0.1
    assert found.misfit_after < 1e-6
    moved = np.linalg.norm(true.apply(CENTRES) - CENTRES, axis=1)
    assert found.moved == pytest.approx(np.median(moved), rel=1e-3)


@pytest.mark.parametrize("step", [45.0, -28.0])
def test_positions_with_heights_of_another_origin_are_recognised(step: float) -> None:
    """A block in the system of its positions: the control lies that much below or above."""
    control = POINTS - np.array([0.0, 0.0, step])
    noise = np.random.default_rng(5).normal(0.0, 0.05, CENTRES.shape)
    found = control_datum(rays_to(POINTS, control), observed(CENTRES + noise, 0.05), 60.0)
    assert found is not None
    # the mean of five positions is good to 0.02, the block counts as good to a thousandth of 60
    assert found.height_step == pytest.approx(step, abs=0.2)
    assert 0.01 < found.height_step_sd < 0.2
    assert found.similarity.shift[2] == pytest.approx(-step, abs=0.2)
    assert found.turned < 0.005


def test_one_point_and_positions_without_a_step_are_no_proof() -> None:
    """Seven unknowns and a step: two rays and two positions leave nothing to check them."""
    rays = rays_to(POINTS[:1], POINTS[:1] + 30.0)
    few = ControlRays(*(part[:2] for part in rays))
    assert control_datum(few, observed(CENTRES[:2]), 60.0) is None


def test_control_that_fits_in_no_way_moves_nothing() -> None:
    exchanged = POINTS[[2, 0, 3, 1]] + np.array([0.0, 0.0, 20.0])
    assert control_datum(rays_to(POINTS, exchanged), observed(CENTRES), 60.0) is None
