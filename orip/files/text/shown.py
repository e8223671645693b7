"""User input as messages show it: short, on one line, and without control characters."""

from __future__ import annotations

_LONGEST_TOKEN = 40
_LONGEST_MESSAGE = 500


def printable(text: str) -> str:
    """Return a message with characters that cannot be printed written as escapes, and not longer than a few lines."""
    shown = text if text.isprintable() else "".join(map(_escaped, text))
    return shown if len(shown) <= _LONGEST_MESSAGE else shown[: _LONGEST_MESSAGE - 3] + "..."


def shown_token(token: str) -> str:
    """Return a word of the user's as messages show it."""
    text = printable(token)
    return text if len(text) <= _LONGEST_TOKEN else text[: _LONGEST_TOKEN - 3] + "..."


def _escaped(character: str) -> str:
    return character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
