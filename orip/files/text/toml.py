"""The one place where TOML is parsed: not before its nesting is looked at.

The library's parser needs memory and time with the square of the parts of a dotted key, and the stack of the machine
for arrays in arrays.
"""

from __future__ import annotations

import re
import tomllib
from typing import Any

DEEPEST = 12
"""Parts of a key, and brackets in one another; a project file has three."""

_TOKEN = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"""|\Z)|'
    r"'''.*?(?:'''|\Z)|"
    r'"(?:[^"\\\n]|\\.)*+"?|'
    r"'[^'\n]*+'?|#[^\n]*|[\[\]{}=,.\n]",
    re.DOTALL,
)
"""Texts that do not end are tokens, too: each character is looked at once."""


class NestingError(ValueError):
    """A text is nested more deeply than orip reads; `line` says where, counted from 1."""

    def __init__(self, what: str, line: int) -> None:
        super().__init__(f"{what}, and up to {DEEPEST} are read; a project file needs three at most")
        self.line = line


def toml_document(text: str) -> dict[str, Any]:
    """Return a TOML text as `tomllib` reads it.

    Raises
    ------
    NestingError
        If it is nested too deeply.
    ValueError
        If it is not TOML: tomllib.TOMLDecodeError, or a whole number of thousands of digits.
    """
    _require_flat(text)
    return tomllib.loads(text)


def _require_flat(text: str) -> None:
    line, depth, parts = 1, 0, 1
    for match in _TOKEN.finditer(text):
        token = match.group()
        if token == ".":
            parts += 1
            if parts > DEEPEST:
                what = "a key has more parts with dots between them"
                raise NestingError(what, line)
            continue
        if token[0] in "\"'#":
            line += token.count("\n")  # a part of a key may be in quotes: dots go on counting
            continue
        parts = 1
        if token == "\n":
            line += 1
        elif token in "[{":
            depth += 1
            if depth > DEEPEST:
                what = "more brackets are open in one another"
                raise NestingError(what, line)
        elif token in "]}":
            depth = max(depth - 1, 0)
