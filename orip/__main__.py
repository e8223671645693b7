"""The program from its first instant: Ctrl-C while it loads ends it without a traceback, too."""

from __future__ import annotations

import sys


def main() -> None:
    """Load and run the program `orip`."""
    try:
        from orip.cli.main import main as run

        run()
    except KeyboardInterrupt:
        from orip.errors import INTERRUPTED

        sys.stderr.write("error: interrupted before anything was done\n")
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
