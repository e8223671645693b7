"""orip as it is where there was no compiler: extensions cannot be imported, and numpy does the work of some.

As a pytest plugin (``pytest -p kernels.without_extensions`` with `tests` in PYTHONPATH) for all tests of a run, as a
program (``python tests/kernels/without_extensions.py ARGUMENTS``) for one orip command. ORIP_WITHOUT names
the extensions, all unless given.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.declared_extensions import declared_extensions

missing = os.environ.get("ORIP_WITHOUT", " ".join(extension.name for extension in declared_extensions())).split()
# None makes Python raise ImportError
sys.modules.update(dict.fromkeys(missing))

if __name__ == "__main__":
    from orip.cli.main import main

    sys.argv[0] = "orip"
    main()
