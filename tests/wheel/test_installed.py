"""What a wheel brings: the extensions for any Python from 3.11 on, the files beside the code, and the program."""

from __future__ import annotations

import sys
import sysconfig
from importlib import import_module
from importlib.metadata import entry_points, files
from pathlib import Path

import pytest
from support.declared_extensions import REPOSITORY, declared_extensions

import orip
from orip.workflow.sample_projects import SAMPLES

PACKAGE = Path(orip.__file__).parent

pytestmark = pytest.mark.skipif(PACKAGE.parent == REPOSITORY, reason="orip is not installed from a wheel: make wheel")


@pytest.mark.parametrize("name", [extension.name for extension in declared_extensions()])
def test_the_extensions_are_there_for_the_stable_interface_of_python(name: str) -> None:
    found = Path(str(import_module(name).__file__))
    assert found.is_relative_to(PACKAGE)
    # on Windows the name of such an extension has no version at all
    assert found.name.endswith(".pyd" if sys.platform == "win32" else ".abi3.so")
    assert "cp3" not in found.name


def test_the_name_of_the_wheel_says_that_it_serves_all_pythons_from_3_11_on() -> None:
    tags = [line for line in _metadata("WHEEL").splitlines() if line.startswith("Tag: ")]
    assert tags
    assert all(tag.startswith("Tag: cp311-abi3-") for tag in tags)


@pytest.mark.parametrize("name", SAMPLES)
def test_the_sample_projects_are_beside_the_code(name: str) -> None:
    assert (PACKAGE / "sample_projects" / name / "orip.toml").is_file()


def test_the_program_is_where_the_shell_finds_it() -> None:
    (script,) = entry_points(group="console_scripts", name="orip")
    assert script.load() is import_module("orip.__main__").main
    assert any((Path(sysconfig.get_path("scripts")) / name).exists() for name in ("orip", "orip.exe"))


def test_no_c_and_no_test_is_installed() -> None:
    installed = [str(path) for path in files("orip") or ()]
    assert installed
    assert not [path for path in installed if path.endswith((".c", ".h")) or path.startswith("tests/")]


def _metadata(name: str) -> str:
    (found,) = [path for path in files("orip") or () if path.name == name and path.parent.suffix == ".dist-info"]
    return found.read_text(encoding="utf-8")
