"""A point of one photo found in another: where it is, and not where several places look alike."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from pictures.rendered_plane import texture
from scipy.ndimage import shift

pytest.importorskip("cv2")

from orip.images.matching.least_squares import Fate  # after what it needs
from orip.images.matching.one_point import Expected, FoundPoint, find_point

MOVED = np.array([3.3, -2.2])
SIDE = 260


def found(grey: NDArray[np.float64], places: NDArray[np.float64]) -> list[FoundPoint]:
    """Return places of a picture as found in one that has moved, expected up to nine pixels from there."""
    random = np.random.default_rng(2)
    one, other = (
        np.clip(np.rint(part + 2.0 * random.standard_normal(part.shape)), 0, 255).astype(np.uint8)
        for part in (grey, shift(grey, MOVED[::-1], order=3, mode="grid-wrap"))
    )
    expected = places + MOVED + random.uniform(-9.0, 9.0, places.shape)
    return [
        find_point(one, place, [Expected(other, at, np.eye(2))])[0]
        for place, at in zip(places, expected, strict=True)
    ]  # fmt: skip


def test_a_point_is_found_where_it_is() -> None:
    random = np.random.default_rng(1)
    places = random.uniform(80.0, SIDE - 80.0, (40, 2))
    points = found(texture(SIDE, random), places)
    matched = np.array([point.fate == Fate.MATCHED for point in points])
    off = np.array([point.place for point in points]) - places - MOVED
    assert matched.mean() > 0.9
    assert np.abs(off[matched]).max() < 0.3


def test_of_places_that_look_alike_none_is_taken() -> None:
    random = np.random.default_rng(1)
    grey = np.tile(texture(SIDE, random)[:16, :13], (SIDE // 16, SIDE // 13))
    points = found(grey, random.uniform(80.0, SIDE - 80.0, (40, 2)))
    assert all(point.fate != Fate.MATCHED for point in points)
    assert sum(point.fate == Fate.ALIKE for point in points) > 20
