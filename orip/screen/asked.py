"""What pages ask for: names and numbers out of their requests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from orip.web.page_server import Document, RequestError


def word(asked: Document, key: str) -> str:
    """Return a name; raise a `RequestError` if it is missing."""
    found = asked.get(key)
    if not isinstance(found, str) or not found:
        message = f"'{key}' is missing: give its name"
        raise RequestError(message)
    return found


def one_of(asked: Document, key: str, allowed: Sequence[str]) -> Any:
    """Return one of the words that are allowed; raise a `RequestError` if it is another one."""
    found = asked.get(key)
    if found not in allowed:
        message = f"'{key}' is one of {', '.join(allowed)}"
        raise RequestError(message)
    return found


def number(given: object, most: float) -> float:
    """Return a number; raise a `RequestError` if it is none, or its size is above `most`."""
    if isinstance(given, bool) or not isinstance(given, int | float) or not abs(given) <= most:
        message = f"expected a number up to {most:g}"
        raise RequestError(message)
    return float(given)


def numbers(given: object, count: int, most: float, what: str) -> tuple[float, ...]:
    """Return so many numbers; raise a `RequestError` if these are others."""
    if not isinstance(given, list) or len(given) != count:
        message = f"{what} are {count} numbers"
        raise RequestError(message)
    return tuple(number(one, most) for one in given)
