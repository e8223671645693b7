"""A block of fisheye photos all around a room: from nothing to the truth, and standard deviations that are those."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.solving import OFF, noisy, solution
from support.synthetic_block import DISTORTED, SyntheticBlock, synthetic_block

from orip.bundle.results.covariance import predict_photo_coordinates
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.interior.image_coordinates import image_vectors
from orip.prelim.chain import preliminary_values
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.ground import PLAIN
from orip.structs import replace

UNKNOWN = ("C", "DX", "DY", "A3", "A5", "P1", "P2")


@pytest.fixture(scope="module")
def made() -> SyntheticBlock:
    return synthetic_block("room", "fisheye", precision_mm=0.003, distortion=DISTORTED, unknown=UNKNOWN, **OFF)


def started(block: Block) -> Block:
    """Return the block with its preliminary values."""
    found = preliminary_values(block)
    orientation = [np.concatenate([photo.centre, angles_from_rotation(photo.rotation)]) for photo in found.photos]
    place, start = block.point_index(), np.full_like(block.point_start, np.nan)
    start[[place[name] for name in found.points.names]] = found.points.coordinates
    return replace(block, photo_orientation=np.array(orientation), point_start=start)


@pytest.mark.parametrize("control", [22, 5])
def test_from_nothing_to_the_solution(made: SyntheticBlock, control: int) -> None:
    """Without orientations and coordinates, with C a per cent off and all other unknowns of the camera 0."""
    block = noisy(made, 1)
    given = dict(zip(CAMERA_PARAMETERS, block.cameras[0].parameters, strict=True))
    given |= dict.fromkeys(UNKNOWN, 0.0) | {"C": 1.01 * given["C"]}
    nothing = replace(
        block,
        cameras=(replace(block.cameras[0], parameters=tuple(given.values())),),
        photo_orientation=np.full_like(block.photo_orientation, np.nan),
        point_start=np.full_like(block.point_start, np.nan),
        control_points=block.control_points[:control],
    )
    found = solution(started(nothing))
    assert found.status == "converged"
    # redundancy is some 600: a standard deviation of 3 per cent
    assert found.sigma0 == pytest.approx(1.0, abs=0.12)
    free = np.isfinite(found.cameras.sd)
    assert (np.abs(found.cameras.values - made.cameras)[free] < 5.0 * found.cameras.sd[free]).all()
    assert (np.abs(found.points.values - made.points) < 6.0 * found.points.sd).all()


def test_many_points_are_beside_and_behind_the_camera(made: SyntheticBlock) -> None:
    points = made.block.photo_points
    vectors = image_vectors(made.block)
    behind = vectors[:, 2] > 0.0
    assert behind.sum() > 50
    orientation = made.orientations[points.photo]
    offset = made.points[points.point] - orientation[:, :3]
    u = np.einsum("ni,nij->nj", offset, rotation_from_angles(orientation[:, 3:]))
    unit = u / np.linalg.norm(u, axis=1, keepdims=True)
    # Newton's steps end below 1e-12 mm
    assert np.allclose(vectors / made.cameras[0, 0], unit, rtol=0.0, atol=1e-11)


def test_standard_deviations_are_those_of_simulated_errors(made: SyntheticBlock) -> None:
    runs = 40
    ratios = []
    for seed in range(runs):
        found = solution(noisy(made, seed))
        free = np.isfinite(found.cameras.sd)
        centres = (found.photos.values[:, :3] - made.orientations[:, :3]) / found.photos.sd[:, :3]
        points = (found.points.values - made.points) / found.points.sd
        cameras = ((found.cameras.values - made.cameras) / found.cameras.sd)[free]
        ratios.append(np.concatenate([cameras, [np.sqrt(np.mean(x**2)) for x in (centres, points)]]))
    scatter = np.sqrt(np.mean(np.square(ratios), axis=0))
    # each of seven parameters within 3.5 of its standard errors, 1 / sqrt(2 runs); means of many are far more exact
    assert np.abs(scatter[:7] - 1.0).max() < 3.5 / np.sqrt(2.0 * runs)
    assert scatter[7:] == pytest.approx(1.0, abs=0.1)


def test_predicted_places_are_those_that_were_measured(made: SyntheticBlock) -> None:
    found, points = solution(made.block), made.block.photo_points
    camera = made.block.cameras[0]
    for photo, name in enumerate(found.photos.names):
        rows = points.photo == photo
        xy = predict_photo_coordinates(found, name, camera, found.points.values[points.point[rows]], PLAIN)
        # without errors of measurement: what the last step of the adjustment leaves
        assert np.abs(xy - points.xy[rows]).max() < 1e-8
