"""The house: how many modules a folder shows, how long they are, that a folder says what is in it and has an order."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest
from documentation.pages import REPOSITORY

PACKAGE = REPOSITORY / "orip"
TESTS = REPOSITORY / "tests"
FOLDERS = sorted(path.parent for path in PACKAGE.rglob("__init__.py"))

MOST_MODULES = 22
MOST_TESTS = 24
MOST_LINES = 400

WITHOUT_CONTRACT = {"orip.bundle.kinds"}
"""They have a contract of another type."""


def name_of(folder: Path) -> str:
    return ".".join(folder.relative_to(REPOSITORY).parts)


def modules(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*.py") if path.stem != "__init__"]


def imported(folder: Path, module: Path) -> set[str]:
    """Return the modules beside it that a module imports."""
    within = re.compile(rf"{re.escape(name_of(folder))}\.(\w+)")
    tree = ast.parse(module.read_text(encoding="utf-8"))
    names = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {found[1] for name in names if (found := within.match(name))} - {module.stem}


@pytest.mark.parametrize("folder", FOLDERS, ids=name_of)
def test_a_folder_can_be_surveyed(folder: Path) -> None:
    assert len(modules(folder)) <= MOST_MODULES
    said = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))
    assert said, "nothing says what is in this folder"
    assert all(len(path.read_text(encoding="utf-8").splitlines()) < MOST_LINES for path in modules(folder))


def test_a_folder_of_tests_can_be_surveyed() -> None:
    folders = {path.parent for path in TESTS.rglob("*.py")}
    crowded = [folder.relative_to(TESTS) for folder in folders if len(modules(folder)) > MOST_TESTS]
    assert not crowded


def test_a_folder_with_an_order_has_a_contract() -> None:
    contracts = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    ordered = {name for contract in contracts["contracts"] for name in contract.get("containers", [])}
    chains = {
        name_of(folder)
        for folder in FOLDERS
        for module in modules(folder)
        for below in imported(folder, module)
        if (folder / f"{below}.py").is_file() and imported(folder, folder / f"{below}.py")
    }
    without = {name for name in chains - ordered - WITHOUT_CONTRACT if not name.startswith("orip.exchange.")}
    assert not without, f"no layers in pyproject.toml: {', '.join(sorted(without))}"
