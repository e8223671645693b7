"""The principal distance and point, and the scales of the axes, against the camera that the photos were made with."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.solving import controlled
from support.synthetic_block import synthetic_block

from orip.mistakes.camera_values import OTHER_LENS, OTHER_POINT, UNEQUAL_AXES, principal_distance_seen
from orip.records.block import Block
from orip.solving.solve import solve
from orip.structs import replace

MADE = synthetic_block("convergent", "principal distance")
TRUE = MADE.block.cameras[0].parameters[0]


def with_c(block, c: float):
    camera = block.cameras[0]
    return replace(block, cameras=(replace(camera, parameters=(c, *camera.parameters[1:])),))


@pytest.mark.parametrize("factor", [0.2, 1.0, 3.0])
def test_it_is_that_of_the_photos_whatever_the_record_has(factor: float):
    block = controlled(MADE, MADE.block, MADE.block.point_names[:8])
    block = replace(with_c(block, factor * TRUE), photo_orientation=MADE.orientations)
    # photo coordinates have no errors here
    assert principal_distance_seen(block, 0) == pytest.approx(TRUE, rel=1e-6)


def test_without_control_it_is_that_of_the_record():
    block = replace(with_c(MADE.block, 7.0), control_points=(), photo_orientation=MADE.orientations)
    assert principal_distance_seen(block, 0) == 7.0


def test_the_principal_distance_that_a_fisheye_shows() -> None:
    made = synthetic_block("room", "principal distance", control="constant")
    true = made.block.cameras[0].parameters
    block = replace(made.block, cameras=(replace(made.block.cameras[0], parameters=(7.0, *true[1:])),))
    # orientations are true; without distortion and noise it is exact
    assert principal_distance_seen(block, 0) == pytest.approx(true[0], rel=1e-9)


def noisy(seed: int) -> Block:
    """Return a block of convergent photos with its control, right but for noise."""
    made = synthetic_block("convergent", f"held camera {seed}", noise_mm=0.002, precision_mm=0.002, control_error=0.002)
    return replace(made.block, photo_orientation=made.orientations, point_start=made.points)


def said_of_camera(block: Block) -> tuple[str, list[str]]:
    """Return the status, and the codes of what is said of the camera."""
    solution, _ = solve(block)
    return solution.status, [code for code, where, _ in solution.warnings if where.startswith("camera ")]


@pytest.mark.parametrize("seed", range(2))
def test_a_held_camera_that_is_wrong_is_named_and_its_block_doubtful(seed: int) -> None:
    block = noisy(seed)
    camera, points = block.cameras[0], block.photo_points
    c, x, y = camera.parameters[:3]
    moved = replace(camera, parameters=(c, x + 0.02 * c, y - 0.02 * c, *camera.parameters[3:]))
    stretched = replace(block, photo_points=replace(points, xy=points.xy * np.array([1.0, 0.99])))
    assert said_of_camera(block) == ("converged", [])
    assert said_of_camera(with_c(block, 1.05 * c)) == ("doubtful", [OTHER_LENS])
    assert said_of_camera(replace(block, cameras=(moved,))) == ("doubtful", [OTHER_POINT])
    assert said_of_camera(stretched) == ("doubtful", [UNEQUAL_AXES])
