"""Points that their rays do not determine get no standard deviation."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import orip

BLOCKS = Path(__file__).parents[1] / "undetermined_blocks"


def solved(folder: Path, name: str) -> orip.Solution:
    shutil.copytree(BLOCKS / name, folder / name)
    return orip.open_project(folder / name).solve()


def truth(name: str) -> np.ndarray:
    """Return X and Y of a point of these blocks: a grid of 25 m, its names count columns and rows."""
    return 25.0 * np.array([int(name[1]), int(name[2])]) - 50.0


def test_points_with_one_ray_are_undetermined_as_a_whole(tmp_path):
    found = solved(tmp_path, "single_ray_points").points
    control = np.array([name in {"P00", "P04", "P22", "P40", "P44"} for name in found.names])
    assert np.isfinite(found.deviations[control]).all()
    assert np.isinf(found.deviations[~control]).all()


def test_points_in_photos_from_one_place_get_no_precision_that_is_not_true(tmp_path):
    found = solved(tmp_path, "three_identical_photos")
    if found.status != "converged":
        assert found.status == "not_converged"
        return
    for name, coordinates, sd in zip(
        found.points.names, found.points.coordinates, found.points.deviations, strict=True
    ):
        assert (np.abs(coordinates[:2] - truth(name)) < 4.0 * sd[:2]).all(), name


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, 0.0, 0.8), (2.0, -3.0, 6.0)])
def test_a_point_on_the_base_of_its_two_photos_is_not_determined(direction):
    along = np.array(direction) / np.linalg.norm(direction)
    across = np.cross(along, [0.3, 0.5, -0.7])
    across /= np.linalg.norm(across)
    rotation = np.column_stack([across, np.cross(across, along), -along])
    rotation[:, 1] = np.cross(rotation[:, 2], rotation[:, 0])
    ground = np.array([20.0 * along, 15.0 * along + 2.0 * across, 18.0 * along - rotation[:, 1]])
    centres = np.array([np.zeros(3), 5.0 * along])
    seen = np.einsum("ji,pkj->pki", rotation, ground[None] - centres[:, None])
    xy = -50.0 * seen[..., :2] / seen[..., 2:]
    phi = np.arcsin(rotation[0, 2])
    if np.isclose(abs(rotation[0, 2]), 1.0):
        angles = [np.arctan2(rotation[1, 0], rotation[1, 1]), phi, 0.0]
    else:
        angles = [
            np.arctan2(-rotation[1, 2], rotation[2, 2]), phi, np.arctan2(-rotation[0, 1], rotation[0, 0]),
        ]  # fmt: skip
    orientation = np.hstack([centres, np.tile(np.degrees(angles), (2, 1))])
    block = orip.Block(
        cameras=[orip.Camera("C", 50.0)],
        photos=orip.Photos(["A", "B"], "C", orientation, np.ones((2, 6), dtype=bool)),
        photo_points=orip.PhotoPoints(
            np.repeat(["A", "B"], 3), np.tile(["on_the_base", "P", "Q"], 2), xy.reshape(-1, 2)
        ),
    )
    points = block.adjust().points
    deviations = dict(zip(points.names, points.deviations, strict=True))
    # what is across the base is determined
    assert np.isinf(deviations["on_the_base"]).tolist() == (np.abs(along) > 0.0).tolist()
    assert np.isfinite(deviations["P"]).all()
    assert np.isfinite(deviations["Q"]).all()
