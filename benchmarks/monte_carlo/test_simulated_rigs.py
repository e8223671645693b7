"""Rigs are found again as well as their standard deviations say, also from nothing; planted mistakes are named.

The figures of the long studies are in docs/verification.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from monte_carlo.rig_study import PLANTED, errors_of, is_right_from_nothing, is_right_without_common_view, named
from monte_carlo.simulated_blocks import in_parallel
from support.rig_blocks import rig_block

from orip.solving.solve import solve
from orip.structs import replace

LOG = logging.getLogger(__name__)


def check_errors(runs: int, tolerance: float, processes: int) -> None:
    found = in_parallel(errors_of, list(range(runs)), processes)
    for what in ("unknowns", "photos", "points"):
        errors = np.concatenate([getattr(one, what) for one in found])
        ratio = float(np.sqrt(np.mean(errors**2)))
        LOG.info("%d blocks: errors of %d %s over their standard deviations %.4f", runs, len(errors), what, ratio)
        assert abs(ratio - 1.0) < tolerance, what
    ratios = [one.sd_of_points / one.sd_alone for one in found]
    LOG.info("standard deviations of points over those without rig: %.3f (median)", float(np.median(ratios)))
    assert max(ratios) < 1.0


def check_from_nothing(
    runs: int, part: float, processes: int, is_right: Callable[[int], bool] = is_right_from_nothing
) -> None:
    right = sum(in_parallel(is_right, list(range(runs)), processes))
    LOG.info("%d of %d blocks are right from nothing", right, runs)
    assert right >= part * runs


def check_planted(what: str, runs: int, processes: int) -> None:
    found = in_parallel(partial(named, what), list(range(runs)), processes)
    right, others = sum(is_named for is_named, _ in found), sum(bool(others) for _, others in found)
    LOG.info("%s: %d of %d named, others in %d", what, right, runs, others)
    assert right >= 0.95 * runs or what == "nothing"
    assert others <= 0.01 * runs


def test_errors_are_as_large_as_standard_deviations_say() -> None:
    check_errors(12, 0.12, 1)


def test_blocks_of_rigs_are_right_from_nothing() -> None:
    check_from_nothing(2, 1.0, 1)


def test_blocks_without_common_view_are_right_from_nothing() -> None:
    check_from_nothing(3, 1.0, 1, is_right_without_common_view)


@pytest.mark.parametrize("what", PLANTED)
def test_planted_mistakes_of_rigs_are_named(what: str) -> None:
    check_planted(what, 1, 1)


def test_a_wrong_mounting_is_named_where_another_one_is_little_known() -> None:
    """Against the second camera alone the third one would not be significantly off."""
    assert named("mounting", 41) == (True, [])


@pytest.mark.parametrize("head", ["three", "penta"])
def test_a_constant_mounting_that_is_wrong_is_what_the_first_sentence_says(head: str) -> None:
    block = rig_block(head, "constant", mounting_error=(1e-4, 1e-4), planted={"mounting": (0.3, -0.2, 0.2)}).block
    (rig,) = block.rigs.rigs
    held = tuple(replace(one, offset_error=None, rotation_error=None) for one in rig.cameras)
    rigs = replace(block.rigs, rigs=(replace(rig, cameras=held),))
    solution, _ = solve(replace(block, rigs=rigs))
    camera = f"camera {block.cameras[-1].name}"
    assert [(code, where) for code, where, _ in solution.warnings] == [("mounting", camera)]
    assert f"see the warning about {camera}" in solution.verdict


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_errors_in_200_blocks() -> None:
    check_errors(200, 0.03, 2)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_200_blocks_from_nothing() -> None:
    check_from_nothing(200, 0.99, 2)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_200_blocks_without_common_view_from_nothing() -> None:
    check_from_nothing(200, 0.99, 2, is_right_without_common_view)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("what", PLANTED)
def test_planted_mistakes_in_100_blocks(what: str) -> None:
    check_planted(what, 100, 2)
