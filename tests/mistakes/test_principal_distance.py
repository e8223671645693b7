"""The principal distance from points with given coordinates, against the camera that the photos were made with."""

from __future__ import annotations

import pytest
from bundle.solving import controlled
from support.synthetic_block import synthetic_block

from orip.mistakes.camera_values import principal_distance_seen
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
