"""Preliminary values in the project's coordinates, with a crs against a block computed with PROJ alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.aerial_block_in_crs import AerialBlock, aerial_block

from orip.geometry.rotation import rotation_from_angles
from orip.prelim.ground import (
    absolute_in_project,
    block_in_project,
    orientations_in_frame,
    orientations_in_project,
    points_in_project,
)
from orip.prelim.rays import ImageRays
from orip.records.block import Block
from orip.records.control import Control
from orip.records.ground import PlainGround
from orip.records.preliminary import NO_POINTS, PhotoStart, PointStarts, PreliminaryValues, SimilarityStep

NO_RAYS = np.empty(0, dtype=np.int64)


@pytest.fixture(scope="module")
def made() -> AerialBlock:
    return aerial_block()


@pytest.fixture(scope="module")
def block(made: AerialBlock) -> Block:
    """Return the block with its true orientations, in its local frame."""
    return made.assembled(Control(points=tuple(made.control(dict.fromkeys(made.corners, (0.01,) * 3)))), shift=0.0)


@pytest.fixture(scope="module")
def photos(block: Block) -> list[PhotoStart]:
    """Return the true orientations, and one photo that has none."""
    rotations = rotation_from_angles(block.photo_orientation[:, 3:])
    starts = [
        PhotoStart(photo.name, rotation, row[:3], "true")
        for photo, rotation, row in zip(block.photos, rotations, block.photo_orientation, strict=True)
    ]
    return [*starts, PhotoStart("LOST", None, None, "no points")]


def test_orientations_are_those_of_the_crs(made: AerialBlock, block: Block, photos: list[PhotoStart]) -> None:
    found = orientations_in_project(photos, block.ground)
    # PROJ's own conversions are good to a micrometre
    np.testing.assert_allclose(found[:-1, :3], made.orientations[:, :3], atol=1e-5)
    np.testing.assert_allclose(found[:-1, 3:], made.orientations[:, 3:], atol=1e-7)
    assert np.isnan(found[-1]).all()


def test_orientations_in_the_frame_are_radians(block: Block, photos: list[PhotoStart]) -> None:
    found = orientations_in_frame(photos)
    np.testing.assert_allclose(found[:-1], block.photo_orientation, atol=1e-9)
    assert np.isnan(found[-1]).all()


def test_no_photos_and_no_points(block: Block) -> None:
    assert orientations_in_project([], block.ground).shape == (0, 6)
    assert points_in_project(NO_POINTS, block.ground) == []


def values_of(made: AerialBlock, block: Block, photos: list[PhotoStart]) -> PreliminaryValues:
    local = block.ground.to_local(made.points)
    points = PointStarts(tuple(made.point_names), local, np.tile([0.1, 0.2, 0.3], (len(local), 1)))
    corners = made.corners
    control = np.vstack([local[corners[:2]], [[np.nan, np.nan, 5.0]]])
    absolute = SimilarityStep(
        "absolute", "P1", "", "", ("A", "B", "C"), control, np.zeros((3, 3)), np.ones((3, 3)), 1.0, 0.0, np.zeros(3),
        np.zeros(3), np.zeros(3), np.zeros(3), 1, 1.0, 0.0,
    )  # fmt: skip
    return PreliminaryValues((), (), (), absolute, (), tuple(photos), points, ())


def test_points_keep_their_deviations(made: AerialBlock, block: Block, photos: list[PhotoStart]) -> None:
    points = points_in_project(values_of(made, block, photos).points, block.ground)
    np.testing.assert_allclose([point.coordinates for point in points], made.points, atol=1e-5)
    assert {point.deviations for point in points} == {(0.1, 0.2, 0.3)}


def test_the_block_as_it_is_shown(made: AerialBlock, block: Block, photos: list[PhotoStart]) -> None:
    rays = ImageRays(
        tuple(photo.name for photo in photos), tuple(made.point_names), NO_RAYS, NO_RAYS, np.empty((0, 2)),
        np.empty((0, 3)), np.empty(0),
    )  # fmt: skip
    shown = block_in_project(values_of(made, block, photos), rays, block.ground)
    assert shown.photos.tolist() == list(range(len(made.orientations)))
    np.testing.assert_allclose(shown.centres, made.orientations[:, :3], atol=1e-5)
    true = Rotation.from_euler("XYZ", made.orientations[:, 3:], degrees=True).as_matrix()
    np.testing.assert_allclose(shown.rotations, true, atol=1e-9)
    np.testing.assert_allclose(shown.coordinates, made.points, atol=1e-5)
    empty = PreliminaryValues((), (), (), None, (), (), NO_POINTS, ())
    assert len(block_in_project(empty, rays, block.ground).photos) == 0


def test_control_is_listed_as_the_project_has_it(made: AerialBlock, block: Block, photos: list[PhotoStart]) -> None:
    values = values_of(made, block, photos)
    listed = absolute_in_project(values, block.ground).absolute
    assert listed is not None
    np.testing.assert_allclose(listed.coordinates[:2], made.points[made.corners[:2]], atol=1e-5)
    # what is known in part has no place in the frame
    np.testing.assert_array_equal(listed.coordinates[2], [np.nan, np.nan, 5.0])
    assert "local frame" in listed.remarks[-1]
    assert absolute_in_project(values, PlainGround()) is values
