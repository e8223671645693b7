"""What orip says first of each mistake: ``PYTHONPATH=tests python -m mistakes.data.study [--all] [NAME ...]``."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from cli.command_line import orip
from mistakes.data.mistakes import DATA_MISTAKES
from mistakes.first_line import first_line

if __name__ == "__main__":
    for name in [word for word in sys.argv[1:] if word in DATA_MISTAKES] or DATA_MISTAKES:
        mistake = DATA_MISTAKES[name]
        with TemporaryDirectory() as folder:
            project = mistake.clean(Path(folder) / name)
            mistake.make(project)
            start = time.monotonic()
            said = orip(project, "run", "--no-report")
            line = first_line([said])
            seconds = time.monotonic() - start
            sys.stdout.write(f"== {name}: {mistake.score(line)} ({seconds:.1f} s, exit {said.code})\n{line}\n")
            if "--all" in sys.argv:
                sys.stdout.write("".join(f"      {line}\n" for line in said.err.splitlines() if line[:1] != " "))
            sys.stdout.flush()
