"""Stopping: a search that was cut short is marked as stopped, whatever its last adjustment came to."""

from __future__ import annotations

from bundle.aerial_block import aerial_block
from bundle.solving import noisy, with_error

from orip.bundle.methods import Method, adjust_block
from orip.bundle.snooping.search import SnoopingSettings

SNOOPING = Method(SnoopingSettings())


def blundered():
    block = noisy(aerial_block("methods"), 1)
    return with_error(with_error(block, 3, 0, 80.0), 40, 1, 60.0)


def test_a_search_that_is_stopped_says_so():
    passes = []
    complete, _ = adjust_block(blundered(), SNOOPING, passes.append, lambda: False)
    assert complete.status == "converged"
    assert len({blunder.order for blunder in complete.blunders}) >= 2
    first = next(iteration.iteration for iteration in passes if iteration.enp >= 4.0)

    seen = []
    stopped, _ = adjust_block(blundered(), SNOOPING, seen.append, lambda: len(seen) >= first)
    assert len(seen) == first, "the current iteration was the last"
    assert stopped.status == "stopped"
    assert stopped.blunders == ()
