"""Modules that are loaded when something of them is asked for, though another library names them when it is imported.

SciPy takes all names of NumPy, and with them what wraps Fortran and the tools for tests, which
take half as long again as NumPy itself. Its own packages load all of their modules, and rewrite the documentation of
their functions, where orip needs LAPACK and some distributions.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from threading import RLock
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.abc import Loader  # takes as long to import as all else here


class WaitingModule(ModuleType):
    """Stands for a module until something of it is asked for; the name is the whole one."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):  # what Python asks of every module
            message = f"module {self.__name__!r} has not been loaded"
            raise AttributeError(message)
        return getattr(import_module(self.__name__), name)


class WaitingMaskedArrays(WaitingModule):
    """Stands for NumPy's module of masked arrays, which `np.unique` and `np.median` ask whether an array is masked.

    While it has not been loaded none is.
    """

    @staticmethod
    def is_masked(_array: object) -> bool:
        """Return whether an array has masked elements."""
        return False

    @staticmethod
    def isMaskedArray(_array: object) -> bool:  # noqa: N802  # the name is NumPy's
        """Return whether an array can have masked elements."""
        return False


def let_wait(package: ModuleType, *names: str, stand_in: type[WaitingModule] = WaitingModule) -> None:
    """Let modules of a package wait that have not been loaded yet."""
    for name in names:
        if name not in vars(package):
            setattr(package, name, stand_in(f"{package.__name__}.{name}"))


_loading = RLock()


class WaitingPackage(ModuleType):
    """Stands for a package, each of whose modules can be imported alone, until something else of it is asked for."""

    def __init__(self, name: str, first: Sequence[str]) -> None:
        super().__init__(name)
        self._first = first
        self._waits = True

    def __getattr__(self, name: str) -> object:
        if name.startswith("__") and name != "__all__":  # what Python asks of every module
            message = f"module {self.__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        if self._waits and name != "__all__":
            for module in self._first:
                known = vars(import_module(f"{self.__name__}.{module}"))
                if name in known:
                    return known[name]
            try:
                return import_module(f"{self.__name__}.{name}")
            except ModuleNotFoundError as error:
                if error.name != f"{self.__name__}.{name}":
                    raise
                if name.startswith("_"):  # a module that not every build has: asked for while others are being loaded
                    message = f"module {self.__name__!r} has no module {name!r}"
                    raise AttributeError(message) from None
        self._load()
        return super().__getattribute__(name)

    def __dir__(self) -> list[str]:
        self._load()
        return sorted(vars(self))

    def _load(self) -> None:
        """Load all of the package, once; another thread waits until that is done."""
        with _loading:
            if self._waits and self.__spec__ is not None and self.__spec__.loader is not None:
                self._waits = False
                self.__spec__.loader.exec_module(self)


class _InParts:
    """Makes a package that waits in place of loading it."""

    def __init__(self, loader: Loader, first: Sequence[str]) -> None:
        self._loader = loader
        self._first = first

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return WaitingPackage(spec.name, self._first)

    def exec_module(self, module: ModuleType) -> None:
        if module.__spec__ is not None:
            module.__spec__.loader = module.__loader__ = self._loader


class _PackagesInParts:
    def __init__(self, packages: Mapping[str, Sequence[str]]) -> None:
        self._packages = packages

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        first = self._packages.get(fullname)
        spec = None if first is None else PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None and first is not None:
            spec.loader = _InParts(spec.loader, first)  # type: ignore[assignment]  # Python asks for these methods alone
        return spec


def load_in_parts(packages: Mapping[str, Sequence[str]]) -> None:
    """Let modules of packages be imported alone; what else is asked of one of these loads all of it.

    Parameters
    ----------
    packages : mapping
        By names of packages that have not been loaded, those modules among whose names one is looked for first.
    """
    sys.meta_path.insert(0, _PackagesInParts(packages))
