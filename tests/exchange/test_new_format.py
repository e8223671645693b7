"""A format of another program is one module or folder that says all about itself, and a line in the list of formats."""

from __future__ import annotations

import pickle
from importlib import import_module
from pathlib import Path

import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import block

from orip.exchange import formats
from orip.records.exchanged import PoseReading

MADE_UP = '''
"""Projects of a made-up program."""

import pickle
from pathlib import Path

from orip.exchange.format import Format
from orip.files.text.shown import Parsed
from orip.records.exchanged import ExchangedProject


def is_made_up(path: Path) -> bool:
    return path.suffix == ".madeup"


def read_made_up(path: Path, shown: str) -> Parsed[ExchangedProject | None]:
    return Parsed(pickle.loads(path.read_bytes()), ())


MADE_UP_FORMAT = Format("made-up", "a program", read_made_up, is_made_up)
'''


def test_a_format_is_one_module_and_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "block.madeup"
    source.write_bytes(pickle.dumps(block(PoseReading("y_down", "to_camera", "matrix", "radian", "centre"))))
    assert "looks like none of the formats" in orip(tmp_path, "import", str(source), "before").err

    (tmp_path / "made_up_format.py").write_text(MADE_UP, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    made_up = import_module("made_up_format").MADE_UP_FORMAT
    monkeypatch.setattr(formats, "FORMATS_READ", (*formats.FORMATS_READ, made_up))
    said = orip(tmp_path, "import", str(source), "after")

    assert said.code == 0, said.err
    assert (tmp_path / "after" / "orip.toml").exists()
