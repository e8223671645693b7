"""The program from its first instant: Ctrl-C while it loads ends it without a traceback, too."""

from __future__ import annotations

import gc
import sys

_ALLOCATIONS = 250_000
"""Containers after which Python looks for circles among them: orip's data have none, and every thousandth container, as
is usual, takes a quarter of the time of a large block."""

_IN_PARTS = {
    "scipy.linalg": (),
    "scipy.special": ("_ufuncs",),
    "scipy.sparse.csgraph": ("_matching", "_reordering"),
}
"""Packages of SciPy of which orip needs a few modules and functions."""


def main() -> None:
    """Load and run the program `orip`."""
    gc.set_threshold(_ALLOCATIONS, 20, 20)
    try:
        from orip.waiting_modules import load_in_parts

        load_in_parts(_IN_PARTS)
        from orip.cli.main import main as run

        run()
    except KeyboardInterrupt:
        from orip.errors import INTERRUPTED

        sys.stderr.write("error: interrupted before anything was done\n")
        sys.exit(INTERRUPTED)
    finally:
        gc.freeze()  # all that is left ends with the process; Python would look for circles in it once more


if __name__ == "__main__":
    main()
