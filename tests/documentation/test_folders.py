"""The house: how many modules a folder shows, how long they are, that a folder says what is in it."""

from __future__ import annotations

import ast
import tomllib
from collections import Counter
from pathlib import Path

import pytest
from documentation.pages import REPOSITORY

PACKAGE = REPOSITORY / "orip"
TESTS = REPOSITORY / "tests"
STUDIES = REPOSITORY / "benchmarks" / "monte_carlo"
FOLDERS = sorted(path.parent for path in PACKAGE.rglob("__init__.py"))

MOST_MODULES = 22
MOST_TESTS = 24
MOST_LINES = 400

MOST_CONTRACTS = 12
MOST_LINES_OF_PYPROJECT = 400


def name_of(folder: Path) -> str:
    return ".".join(folder.relative_to(REPOSITORY).parts)


def modules(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*.py") if path.stem != "__init__"]


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


def test_modules_of_tests_have_names_of_their_own() -> None:
    """Two of one name are an error only where both are collected: it would come up in the whole suite alone."""
    names = Counter(path.name for folder in (TESTS, STUDIES) for path in folder.rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []


def test_the_rules_of_imports_can_be_surveyed() -> None:
    text = (REPOSITORY / "pyproject.toml").read_text(encoding="utf-8")
    contracts = tomllib.loads(text)["tool"]["importlinter"]["contracts"]
    assert len(contracts) <= MOST_CONTRACTS
    assert [c["ancestors"] for c in contracts if c["type"] == "acyclic_siblings"] == [["orip"]]
    assert len(text.splitlines()) <= MOST_LINES_OF_PYPROJECT
