"""Parts of a block that hang on a few points are named."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from orip.prelim.found_values import weak_connections
from orip.prelim.rays import ImageRays
from orip.prelim.relative.orientation import common_point_counts


def strip(across: int) -> ImageRays:
    """Return six photos of a strip: neighbours share ten points, and `across` points reach from P2 and P3 to P4."""
    seen = [(photo, 100 * pair + point) for pair in range(5) for point in range(10) for photo in (pair, pair + 1)]
    # three in a row share ten points but where it is weak
    seen += [
        (photo, 1000 * first + point)
        for first in (1, 4)
        for point in range(10)
        for photo in range(first - 1, first + 2)
    ]
    seen += [(photo, 9000 + point) for point in range(across) for photo in (1, 2, 3)]
    names, point = np.unique([sight[1] for sight in seen], return_inverse=True)
    photo = np.array([sight[0] for sight in seen])
    nothing = np.zeros((len(photo), 3))
    points = tuple(map(str, names.tolist()))
    return ImageRays(
        tuple(f"P{k + 1}" for k in range(6)), points, photo, point, nothing[:, :2], nothing, np.ones(len(photo))
    )


def told(rays: ImageRays, control: int = 0) -> list[str]:
    known = np.zeros(len(rays.points), dtype=bool)
    known[rays.point[rays.photo == 0][:control]] = True
    return [
        connection
        for connection in weak_connections(rays, common_point_counts(rays), known)
        if "by photo P3" in connection
    ]


def test_few_points_across() -> None:
    (sentence,) = told(strip(2))
    assert sentence.startswith("photos P1, P2 are connected with the others only by photo P3 and 2 points,")


def test_one_point_across_or_none() -> None:
    (sentence,) = told(strip(0))
    assert "only by photo P3, and no point determines the scale there: measure more" in sentence
    for (sentence,) in (told(strip(1)), told(strip(0), control=1)):
        assert "only by photo P3 and 1 point, which alone determines the scale there" in sentence


def test_enough_points_across_or_control_beyond() -> None:
    assert told(strip(6)) == []
    assert told(strip(2), control=2) == []


@pytest.mark.parametrize("seed", range(5))
def test_joints_are_those_without_which_a_block_falls_apart(seed):
    # 30 photos with one to three neighbours, and one point in each: no part has a scale of its own
    random = np.random.default_rng(seed)
    common = np.zeros((30, 30), dtype=np.int64)
    for photo in range(1, 30):
        for other in random.choice(photo, size=min(photo, int(random.integers(1, 3))), replace=False):
            common[photo, other] = common[other, photo] = 6
    nothing = np.zeros((30, 3))
    each = np.arange(30)
    rays = ImageRays(tuple(map(str, each)), tuple(map(str, each)), each, each, nothing[:, :2], nothing, np.ones(30))
    found = set()
    for joint in range(30):
        others = np.delete(each, joint)
        count, label = connected_components(common[np.ix_(others, others)], directed=False)
        parts = sorted((others[label == part].tolist() for part in range(count)), key=len)
        # the largest is the rest of the block; of equally large ones the first
        largest = max((part for part in parts if len(part) == len(parts[-1])), key=lambda part: -part[0])
        found |= {(joint, len(part)) for part in parts if part != largest}
    sentences = list(weak_connections(rays, common, np.zeros(30, dtype=bool)))
    told = {int(re.search(r"only by photo (\d+)", sentence)[1]) for sentence in sentences}
    assert told == {joint for joint, _ in found}
    assert len(sentences) >= len(told) > 0
