"""The list of tests that a wheel has to pass is of tests that exist, and is read by whoever builds wheels."""

from __future__ import annotations

import tomllib
from pathlib import Path

from support.declared_extensions import REPOSITORY

LIST = Path(__file__).with_name("tests.txt")


def test_all_tests_of_the_list_exist() -> None:
    named = LIST.read_text(encoding="utf-8").split()
    assert named
    assert [name for name in named if not (REPOSITORY / name).exists()] == []


def test_cibuildwheel_runs_the_list_on_copies_that_hold_no_package() -> None:
    told = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["cibuildwheel"]
    assert any(command.endswith(f"@tests/wheel/{LIST.name}") for command in told["test-command"])
    assert "orip" not in told["test-sources"]
