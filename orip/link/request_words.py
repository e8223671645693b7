"""Requests to the plate processor, from the bytes of a line to its verb, keywords and numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from orip.records.drive_table import DriveCode, DriveFault

LONGEST_REQUEST = 512
"""Bytes of a request without the end of its line."""

LARGEST_NUMBER = 1e11
"""Beyond this a number in double precision does not have the four decimals of a reply."""

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")

_SHOWN = 40


class Refused(Exception):  # noqa: N818  # what the protocol does with a request
    """A request cannot be done; carries the fault that is the reply."""

    def __init__(self, code: DriveCode, text: str) -> None:
        super().__init__(text)
        self.fault = DriveFault(code, text)


class Request(NamedTuple):
    """A verb in upper case, and the words after it as they were written."""

    verb: str
    words: tuple[str, ...]


def read_request(line: bytes) -> Request:
    """Read a line, without its end; raises `Refused` if it is too long or has no verb."""
    if len(line) > LONGEST_REQUEST:
        raise Refused(DriveCode.LINE_TOO_LONG, f"a request has at most {LONGEST_REQUEST} bytes")
    words = line.decode("ascii", errors="replace").split()
    if not words:
        raise Refused(DriveCode.UNKNOWN_VERB, "the line is empty; HELP lists the verbs")
    return Request(words[0].upper(), tuple(words[1:]))


def numbers(words: Sequence[str]) -> tuple[float, ...]:
    """Read finite decimal numbers."""
    return tuple(map(_number, words))


def three_numbers(words: Sequence[str]) -> tuple[float, float, float]:
    """Read three numbers."""
    x, y, z = map(_number, words)
    return x, y, z


def two_numbers(words: Sequence[str]) -> tuple[float, float]:
    """Read two numbers."""
    x, y = map(_number, words)
    return x, y


def whole_number(word: str) -> int:
    """Read a number of lines."""
    if not (word.isascii() and word.isdecimal() and len(word) < 19):
        raise Refused(DriveCode.NOT_A_NUMBER, f"'{shown(word)}' is not a whole number")
    return int(word)


def keyword(word: str, *allowed: str) -> str:
    """Return one of the words that are allowed, in upper case."""
    written = word.upper()
    if written not in allowed:
        raise Refused(DriveCode.BAD_KEYWORD, f"'{shown(word)}' is none of {', '.join(allowed)}")
    return written


def shown(word: str) -> str:
    """Return a word as a reply may contain it."""
    plain = "".join(character if character.isascii() and character.isprintable() else "?" for character in word)
    return plain if len(plain) <= _SHOWN else f"{plain[:_SHOWN]}..."


def _number(word: str) -> float:
    if _NUMBER.fullmatch(word) is None:
        raise Refused(DriveCode.NOT_A_NUMBER, f"'{shown(word)}' is not a number; write for example 12.345")
    value = float(word)
    if abs(value) >= LARGEST_NUMBER:
        raise Refused(DriveCode.NOT_A_NUMBER, f"'{shown(word)}' is too large; numbers are below {LARGEST_NUMBER:g}")
    return value
