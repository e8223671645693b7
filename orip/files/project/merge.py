"""An orip.toml brought up to date: what need not change stays as its owner wrote it, comments included."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from msgspec import Struct

from orip.files.project.reader import parse_project
from orip.files.project.records import project_document, project_text, record_text
from orip.files.project.tables import RECORD_SECTIONS, SINGLE_SECTIONS
from orip.files.project.toml_lines import KeyPath, TomlLines, toml_document
from orip.files.project.toml_text import TomlTable, toml_assignment
from orip.files.text.lines import split_line
from orip.records.definition import ProjectDefinition
from orip.records.names import record_key


class _Block(Struct, frozen=True):
    """The lines of one table: comments and blank lines above it, and itself."""

    above: str
    own: str


def merged_project_text(text: str, definition: ProjectDefinition) -> str:
    """Return a project file that says what a definition says.

    Parameters
    ----------
    text : str
        A project file without faults, whose [project], [check] and [report] are those of the definition.

    Returns
    -------
    str
        Records of a kind come in the order of the definition, kinds in that of the text. One that is unchanged stands
        as it stood; in one that has changed the lines of the keys that have changed are rewritten. Where a text of
        another structure (arrays in place of headers) prevents that, more of it is rewritten, if need be all.
    """
    old = parse_project(text)
    if old.value is None or old.complaints:
        return project_text(project_document(definition))
    if old.value.definition == definition:
        return text if text.endswith("\n") else f"{text}\n"
    merged = _merged(text, old.value.definition, definition)
    again = parse_project(merged)
    if again.complaints or again.value is None or again.value.definition != definition:
        return project_text(project_document(definition))
    return merged


def _merged(text: str, old: ProjectDefinition, new: ProjectDefinition) -> str:
    blocks, before, document = _blocks(text), project_document(old), project_document(new)
    parts = [
        f"{blocks[place].above}{blocks[place].own}"
        for place in ((section,) for section in SINGLE_SECTIONS)
        if place in blocks
    ]
    found = list(dict.fromkeys(place[0] for place in blocks))
    for section in sorted(
        RECORD_SECTIONS, key=lambda section: found.index(section) if section in found else len(found)
    ):
        known = {record_key(table["name"]): index for index, table in enumerate(before[section])}
        for table in document[section]:
            index = known.get(record_key(table["name"]), -1)
            block = blocks.get((section, index))
            if block is None or not block.own.startswith("["):
                parts.append("\n" + record_text(section, table))
            elif before[section][index] == table:
                parts.append(block.above + block.own)
            else:
                changed = _with_changed_keys(block.own, section, before[section][index], table)
                parts.append(block.above + (changed or record_text(section, table)))
    return "".join(part if part.endswith("\n") else f"{part}\n" for part in parts)


def _blocks(text: str) -> dict[KeyPath, _Block]:
    """Return the lines of each table of a project file by what leads to it."""
    document: Mapping[str, Any] = toml_document(text)
    where = TomlLines(text)
    starts = sorted((where.line_of(place), place) for place in _places(document))
    lines = [f"{line}\n" for line in text.removesuffix("\n").split("\n")]
    ends = [line for line, _ in starts[1:]] + [len(lines) + 1]
    first_free = 1
    blocks = {}
    for (start, place), end in zip(starts, ends, strict=True):
        last = end - 1
        while last > start and split_line(lines[last - 1], last) is None and end <= len(lines):
            last -= 1
        blocks[place] = _Block("".join(lines[first_free - 1 : start - 1]), "".join(lines[start - 1 : last]))
        first_free = last + 1
    return blocks


def _with_changed_keys(own: str, section: str, old: TomlTable, new: TomlTable) -> str | None:
    """Return the lines of a record with those of its changed keys replaced; None where that cannot be done."""
    (written,) = toml_document(own)[section]
    where, lines = TomlLines(own), own.splitlines(keepends=True)
    starts = sorted((where.line_of((section, 0, key)), key) for key in written)
    ends = [line for line, _ in starts[1:]] + [len(lines) + 1]
    spans = {key: (line, end) for (line, key), end in zip(starts, ends, strict=True)}
    wanted = dict(written)
    for key in sorted({**old, **new}, key=lambda key: spans.get(key, (0, 0)), reverse=True):
        if old.get(key) == new.get(key):
            continue
        wanted.pop(key, None)
        text = ""
        if key in new:
            wanted[key] = new[key]
            text = toml_assignment(key, new[key])
        if key in spans:
            line, end = spans[key]
            last = next(n for n in range(end - 1, line - 1, -1) if n == line or split_line(lines[n - 1], n))
            comment = _comment(lines[line - 1]) if text and last == line else ""
            lines[line - 1 : last] = [f"{text}{comment}\n"] if text else []
        else:
            lines.append(f"{text}\n")
    merged = "".join(lines)
    try:
        return merged if toml_document(merged)[section] == [wanted] else None
    except ValueError:
        return None


def _comment(line: str) -> str:
    """Return the comment of a line with a key and its value, and the blanks before it."""
    marks = (index for index, character in enumerate(line) if character == "#")
    for index in marks:
        with suppress(ValueError):
            toml_document(line[:index])
            return line[len(line[:index].rstrip()) :].rstrip("\n")
    return ""


def _places(document: Mapping[str, Any]) -> Iterator[KeyPath]:
    for section in SINGLE_SECTIONS:
        if section in document:
            yield (section,)
    for section in RECORD_SECTIONS:
        for index in range(len(document.get(section, ()))):
            yield section, index
