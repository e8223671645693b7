"""The mark of the run that a page was made from."""

from __future__ import annotations

RUN_NAME = "orip-run"
"""Name of the page's meta element with the run id."""


def run_of_page(head: str) -> str | None:
    """Return the run id that the beginning of a page names, None where there is none."""
    _, found, rest = head.partition(f'<meta name="{RUN_NAME}" content="')
    return rest.partition('"')[0] if found else None
