"""Points that are eliminated together: every point in one group, and groups joined only where that saves time."""

from __future__ import annotations

import numpy as np
import pytest
from aerial_blocks import aerial_block

from orip.bundle.compiled import loop_pattern as point_groups
from orip.bundle.compiled.loop_pattern import PhotoSets, groups_of_sets, sets_of_photos
from orip.bundle.compiled.photo_loop import PhotoPointLoop, photo_loop
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.problem import BlockProblem, pose_problem
from orip.records.block import Block


def of_points(*photos: tuple[int, ...]) -> PhotoSets:
    start = np.cumsum([0, *(len(shown) for shown in photos)])
    return sets_of_photos(np.array(sum(photos, ()), dtype=np.int32), start)


def test_points_of_the_same_photos_are_one_set() -> None:
    sets = of_points((0, 1), (1, 2, 5), (0, 1), (1, 2))
    assert sets.of_point.tolist() == [0, 1, 0, 2]
    assert sets.first.tolist() == [0, 1, 3]
    assert list(zip(sets.number.tolist(), sets.photo.tolist(), strict=True)) == [
        (0, 0), (0, 1), (1, 1), (1, 2), (1, 5), (2, 1), (2, 2),
    ]  # fmt: skip


def test_sets_of_the_same_sum_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    def weak(number: np.ndarray, attempt: int) -> np.ndarray:
        return number if attempt == 1 else number**2  # 0 + 3 = 1 + 2, but the squares differ

    monkeypatch.setattr(point_groups, "_mixed", weak)
    assert of_points((0, 3), (1, 2), (0, 3)).of_point.tolist() == [0, 1, 0]


def test_neighbours_that_share_most_photos_are_joined_and_others_are_not() -> None:
    # ten points on a line, each seen by one photo more on the right and one less on the left; ten others far away
    windows = [tuple(range(k, k + 30)) for k in (*range(10), *range(100, 110))]
    sets = of_points(*windows)
    along = np.array([*range(10), *range(1000, 1010)], dtype=float)
    group = groups_of_sets(sets, np.column_stack([along, np.zeros((20, 2))]))
    assert len(set(group[:10])) < 5
    assert not set(group[:10]) & set(group[10:])


def test_many_points_of_few_photos_keep_their_own_group() -> None:
    sets = of_points(*[(0, 1)] * 500, *[(1, 2)] * 500)
    near = np.random.default_rng(1).uniform(size=(1000, 3))
    assert groups_of_sets(sets, near).tolist() in ([0, 1], [1, 0])


@pytest.mark.parametrize(
    "coordinates", [np.zeros((4, 3)), np.full((4, 3), np.nan), np.diag([np.inf, 1.0, 2.0, 3.0])[:, :3]]
)
def test_coordinates_that_say_nothing_are_no_obstacle(coordinates: np.ndarray) -> None:
    sets = of_points((0, 1), (1, 2), (2, 3), (3, 4))
    assert sorted(set(groups_of_sets(sets, coordinates))) == list(range(max(groups_of_sets(sets, coordinates)) + 1))


def least_time(shown: list[set[int]], first: int, end: int) -> float:
    """Return the time of a part of a row of points in the best of all its groups, by trying all halves of halves."""
    photos = set().union(*shown[first:end])
    rays = sum(len(of_point) for of_point in shown[first:end])
    whole = float(point_groups._time(np.array([len(photos)]), np.array([rays]))[0])
    if end - first == 1:
        return whole
    middle = first + (end - first) // 2
    return min(whole, least_time(shown, first, middle) + least_time(shown, middle, end))


@pytest.mark.parametrize("seed", range(5))
def test_points_that_miss_photos_at_random_are_joined_where_only_many_of_them_save_time(seed: int) -> None:
    # 30 of 50 photos show a point: two of them together take longer than apart, sixteen do not
    random = np.random.default_rng(seed)
    shown = [set((random.permutation(50)[:30] + 60 * (k // 64)).tolist()) for k in range(128)]
    sets = of_points(*(tuple(sorted(photos)) for photos in shown))
    along = np.column_stack([np.arange(128.0), np.zeros((128, 2))])
    group = groups_of_sets(sets, along)
    in_groups = [[shown[k] for k in np.flatnonzero(group == number)] for number in range(group.max() + 1)]
    photos = np.array([len(set().union(*of_group)) for of_group in in_groups])
    rays = np.array([sum(map(len, of_group)) for of_group in in_groups])
    assert point_groups._time(photos, rays).sum() == least_time(shown, 0, 128)
    assert len(in_groups) == 2


def test_there_may_be_no_points() -> None:
    sets = sets_of_photos(np.empty(0, dtype=np.int32), np.zeros(1, dtype=np.int64))
    assert groups_of_sets(sets, np.empty((0, 3))).tolist() == []


def loop_of(problem: BlockProblem) -> PhotoPointLoop:
    kind = next(kind for kind in problem.observations if isinstance(kind, PhotoPointObservations))
    return photo_loop(kind, problem.unknowns, problem.block.point_start)


@pytest.fixture(scope="module")
def block() -> Block:
    return aerial_block(100, 40)


def test_a_group_has_all_photos_of_its_points_and_no_others(block: Block) -> None:
    loop = loop_of(pose_problem(block))
    pattern, cameras = loop.pattern, len(loop.cameras.form)
    assert np.array_equal(np.sort(pattern.block), np.arange(len(block.point_names)))
    assert np.array_equal(np.sort(pattern.order), np.arange(len(block.photo_points.photo)))
    for group in range(len(pattern.group_start) - 1):
        points = pattern.group_start[group : group + 2]
        shown = block.photo_points.photo[pattern.order[pattern.start[points[0]] : pattern.start[points[1]]]]
        runs = pattern.runs[pattern.runs_start[group] : pattern.runs_start[group + 1]]
        assert runs.tolist() == [0, *(np.unique(shown) + cameras).tolist()]


def test_photos_of_a_group_may_be_farther_apart_than_the_band_is_wide(block: Block) -> None:
    # what the block compared with a full matrix in test_banded_block has to show
    problem = pose_problem(block)
    assert problem.layout.arrangement is not None
    loop, places = loop_of(problem), problem.layout.arrangement.places
    of_photo = places[loop.photo_columns]
    pattern, cameras = loop.pattern, len(loop.cameras.form)
    farthest = 0
    for first, last in zip(pattern.runs_start[:-1], pattern.runs_start[1:], strict=True):
        shown = of_photo[pattern.runs[first:last][1:] - cameras]
        farthest = max(farthest, int(shown.max() - shown.min()))
    assert farthest > problem.layout.arrangement.width
