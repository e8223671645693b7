"""Common points of photos, against counting them one by one."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from orip.prelim.rays import ImageRays
from orip.prelim.relative.orientation import Pair, common_point_counts, pairs_by_common_points


def rays_of(seen: list[set[int]]) -> ImageRays:
    photo = np.array([row for row, points in enumerate(seen) for _ in points], dtype=np.int64)
    point = np.array([number for points in seen for number in sorted(points)], dtype=np.int64)
    count = len(photo)
    names = tuple(f"P{row}" for row in range(len(seen)))
    return ImageRays(
        names, tuple(map(str, range(12))), photo, point, np.zeros((count, 2)), np.zeros((count, 3)), np.ones(count)
    )


many_photos = st.lists(st.sets(st.integers(0, 11)), min_size=1, max_size=7)


@given(many_photos)
def test_counts_are_those_of_the_intersections(seen: list[set[int]]) -> None:
    counts = common_point_counts(rays_of(seen))
    assert counts.tolist() == [[len(one & other) for other in seen] for one in seen]


@given(many_photos, st.integers(1, 6))
def test_pairs_come_with_most_common_points_first(seen: list[set[int]], fewest: int) -> None:
    pairs = pairs_by_common_points(common_point_counts(rays_of(seen)), fewest)
    expected = {
        (left, right): len(seen[left] & seen[right])
        for left in range(len(seen))
        for right in range(left + 1, len(seen))
        if len(seen[left] & seen[right]) >= fewest
    }
    assert {(pair.left, pair.right): pair.common for pair in pairs} == expected
    assert [pair.common for pair in pairs] == sorted(expected.values(), reverse=True)


def test_equal_pairs_come_in_the_order_of_the_photos() -> None:
    same = {1, 2, 3}
    pairs = pairs_by_common_points(common_point_counts(rays_of([same, same, same])), 3)
    assert pairs == [Pair(0, 1, 3), Pair(0, 2, 3), Pair(1, 2, 3)]
