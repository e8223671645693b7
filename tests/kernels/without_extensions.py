"""orip as it is where there was no compiler: the extensions cannot be imported, and numpy does their work.

As a pytest plugin (``pytest -p kernels.without_extensions`` with `tests` in PYTHONPATH) for all tests of a run, as a
program (``python tests/kernels/without_extensions.py ARGUMENTS``) for one orip command.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]


def extensions() -> list[str]:
    """Return the names of all extension modules that the build makes."""
    build = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    return [module["name"] for module in build["tool"]["setuptools"]["ext-modules"]]


# None makes Python raise ImportError
sys.modules.update(dict.fromkeys(extensions()))

if __name__ == "__main__":
    from orip.cli.main import main

    sys.argv[0] = "orip"
    main()
