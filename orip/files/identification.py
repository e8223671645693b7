"""What tells whose listing or result.json a text is, without reading all of it."""

from __future__ import annotations

import json
import re

from orip.schemas.catalogue import identifier

RUN_LABEL = "Run id"
TITLE_LINES = 16
"""The run id is looked for in so many lines; a listing's tables are not searched."""


def run_of_listing(text: str) -> str | None:
    """Return the run id in a listing's title block, or None where there is none.

    Parameters
    ----------
    text : str
        The listing or its beginning; anything else gives None.
    """
    for line in text.split("\n", TITLE_LINES)[:TITLE_LINES]:
        found = re.fullmatch(rf"{RUN_LABEL} +(\S.*?)\s*", line)
        if found:
            return found[1]
    return None


SCHEMA = identifier("result")

_HEAD = re.compile(rf'\s*{{\s*"schema"\s*:\s*"{re.escape(SCHEMA)}"\s*,\s*"run"\s*:\s*("(?:[^"\\]|\\.)*")')


def run_of_result(text: str) -> str | None:
    """Return the run id of a result.json, or None where the text is none.

    Parameters
    ----------
    text : str
        The file or, as orip writes it, its beginning: the run id is in the second line.
    """
    head = _HEAD.match(text)
    try:
        document = {"schema": SCHEMA, "run": json.loads(head[1])} if head else json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        return None
    run = document.get("run")
    return run if isinstance(run, str) else None
