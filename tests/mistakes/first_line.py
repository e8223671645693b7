"""What orip says first of a project with a mistake, and the table of the documentation."""

from __future__ import annotations

import re
from pathlib import Path

from cli.command_line import Said, orip
from mistakes.catalogue import MISTAKES, Mistake
from mistakes.edits import sample

DOCUMENT = Path(__file__).parents[2] / "docs" / "mistakes.md"
WIDTH = 70
"""Most characters of a message that the document has: enough to know it again."""

BEGIN, END = "<!-- table: begin -->\n", "<!-- table: end -->\n"

_COMMANDS = {"measure": (("init",), ("measure",)), "run": (("run", "--no-report"),)}


def said_of(mistake: Mistake, folder: Path) -> list[Said]:
    """Make a mistake in a new folder, and return what the commands say."""
    mistake.make(sample(mistake.sample, folder))
    return [orip(folder, *words) for words in _COMMANDS[mistake.upto]]


def first_line(said: list[Said]) -> str:
    """Return the first error or warning; else the status, and without one nothing."""
    lines = [line for answer in said for line in answer.told.splitlines()]
    return next((line for line in lines if re.match("error: |warning: |status ", line)), "")


def row(mistake: Mistake, line: str) -> str:
    """Return a row of the table."""
    return f"| {mistake.title} | {diagnosis(line)} |\n"


def diagnosis(line: str) -> str:
    """Return how a message begins, without what it says to do, as a cell of a table."""
    wrong, semicolon, _ = line.partition("; ")
    begun = wrong if len(wrong) <= WIDTH else wrong[: wrong.rindex(" ", 0, WIDTH)]
    return f"{begun}{' ...' if semicolon or begun != wrong else ''}".replace("|", "\\|").replace("<", "&lt;")


def write_table() -> None:
    """Write the table of the documentation again: ``PYTHONPATH=tests python -m mistakes.first_line``."""
    from tempfile import TemporaryDirectory

    rows = ["| mistake | what orip says first |\n", "|---|---|\n"]
    for name, mistake in ((name, mistake) for name, mistake in MISTAKES.items() if mistake.listed):
        with TemporaryDirectory() as folder:
            rows.append(row(mistake, first_line(said_of(mistake, Path(folder) / name))))
    before, rest = DOCUMENT.read_text(encoding="utf-8").split(BEGIN)
    _, after = rest.split(END)
    DOCUMENT.write_text(f"{before}{BEGIN}{''.join(rows)}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    write_table()
