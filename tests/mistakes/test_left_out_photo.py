"""How a block would fit without a photo, by one linear step, against the adjustment without it."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.solving import OFF, redefined, solved
from mistakes.planted.blocks import Planted, planted_block
from mistakes.planted.study import said_of
from support.synthetic_block import synthetic_block

from orip.bundle.antennas import without_photo
from orip.mistakes.left_out_photos import may_fit_without, sigma0_without
from orip.prelim import chain
from orip.records.block import Block
from orip.records.preliminary import PreliminaryValues
from orip.structs import replace

WRONG = 2


@pytest.fixture(scope="module")
def block() -> Block:
    """Return a block of which the points of one photo have errors of 20 times those a priori."""
    made = redefined(synthetic_block("strip", "a wrong photo", noise_mm=0.005, precision_mm=0.005).block, **OFF)
    points = made.photo_points
    errors = 20.0 * points.error * np.random.default_rng(23).normal(size=points.xy.shape)
    xy = points.xy + np.where((points.photo == WRONG)[:, None], errors, 0.0)
    return replace(made, photo_points=replace(points, xy=xy))


def test_the_linear_step_tells_how_the_others_fit(block: Block) -> None:
    found = solved(block)
    for row, photo in enumerate(block.photos):
        rest = solved(without_photo(block, row))
        # errors of 20 times 5 um bend rays by 1e-3 at most: the second order is a thousandth of the first
        assert sigma0_without(found, photo.name) == pytest.approx(rest.variance.sigma0, rel=5e-3)
    assert sigma0_without(found, block.photos[WRONG].name) < 1.2 < 2.0 < found.variance.sigma0


def test_only_photos_without_which_the_others_may_fit_are_left_out(block: Block) -> None:
    found = solved(block)
    assert found.variance.sigma0 > 6.0
    assert may_fit_without(found, block.photos[WRONG].name)
    assert not may_fit_without(found, block.photos[-1].name)


def test_an_adjustment_that_has_not_converged_says_nothing(block: Block) -> None:
    stopped = solved(redefined(block, max_iterations=1, start_down_weight=1))
    assert not stopped.converged
    assert all(may_fit_without(stopped, photo.name) for photo in block.photos)


def with_mixed_numbers(block: Planted, photos: list[str]) -> Planted:
    """Return a block in some photos of which each image stands under another point's number."""
    random = np.random.default_rng(5)
    for photo in photos:
        points = block.points_of(photo)
        images = [block.images[photo, point] for point in points]
        for point, place in zip(points, random.permutation(len(points)).tolist(), strict=True):
            block.images[photo, point] = images[place]
    return block


def test_photos_that_contradict_the_others_are_named_without_another_search(monkeypatch: pytest.MonkeyPatch) -> None:
    made = planted_block("two strips", 0)
    photos = [made.photos[1], made.photos[6]]
    search = chain.preliminary_values_from_all_rays

    def search_among_them(block: Block) -> PreliminaryValues:
        # they may be of another flight, and fit each other
        assert {photo.name for photo in block.photos} <= set(photos)
        return search(block)

    monkeypatch.setattr(chain, "preliminary_values_from_all_rays", search_among_them)
    first = said_of(with_mixed_numbers(made, photos))[0][0]
    assert first.startswith(f"photos {photos[0]} and {photos[1]}: the other photos fit without them, and they do not")
