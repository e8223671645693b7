"""Parameters of tests of which the ordinary suite takes some; ``make test-all`` takes all of them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import pytest

LONG = (pytest.mark.long, pytest.mark.timeout(4 * 3600))


def every(count: int, cases: Iterable[Any]) -> list[Any]:
    """Return all cases, of which only each `count`-th is not long."""
    return [_case(case, is_long=number % count > 0) for number, case in enumerate(cases)]


def with_long(long: Collection[Any], cases: Iterable[Any]) -> list[Any]:
    """Return all cases, of which those in `long` are long: they take seconds, and have a sibling that is not."""
    return [_case(case, is_long=case in long) for case in cases]


def in_turn(cases: Iterable[Any], ways: Sequence[Any], long: Collection[Any] = ()) -> list[Any]:
    """Return all cases in all ways, of which each case not in `long` is not long in a single one, in turn."""
    return [
        _case((case, way), is_long=number % len(ways) != at or case in long)
        for number, case in enumerate(cases)
        for at, way in enumerate(ways)
    ]


def _case(case: Any, *, is_long: bool) -> Any:
    values = case if isinstance(case, tuple) else (case,)
    return pytest.param(*values, marks=LONG if is_long else ())
