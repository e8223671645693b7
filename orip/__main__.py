"""The program from its first instant: Ctrl-C while it loads ends it without a traceback, too."""

from __future__ import annotations

import sys

INTERRUPTED = 130


def main() -> None:
    """Load and run the program `orip`."""
    try:
        from orip.cli.main import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("error: interrupted before anything was done\n")
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
