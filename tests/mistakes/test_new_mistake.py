"""A mistake is one module that says all about itself, and a line where it is looked for."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest
from cli.command_line import orip
from mistakes.small_folders import aerial

from orip.mistakes import explanation

MODULE = '''
"""Photos that were taken on a Monday."""

from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Misfit
from orip.mistakes.mistake import Consequence, declare

MONDAY = declare("monday", "photos were taken on a Monday", Consequence(warnings=("unused-control",)))


def photos_of_mondays(misfit: Misfit) -> list[ProjectWarning]:
    return [ProjectWarning(MONDAY, "photo P1", "it is of a Monday; take it again")]
'''


def test_a_mistake_is_one_module_and_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = aerial().write(tmp_path / "folder")
    with (folder / "T.PNT").open("a") as control:
        control.write("UNSEEN 1000 2000 100 0.02 0.02 0.02\n")
    before = orip(folder, "run", "--no-report").told
    assert "is not measured in any photo" in before

    (tmp_path / "mistaken_mondays.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    find = import_module("mistaken_mondays").photos_of_mondays
    monkeypatch.setattr(explanation, "SIGNS_IN_RESULT", (*explanation.SIGNS_IN_RESULT, find))
    said = orip(folder, "solve").told

    assert "warning: photo P1: it is of a Monday; take it again" in said
    (status,) = (line for line in said.splitlines() if line.startswith("status"))
    assert "doubtful" in status
    assert "photos were taken on a Monday" in status
    assert "is not measured in any photo" not in said
