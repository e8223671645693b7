"""How a block would fit without a photo, by one linear step, against the adjustment without it."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.solving import OFF, redefined, solved
from support.synthetic_block import synthetic_block

from orip.bundle.antennas import without_photo
from orip.mistakes.misread_photos import may_fit_without, sigma0_without
from orip.records.block import Block
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
