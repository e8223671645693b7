"""What orip says first of each mistake in data, its score, and the table of the documentation.

``PYTHONPATH=tests python -m mistakes.data.study [--all] [--table] [NAME ...]``: all lines, write the table, some alone.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from cli.command_line import Said, orip
from mistakes.data.mistakes import DATA_MISTAKES, DataMistake
from mistakes.first_line import DOCUMENT, diagnosis, first_line

BEGIN, END = "<!-- data: begin -->\n", "<!-- data: end -->\n"
HEADING = "| mistake | score | what orip says first |\n|---|---|---|\n"


def said_of(mistake: DataMistake, folder: Path) -> Said:
    """Make a mistake in a new folder, and return what the run says."""
    mistake.make(mistake.clean(folder))
    return orip(folder, "run", "--no-report")


def row(mistake: DataMistake, line: str) -> str:
    """Return a row of the table."""
    return f"| {mistake.title} | {mistake.score(line)} | {diagnosis(line)} |\n"


def mean_row(scores: Sequence[int]) -> str:
    """Return the last row, with the mean of the scores."""
    return f"| mean | {sum(scores) / len(scores):.1f} | |\n"


def main(words: Sequence[str]) -> None:
    chosen = [name for name in DATA_MISTAKES if name in words] or list(DATA_MISTAKES)
    rows, scores = [], []
    for name in chosen:
        mistake = DATA_MISTAKES[name]
        with TemporaryDirectory() as folder:
            start = time.process_time()
            said = said_of(mistake, Path(folder) / name)
        line = first_line([said])
        seconds = time.process_time() - start
        sys.stdout.write(f"== {name}: {mistake.score(line)} ({seconds:.1f} s, exit {said.code})\n{line}\n")
        if "--all" in words:
            sys.stdout.write("".join(f"      {line}\n" for line in said.told.splitlines() if line[:1] != " "))
        sys.stdout.flush()
        rows.append(row(mistake, line))
        scores.append(mistake.score(line))
    if "--table" in words and len(chosen) == len(DATA_MISTAKES):
        before, rest = DOCUMENT.read_text(encoding="utf-8").split(BEGIN)
        _, after = rest.split(END)
        table = f"{HEADING}{''.join(rows)}{mean_row(scores)}"
        DOCUMENT.write_text(f"{before}{BEGIN}{table}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
