"""Write what commands print now into the pages: ``PYTHONPATH=tests python tests/documentation/refresh.py PAGE...``.

Only blocks that no longer agree are changed, and ``...`` within a line stays; where whole lines are left out, it is
only said. Read the difference before it is committed: the test that failed may have been right.
"""

from __future__ import annotations

import re
import sys
import tempfile
import textwrap
from pathlib import Path

from documentation.pages import Step, steps
from documentation.reader import MARGIN, Reader, agrees

WIDTH = 108


def refreshed(page: Path) -> str:
    """Return the text of a page with what its commands print now."""
    lines = page.read_text(encoding="utf-8").splitlines()
    with tempfile.TemporaryDirectory() as folder:
        reader = Reader(Path(folder))
        try:
            printed = [(step, reader.do(step)) for step in steps(page)]
        finally:
            reader.leave()
    for step, text in reversed(printed):
        if step.printed is not None and not agrees(step.printed, text):
            _replace(lines, step, text)
    return "\n".join(lines) + "\n"


def _replace(lines: list[str], step: Step, text: str) -> None:
    shown = list(step.printed or ())
    if any(line.strip() == "..." for line in shown):
        sys.stderr.write(f"line {step.line}: {step.typed!r} prints something else, see there\n{text}")
        return
    printed = [part for line in text.splitlines() for part in _broken(_kept(shown, line.rstrip()))]
    lines[step.line : step.line + len(shown)] = printed


def _broken(line: str) -> list[str]:
    """Return a long message in several lines, as on a terminal."""
    if len(line) <= WIDTH or not re.match(rf"(?:[a-z]+ +| +)(?<=^.{{{MARGIN}}})\S", line):
        return [line]
    return textwrap.wrap(line, WIDTH, subsequent_indent=" " * MARGIN, break_on_hyphens=False)


def _kept(shown: list[str], printed: str) -> str:
    """Return a printed line as the page shows it already, if it does."""
    return next((line for line in shown if agrees((line,), printed)), printed)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        Path(name).write_text(refreshed(Path(name)), encoding="utf-8")
