"""orip as compilers without vectors build it, such as Microsoft's: one number after the other.

As a pytest plugin (``pytest -p kernels.one_lane`` with `tests` in PYTHONPATH) for all tests of a run, as a program
(``python tests/kernels/one_lane.py ARGUMENTS``) for one orip command. The extensions are those in the folder
ORIP_ONE_LANE, where `kernels.run` has compiled them.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.special_builds import load

load(Path(os.environ["ORIP_ONE_LANE"]))

if __name__ == "__main__":
    from orip.cli.main import main

    sys.argv[0] = "orip"
    main()
