"""The extension modules that pyproject.toml declares."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import NamedTuple

REPOSITORY = Path(__file__).parents[2]


class Extension(NamedTuple):
    """An extension module: its name, sources and headers in the repository, and what the compiler is told."""

    name: str
    sources: tuple[str, ...]
    flags: tuple[str, ...]
    depends: tuple[str, ...]


def declared_extensions() -> list[Extension]:
    """Return all extension modules that the build makes."""
    build = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    modules = build["tool"]["setuptools"]["ext-modules"]
    return [
        Extension(
            module["name"],
            tuple(module["sources"]),
            tuple(module["extra-compile-args"]),
            tuple(module.get("depends", ())),
        )
        for module in modules
    ]
