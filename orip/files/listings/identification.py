"""What tells whose listing a text is, without reading all of it."""

from __future__ import annotations

import re

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
