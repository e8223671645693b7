"""The C extensions built with sanitizers, as a plugin of pytest: ``pytest -p hostile.sanitized_extensions``.

They are loaded before any test from the folder in ORIP_SANITIZED, where `hostile.sanitize` has built them.
"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

from support.special_builds import load

if not hasattr(ctypes.CDLL(None), "__asan_init"):
    message = "the address sanitizer is not loaded: LD_PRELOAD has to name libasan.so"
    raise RuntimeError(message)
load(Path(os.environ["ORIP_SANITIZED"]))
