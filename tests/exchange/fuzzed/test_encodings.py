"""Texts of other programs in the encodings and with the line ends of other systems: read as the same project."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from exchange.fuzzed.test_hostile_projects import SOUND, format_of

from orip.exchange.sources.xml_tree import XmlEdit

WRITTEN: dict[str, Callable[[str], bytes]] = {
    "Macintosh": lambda text: text.replace("\n", "\r").encode(),
    "Windows": lambda text: text.replace("\n", "\r\n").encode("utf-8-sig"),
    "UTF-16": lambda text: text.encode("utf-16"),
    "DOS": lambda text: text.replace("\n", "\r\n").encode() + b"\x1a",
}
TEXTS = (
    *("aicon", "alicevision", "bal", "bingo", "blocks", "bundler", "csv", "gubaio", "ign", "lens", "metashape"),
    *("metashape references", "micmac", "nvm", "openmvg", "opensfm", "opensfm marked", "patb", "photomodeler", "pix4d"),
)


def read(name: str, source: Path) -> str:
    """Return all that is read of a project, as text."""
    read_format = format_of(name).read
    assert read_format is not None
    parsed = read_format(source, name)
    assert not parsed.complaints, parsed.complaints
    assert parsed.value is not None
    return repr(msgspec.structs.asdict(parsed.value))


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("system", WRITTEN)
def test_texts_of_other_systems_are_the_same_project(tmp_path: Path, name: str, system: str) -> None:
    source = SOUND[name](tmp_path)
    expected = read(name, source)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert files
    for path in files:
        path.write_bytes(WRITTEN[system](path.read_text(encoding="utf-8")))
    assert read(name, source) == expected


def test_a_result_is_written_into_utf_16_as_utf_8() -> None:
    text = '<?xml version="1.0" encoding="UTF-16"?><a><b>1</b><c>\u00e4</c></a>'
    edit = XmlEdit(text.encode("utf-16"), "a.xml")
    edit.replace(next(edit.root.within("b")), [2.5])
    assert edit.result().decode() == text.replace("UTF-16", "UTF-8").replace("<b>1", "<b>2.5")
