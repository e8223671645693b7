"""Files changed in their structure: a value of JSON, an element of XML or a cell of a table that is something else."""

from __future__ import annotations

import copy
import json
import random
import re
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree as ET

NAMES = (
    "../../up",
    "a\x1b[2J",
    "\x85",
    "\u202eabc",
    "\ud800",
    "NUL",
    "",
    " ",
    "x" * 300,
    "a,b;c\td",
    "é",
    "-",
    "!a",
    "0",
)
_VALUES: tuple[Any, ...] = (
    None, True, [], {}, "", "x", "1", 0, -1, 0.5, -1e300, 1e300, 10**40, -(10**40), 2**63, float("inf"), float("nan"),
    [[[[[]]]]], [1, 2, 3], ["x"] * 3, [None] * 3, {"x": {"y": []}}, [[1, 2, 3]] * 3, 1e-320, *NAMES,
)  # fmt: skip
_WORDS = (
    "", "x", "-1", "0", "1e999", "-1e999", "nan", "1" * 400, "9223372036854775808", "1e-320", "1,5", "0x10", "1 2",
    "true", "null", "1e300", "-1e300", "2147483648", "4294967296", "٣", *NAMES[:-1],
)  # fmt: skip
_CELL = re.compile(r"[^\s,;]+")
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def mutated_structure(data: bytes, chance: random.Random) -> bytes | None:
    """Return a file changed in its structure; None where it is neither JSON nor XML nor a text of cells."""
    head = data.lstrip()[:1]
    if head in {b"{", b"["} and (document := _json(data)) is not None:
        for _ in range(chance.choice((1, 1, 2, 4))):
            document = _changed_json(document, chance)
        return json.dumps(document).encode()
    if head == b"<":
        return _changed_xml(data, chance)
    if b"\0" in data:
        return None
    return _changed_table(data.decode("utf-8", "replace"), chance).encode("utf-8", "replace")


def _json(data: bytes) -> Any:
    try:
        return json.loads(data)
    except ValueError:
        return None


def _changed_json(document: Any, chance: random.Random) -> Any:
    places: list[tuple[Any, Any]] = []

    def visit(node: Any) -> None:
        for key in list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
            places.append((node, key))
            visit(node[key])

    visit(document)
    if not places or chance.random() < 0.02:
        return copy.deepcopy(chance.choice(_VALUES))
    node, key = _any_depth(places, chance)
    edit = chance.randrange(8)
    if edit == 0:
        del node[key]
    elif edit == 1 and isinstance(node, list):
        node.insert(key, copy.deepcopy(node[key]))
    elif edit == 1:
        node[chance.choice(NAMES)] = copy.deepcopy(node[key])
    elif edit == 2:
        other_node, other_key = chance.choice(places)
        node[key] = copy.deepcopy(other_node[other_key])
    else:
        node[key] = copy.deepcopy(chance.choice(_VALUES))
    return document


def _any_depth(places: list[tuple[Any, Any]], chance: random.Random) -> tuple[Any, Any]:
    """Return a place; keys are as likely as the many elements of arrays."""
    keys = [place for place in places if isinstance(place[1], str)]
    return chance.choice(keys if keys and chance.random() < 0.7 else places)


def _changed_xml(data: bytes, chance: random.Random) -> bytes | None:
    try:
        root = ET.fromstring(data)
    except ET.ParseError:
        return None
    parents = {child: parent for parent in root.iter() for child in parent}
    for _ in range(chance.choice((1, 1, 2, 4))):
        element = chance.choice(list(root.iter()))
        parent, edit = parents.get(element), chance.randrange(7)
        word = _NO_XML.sub("?", chance.choice(_WORDS))
        if edit == 0 and parent is not None and element in list(parent):
            parent.remove(element)
        elif edit == 1 and parent is not None:
            parent.insert(chance.randrange(len(parent) + 1), copy.deepcopy(element))
        elif edit == 2 and element.attrib:
            del element.attrib[chance.choice(list(element.attrib))]
        elif edit in (3, 4) and element.attrib:
            element.set(chance.choice(list(element.attrib)), word)
        elif edit == 5:
            element.tag = chance.choice([other.tag for other in root.iter()])
        else:
            element.text = word
    return ET.tostring(root)


def _changed_table(text: str, chance: random.Random) -> str:
    lines = text.split("\n")
    for _ in range(chance.choice((1, 1, 2, 4))):
        _TABLE_EDITS[chance.randrange(len(_TABLE_EDITS))](lines, chance)
    return "\n".join(lines)


def _cell(lines: list[str], chance: random.Random) -> None:
    place = _line(lines, chance)
    cells = list(_CELL.finditer(lines[place]))
    if cells:
        cell = chance.choice(cells)
        lines[place] = lines[place][: cell.start()] + chance.choice(_WORDS) + lines[place][cell.end() :]


def _column(lines: list[str], chance: random.Random) -> None:
    """Take a cell out of all lines, with what stands before it."""
    number = chance.randrange(8)
    for place, line in enumerate(lines):
        cells = list(_CELL.finditer(line))
        if number < len(cells):
            begin = cells[number - 1].end() if number else 0
            lines[place] = line[:begin] + line[cells[number].end() :]


def _drop(lines: list[str], chance: random.Random) -> None:
    del lines[_line(lines, chance)]
    lines.append("")


def _double(lines: list[str], chance: random.Random) -> None:
    lines.insert(chance.randrange(len(lines) + 1), lines[_line(lines, chance)])


def _swap(lines: list[str], chance: random.Random) -> None:
    one, other = _line(lines, chance), _line(lines, chance)
    lines[one], lines[other] = lines[other], lines[one]


def _line(lines: list[str], chance: random.Random) -> int:
    return chance.randrange(min(len(lines), chance.choice((3, 10, 1 << 30))))


_TABLE_EDITS: tuple[Callable[[list[str], random.Random], None], ...] = (
    _cell,
    _cell,
    _cell,
    _column,
    _drop,
    _double,
    _swap,
)
