"""Corrections of unknown cameras, and the camera parameters that they stand for."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.prelim.chain import preliminary_values
from orip.prelim.rays import image_rays
from orip.prelim.refinement import corrected, no_corrections, parameters_with
from orip.records.camera import Camera
from orip.structs import replace

UNKNOWN = ("C", "DX", "DY", "A3")


def with_camera(block, **changes):
    return replace(block, cameras=tuple(replace(camera, **changes) for camera in block.cameras))


@pytest.mark.parametrize("distortion_at", ["ideal", "measured"])
def test_parameters_give_the_corrected_vectors(distortion_at: str) -> None:
    made = synthetic_block("convergent", "camera corrections", noise_mm=0.0)
    c = made.block.cameras[0].parameters[0]
    given = (c, 0.1, -0.2, 0.0, 2e-5, *(0.0,) * 7)
    block = with_camera(made.block, parameters=given, distortion_at=distortion_at, unknown=UNKNOWN)
    rays = image_rays(block)
    for size in (1e-2, 1e-3):
        correction = size * np.array([1.0, -0.5, 0.7, 2.0])
        expected = corrected(rays, np.repeat(correction[None], len(rays.cameras.unknown), axis=0)).vectors
        found = image_rays(with_camera(block, parameters=parameters_with(block.cameras[0], correction))).vectors
        slopes = expected[:, :2] / expected[:, 2:], found[:, :2] / found[:, 2:]
        moved = np.abs(slopes[0] - rays.vectors[:, :2] / rays.vectors[:, 2:]).max()
        # the second order of corrections, and their product with the distortion that is given
        assert np.abs(slopes[0] - slopes[1]).max() < 8.0 * size * moved
        assert moved > 0.3 * size


def test_corrections_that_are_0_change_nothing() -> None:
    made = synthetic_block("convergent", "camera corrections", noise_mm=0.0)
    rays = image_rays(with_camera(made.block, unknown=UNKNOWN))
    zero = no_corrections(rays)
    assert zero.shape == (len({camera.name for camera in made.block.cameras}), 4)
    assert corrected(rays, zero) is rays


def test_what_is_known_stays() -> None:
    made = synthetic_block("convergent", "camera corrections", noise_mm=0.0)
    assert image_rays(with_camera(made.block, unknown=())).cameras.unknown.shape == (0, 4)
    assert image_rays(with_camera(made.block, unknown=("A1",))).cameras.unknown.shape == (0, 4)
    rays = image_rays(with_camera(made.block, unknown=("C", "A3")))
    known = replace(rays.cameras, of_photo=np.where(np.arange(len(rays.photos)) == 1, -1, rays.cameras.of_photo))
    moved = corrected(replace(rays, cameras=known), no_corrections(rays) + 0.01).vectors
    shift = (moved - rays.vectors)[:, :2]
    assert (shift[rays.photo == 1] == 0.0).all()
    assert (np.abs(shift[rays.photo == 0]).max(axis=1) > 0.0).all()


@pytest.mark.parametrize("off", [0.9, 1.06])
def test_a_camera_far_off_is_found(off: float) -> None:
    """Without noise the block itself tells its principal distance, though no photo fits with the given one."""
    made = synthetic_block("convergent", "camera corrections", noise_mm=0.0)
    block = made.block
    true = block.cameras[0].parameters
    wrong = with_camera(block, parameters=(off * true[0], *true[1:]), unknown=UNKNOWN)
    nothing = replace(wrong, photo_orientation=np.full_like(block.photo_orientation, np.nan))
    values = preliminary_values(nothing)
    assert [camera.name for camera in values.cameras] == [camera.name for camera in block.cameras]
    for start in values.cameras:
        assert start.parameters[0] == pytest.approx(true[0], rel=2e-3)
    assert all(photo.rotation is not None for photo in values.photos)


def test_camera_by_hand() -> None:
    camera = Camera("CAM", (100.0, 1.0, 2.0, *(0.0,) * 10))
    assert parameters_with(camera, np.array([np.log(0.8), 0.0, 0.0, 0.0]))[:3] == pytest.approx((80.0, 1.0, 2.0))
    # 0.5 mm at 45 degrees and its third power elsewhere: 0.5 mm / (100 mm)³
    assert parameters_with(camera, np.array([0.0, 0.01, 0.0, 0.005]))[1:5] == pytest.approx((0.0, 2.0, 0.0, -5e-7))
