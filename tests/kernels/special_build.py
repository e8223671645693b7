"""orip with extensions that were compiled in a special way, such as without vectors, one number after the other.

As a pytest plugin (``pytest -p kernels.special_build`` with `tests` in PYTHONPATH) for all tests of a run, as a program
(``python tests/kernels/special_build.py ARGUMENTS``) for one orip command. The extensions are those in the folder
ORIP_SPECIAL_BUILD, where `kernels.run` has compiled them.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.special_builds import load

load(Path(os.environ["ORIP_SPECIAL_BUILD"]))

if __name__ == "__main__":
    from orip.cli.main import main

    sys.argv[0] = "orip"
    main()
