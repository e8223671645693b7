"""Lines of foreign texts as words; names may be in quotes where the format has them so."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from orip.exchange.sources.faults import Faults
from orip.files.text.lines import read_bytes

_QUOTED = re.compile(r'"([^"]*)"|(\S+)')


def text_lines(path: Path, faults: Faults) -> list[str]:
    """Return the lines of a text; bytes that are not UTF-8 are read as Windows' western characters.

    Names of photos come from programs and systems of all kinds; all else in these texts is ASCII.
    """
    data, complaints = read_bytes(path, faults.shown)
    faults.complaints += complaints
    data = (data or b"").removeprefix(b"\xef\xbb\xbf")
    if b"\0" in data:
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        faults.complain("the file has zero bytes: it is UTF-16, or no text; save it as UTF-8", line)
        return []
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
    return [line.rstrip("\r") for line in text.split("\n")]


def numbered_words(lines: list[str], comments: str = "") -> Iterator[tuple[int, list[str]]]:
    """Iterate over number, from 1, and words of the lines that have some; not those that begin with `comments`."""
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and not (comments and words[0].startswith(tuple(comments))):
            yield number, words


def quoted_words(line: str) -> list[str]:
    """Return the words of a line, of which those with blanks are in quotes."""
    return [match[1] if match[1] is not None else match[2] for match in _QUOTED.finditer(line)]
