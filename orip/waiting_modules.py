"""Modules that are loaded when something of them is asked for, though another library names them when it is imported.

SciPy takes all names of NumPy, and with them what wraps Fortran and the tools for tests, which
take half as long again as NumPy itself.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


class WaitingModule(ModuleType):
    """Stands for a module until something of it is asked for; the name is the whole one."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):  # what Python asks of every module
            message = f"module {self.__name__!r} has not been loaded"
            raise AttributeError(message)
        return getattr(import_module(self.__name__), name)


def let_wait(package: ModuleType, *names: str) -> None:
    """Let modules of a package wait that have not been loaded yet."""
    for name in names:
        if name not in vars(package):
            setattr(package, name, WaitingModule(f"{package.__name__}.{name}"))
