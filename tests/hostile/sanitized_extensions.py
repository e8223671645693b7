"""The C extensions built with sanitizers, as a plugin of pytest: ``pytest -p hostile.sanitized_extensions``.

They are loaded before any test from the folder in ORIP_SANITIZED, where `hostile.sanitize` has built them.
"""

from __future__ import annotations

import ctypes
import os
import sys
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

from support.declared_extensions import declared_extensions


def load(folder: Path) -> None:
    """Put the sanitized extensions in the places of the ordinary ones.

    Raises
    ------
    RuntimeError
        If the sanitizers do not watch this process.
    """
    if not hasattr(ctypes.CDLL(None), "__asan_init"):
        message = "the address sanitizer is not loaded: LD_PRELOAD has to name libasan.so"
        raise RuntimeError(message)
    for name in (extension.name for extension in declared_extensions()):
        spec = spec_from_loader(name, ExtensionFileLoader(name, str(folder / f"{name}.so")))
        assert spec is not None
        sys.modules[name] = module_from_spec(spec)


load(Path(os.environ["ORIP_SANITIZED"]))
