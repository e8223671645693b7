"""Photos of three points, which nothing checks, and which have other places from which these are seen as measured."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from support.synthetic_block import SyntheticBlock, synthetic_block

from orip.bundle.results.unchecked_photos import UNCHECKED
from orip.bundle.verdict import OTHER_ORIENTATION
from orip.records.block import Block
from orip.records.control import ControlElement
from orip.records.results.solution import Solution
from orip.solving.solve import solve
from orip.structs import replace

NOISE_MM = 0.005


def made_of(seed: str) -> SyntheticBlock:
    return synthetic_block("convergent", f"unchecked {seed}", noise_mm=NOISE_MM, precision_mm=NOISE_MM)


def with_points_in_photo(made: SyntheticBlock, photo: int, names: list[str]) -> Block:
    """Return a block that starts at the truth, a photo of which shows some points alone."""
    points = made.block.photo_points
    chosen = np.isin(np.array(made.block.point_names)[points.point], names)
    kept = np.flatnonzero((points.photo != photo) | chosen)
    return replace(
        made.block,
        photo_orientation=made.orientations,
        point_start=made.points,
        photo_points=points.of(kept),
    )


def seen(made: SyntheticBlock, photo: int, count: int) -> list[str]:
    """Return so many points that a photo shows, far apart in it."""
    points = made.block.photo_points
    rays = np.flatnonzero(points.photo == photo)
    chosen = [int(rays[0])]
    while len(chosen) < count:
        apart = np.linalg.norm(points.xy[rays, None] - points.xy[chosen], axis=2).min(axis=1)
        chosen.append(int(rays[np.argmax(apart)]))
    return [made.block.point_names[row] for row in points.point[chosen].tolist()]


def found_by(solution: Solution, code: str) -> list[str]:
    return [one.where for one in solution.diagnosis if one.code == code]


def other_places(solution: Solution) -> list[np.ndarray]:
    """Return the places that are named."""
    (text,) = [one.text for one in solution.diagnosis if one.code == OTHER_ORIENTATION]
    places = text.partition("from ")[2].partition(":")[0].replace(", ", " or ").split(" or ")
    return [np.array([float(value) for value in place.split()]) for place in places]


def misfit_from(block: Block, photo: int, centre: np.ndarray, truth: np.ndarray) -> float:
    """Return the root mean square residual (mm) of a photo's points after its adjustment from a place, points held."""
    points = block.photo_points
    rows = np.flatnonzero(points.photo == photo)
    ground = truth[points.point[rows]]
    c, dx, dy = block.cameras[0].parameters[:3]

    def residuals(elements: np.ndarray) -> np.ndarray:
        seen = (ground - elements[:3]) @ Rotation.from_rotvec(elements[3:]).as_matrix()
        return (-c * seen[:, :2] / seen[:, 2:] + [dx, dy] - points.xy[rows]).ravel()

    rays = np.column_stack([points.xy[rows] - [dx, dy], np.full(len(rows), -c)])
    turned = Rotation.align_vectors(ground - centre, rays / np.linalg.norm(rays, axis=1, keepdims=True))[0]
    found = least_squares(residuals, [*centre, *turned.as_rotvec()], x_scale="jac")
    assert np.linalg.norm(found.x[:3] - centre) < 0.1
    return float(np.sqrt(np.mean(found.fun**2)))


@pytest.mark.parametrize("seed", ["a", "b", "c", "d"])
def test_a_photo_of_three_points_is_said_to_be_unchecked(seed: str) -> None:
    made = made_of(seed)
    solution, _ = solve(with_points_in_photo(made, 2, seen(made, 2, 3)))
    assert found_by(solution, UNCHECKED) == ["photo P3"]
    assert "all unknowns are determined" not in solution.verdict
    assert "photo P3" in solution.verdict


@pytest.mark.parametrize("seed", ["a", "b", "c", "d", "h"])
def test_three_points_are_seen_as_measured_from_the_places_that_are_named(seed: str) -> None:
    made = made_of(seed)
    block = with_points_in_photo(made, 2, seen(made, 2, 3))
    solution, _ = solve(block)
    assert solution.status == "doubtful"
    assert "photo P3 may be at another place, where its points fit as well" in solution.verdict
    for place in other_places(solution):
        assert np.linalg.norm(place - made.orientations[2, :3]) > 0.1
        assert misfit_from(block, 2, place, made.points) < 0.1 * NOISE_MM


@pytest.mark.parametrize("seed", ["a", "k"])
def test_four_points_close_together_on_a_plane_fit_in_a_second_place(seed: str) -> None:
    made = made_of(seed)
    points = made.block.photo_points

    fours = np.array(list(combinations(points.point[points.photo == 2].tolist(), 4)))
    offset = made.points[fours] - made.points[fours].mean(axis=1, keepdims=True)
    size = np.ptp(offset, axis=1).max(axis=1) + 5.0 * np.linalg.svd(offset, compute_uv=False)[:, 2]
    four = fours[np.argmin(size)].tolist()
    block = with_points_in_photo(made, 2, [made.block.point_names[row] for row in four])
    solution, _ = solve(block)
    assert solution.status == "doubtful"
    assert found_by(solution, UNCHECKED) == []
    (place,) = other_places(solution)
    # the square sum of eight residuals is larger by 20 at most, of points with errors of their own
    assert misfit_from(block, 2, place, made.points) < np.sqrt(28.0 / 8.0) * NOISE_MM


@pytest.mark.parametrize("count", [6, 12])
def test_a_photo_of_more_points_is_checked(count: int) -> None:
    made = made_of("e")
    solution, _ = solve(with_points_in_photo(made, 2, seen(made, 2, count)))
    assert found_by(solution, UNCHECKED) == found_by(solution, OTHER_ORIENTATION) == []
    assert solution.status == "converged"


def test_a_photo_with_a_station_is_checked_by_it() -> None:
    made = made_of("f")
    block = with_points_in_photo(made, 2, seen(made, 2, 3))
    observed = tuple(
        ControlElement("P3", "PHOTO", kind, value, 0.01)
        for kind, value in zip(("X0", "Y0", "Z0"), made.orientations[2, :3].tolist(), strict=True)
    )
    solution, _ = solve(replace(block, elements=observed))
    assert found_by(solution, UNCHECKED) == found_by(solution, OTHER_ORIENTATION) == []
