"""Words of messages and listings: plural forms, counted nouns, lists of names.

The same phrase is built in one place, so that a message of the bundle adjustment and one of a file read alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

_MOST_COUNTED = 3
_MOST_LISTED = MOST_TO_CHANGE = 20
"""A project may have thousands of photos, a reseau hundreds of crosses."""


def agreeing(number: int, singular: str, plural: str = "") -> str:
    """Return the form of a noun or verb that agrees with a number; the plural form is the singular with s if not given.

    ``agreeing(1, "point")`` is ``point``, ``agreeing(0, "point")`` is ``points``, ``agreeing(2, "is", "are")`` is
    ``are``.
    """
    return singular if number == 1 else plural or f"{singular}s"


def counted(number: int, noun: str) -> str:
    """Return ``1 photo`` or ``3 photos``."""
    return f"{number} {agreeing(number, noun)}"


def joined(words: Sequence[str], last: str = "and") -> str:
    """Return ``a``, ``a and b`` or ``a, b and c``, or with another word than `last`; nothing if there are no words."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def first_names(names: Sequence[str], most: int, count: int | None = None) -> str:
    """Return the first names and how many more there are: ``101, 102 and 5 more``; `count` is how many there are."""
    count = len(names) if count is None else count
    more = f" and {count - most} more" if count > most else ""
    return ", ".join(names[:most]) + more


def listed_names(names: Iterable[str]) -> str:
    """Return the names that are known, for a message about one that is not: twenty at most, or ``none``."""
    return first_names(list(names), _MOST_LISTED) or "none"


def counted_names(noun: str, names: Sequence[str], most: int = _MOST_COUNTED) -> str:
    """Return names after their noun, three of them at most: ``photo 101``, ``photos 101, 102 and 103``.

    Who is to change something of each has to know all: `most` is then `MOST_TO_CHANGE`.
    """
    listed = joined(names) if len(names) <= most else first_names(names, most)
    return f"{agreeing(len(names), noun)} {listed}"
