"""The C extensions compiled with other options than those of an installation, and loaded in their place."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

from support.declared_extensions import REPOSITORY, declared_extensions


def compiler() -> list[str]:
    """Return the words of the compiler: CC, or what Python was compiled with."""
    return shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "gcc")


def build(folder: Path, flags: Sequence[str], *, replaced: Sequence[str] = ()) -> bool:
    """Compile all extensions into an empty folder, beside the ordinary ones; tell whether that was possible.

    Parameters
    ----------
    folder : Path
    flags : sequence of str
        In addition to those that pyproject.toml declares.
    replaced : sequence of str
        Those declared that are not used.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for extension in declared_extensions():
        words = [*compiler(), f"-I{sysconfig.get_path('include')}", "-shared", "-fPIC"]
        if sys.platform == "darwin":
            words += ["-undefined", "dynamic_lookup"]
        words += [*(flag for flag in extension.flags if flag not in replaced), *flags, *extension.sources]
        words += ["-lm", "-o", str(folder / f"{extension.name}.so")]
        if subprocess.run(words, cwd=REPOSITORY, check=False).returncode:
            return False
    return True


def load(folder: Path) -> None:
    """Put the extensions of a folder in the places of the ordinary ones."""
    for name in (extension.name for extension in declared_extensions()):
        spec = spec_from_loader(name, ExtensionFileLoader(name, str(folder / f"{name}.so")))
        assert spec is not None
        sys.modules[name] = module_from_spec(spec)
