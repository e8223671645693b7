"""Retrieval of photos that show the same, on features of places that neighbouring photos of strips share."""

from __future__ import annotations

import numpy as np
import pytest

from orip.pictures.matching import pairs
from orip.pictures.matching.features import Features
from orip.pictures.matching.pairs import likely_pairs

STRIPS, OF_STRIP = 8, 24
KINDS = 400


@pytest.fixture(scope="module")
def flight() -> tuple[list[Features], np.ndarray]:
    """Photos of one unit square, 0.35 and 0.6 apart, and how much of each two show the same."""
    random = np.random.default_rng(2)
    extent = (0.35 * OF_STRIP + 1.0, 0.6 * STRIPS + 1.0)
    count = int(500 * extent[0] * extent[1])
    world = random.uniform(0.0, extent, (count, 2))
    # surfaces that resemble each other, as leaves and stones do
    kinds = random.exponential(20.0, (KINDS, 128))
    descriptors = kinds[random.integers(0, KINDS, count)] + random.exponential(14.0, (count, 128))
    corners = np.array([(0.35 * i, 0.6 * j) for j in range(STRIPS) for i in range(OF_STRIP)])
    photos = []
    for corner in corners:
        seen = np.flatnonzero(((world >= corner) & (world < corner + 1.0)).all(axis=1))
        seen = random.permutation(seen[random.random(len(seen)) < 0.6])  # SIFT finds again about so many
        noisy = np.clip(descriptors[seen] + 5.0 * random.standard_normal((len(seen), 128)), 0, 255)
        photos.append(Features(world[seen], np.ones(len(seen)), np.zeros(len(seen)), noisy.astype(np.uint8)))
    shared = np.clip(1.0 - np.abs(corners[:, None] - corners), 0.0, 1.0).prod(axis=2)
    return photos, shared


def overlapping(shared: np.ndarray, least: float) -> set[tuple[int, int]]:
    one, other = np.nonzero(np.triu(shared >= least, 1))
    return set(zip(one.tolist(), other.tolist(), strict=True))


def test_photos_that_overlap_are_found_without_comparing_all(flight: tuple[list[Features], np.ndarray]) -> None:
    photos, shared = flight
    found = set(likely_pairs(photos, 40))
    assert len(found) < 0.35 * len(photos) * (len(photos) - 1) / 2
    wanted = overlapping(shared, 0.3)
    assert len(found & wanted) >= 0.98 * len(wanted)


def test_of_many_photos_only_likely_pairs_are_examined(
    flight: tuple[list[Features], np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    photos, shared = flight
    number = {id(photo): place for place, photo in enumerate(photos)}
    examined = []

    def count(one: Features, other: Features) -> int:
        examined.append((number[id(one)], number[id(other)]))
        return int(30 * shared[examined[-1]])

    monkeypatch.setattr(pairs, "count_large_matches", count)
    found = set(pairs.promising_pairs(photos))
    assert sorted(examined) == likely_pairs(photos, 40)
    assert found & overlapping(shared, 0.3) == set(examined) & overlapping(shared, 0.3)
    assert not found - overlapping(shared, 0.01)


def test_photos_without_features_do_no_harm() -> None:
    empty = Features(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros((0, 128), dtype=np.uint8))
    assert all(0 <= one < other < 3 for one, other in likely_pairs([empty] * 3, 2))
