"""Every `orip ...` that is named anywhere in the documentation exists, with its options and keys.

The table of all commands names every one that there is.
"""

from __future__ import annotations

import itertools
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from command_tree import SHARED, commands, is_group, options_of
from documentation.pages import DOCS, pages, shown

from orip.cli.results import What
from orip.files.control.editing import FORMS
from orip.files.project.tables import keys_of as keys_of_table
from orip.files.project.tables import table_of
from orip.records.definition import RECORD_TYPES

INLINE = re.compile(r"`(orip\b[^`]*)`")
"""May go over the end of a line."""

FENCED = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
LINE = re.compile(r"^(?:\$ |- run: |<!-- \$ )?(orip (?!is |\d).*?)(?: -->)?$")
"""A command that is a line of its own in a block."""

PLACEHOLDER = re.compile(r"[A-Z]+|\.\.\.|…|--help|-h")


def named_commands(text: str) -> Iterator[list[str]]:
    """Yield the words of each command in a text, without ``orip``; ``a|b`` is both."""
    blocks = [line for block in FENCED.findall(text) for line in block.splitlines()]
    blocks += [line.strip() for line in text.splitlines() if line.startswith(("    orip ", "<!-- $ orip "))]
    found = [match[1] for line in blocks if (match := LINE.match(line))] + INLINE.findall(FENCED.sub("", text))
    for command in found:
        line = " ".join(command.replace("\\|", "|").split())
        yield from alternatives(shlex.split(re.split(r" (?:&|&&|>)(?: |$)|; ", line)[0])[1:])


def alternatives(words: list[str]) -> Iterator[list[str]]:
    """Yield the command lines that one with ``a|b`` among its commands stands for."""
    choices = [word.split("|") if re.fullmatch(r"[a-z|-]+", word) else [word] for word in words]
    yield from map(list, itertools.product(*choices))


def fault_of(words: list[str]) -> str | None:
    """Return what is wrong with a command line, or None."""
    found = commands()
    rest, group = list(words), ""
    while rest and rest[0].startswith("-"):
        if rest[0] not in SHARED | {"-C", "-q", "-v", "--version", "--help", "-h"}:
            return f"orip has no option {rest[0]}"
        rest = rest[2:] if rest[0] in {"-C", "--color", "--threads"} else rest[1:]
    while rest and (not group or is_group(found[group])) and not PLACEHOLDER.fullmatch(rest[0]):
        name = f"{group} {rest[0]}".strip()
        if name not in found:
            return None if rest[0].startswith("-") else f"there is no command 'orip {name}'"
        group, rest = name, rest[1:]
    return fault_of_arguments(group, rest) if group else None


def fault_of_arguments(name: str, words: list[str]) -> str | None:
    known = options_of(commands()[name]) | {"--help", "-h"}
    options = [word for word in words if re.fullmatch(r"--?[a-z][a-z0-9-]*", word)]
    unknown = [word for word in options if word not in known]
    keys = [word.partition("=")[0].partition(".")[0] for word in words if re.match(r"[A-Za-z][\w.]*=", word)]
    editable = keys_of(name)
    unknown += [f"{key}=" for key in keys if editable and key not in editable]
    return f"'orip {name}' takes no {', '.join(unknown)}" if unknown else None


def keys_of(name: str) -> list[str]:
    """Return the keys that a command edits."""
    kind, _, rest = name.partition(" ")
    if kind == "control" and rest:
        return list(FORMS[rest.partition(" ")[0]].keys)  # type: ignore[index]
    return keys_of_table(table_of(RECORD_TYPES[kind])) if kind in RECORD_TYPES else []


@pytest.mark.parametrize("page", pages(), ids=shown)
def test_commands_and_options_exist(page: Path) -> None:
    found = named_commands(page.read_text(encoding="utf-8"))
    assert [f"orip {' '.join(words)}: {fault}" for words in found if (fault := fault_of(words))] == []


def missing_in(table: str) -> list[str]:
    """Return the commands, those of groups too, that no line of a table names; groups alone need no line."""
    named = {" ".join(words[: index + 1]) for words in named_commands(table) for index in range(len(words))}
    return [name for name, command in commands().items() if not is_group(command) and name not in named]


def rows_of(page: Path) -> str:
    """Return the rows of a page's tables that begin with a command."""
    return "\n".join(line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| `orip "))


def test_the_table_of_commands_names_every_one() -> None:
    assert missing_in(rows_of(DOCS / "reference" / "commands" / "index.md")) == []


def test_a_command_that_the_table_lacks_is_found() -> None:
    names = [name for name, command in commands().items() if not is_group(command)]
    lines = [f"| `orip {name}` | |" for name in names]
    assert missing_in("\n".join(lines)) == []
    assert missing_in("\n".join(lines[1:])) == names[:1]
    assert "digitise ticks" in missing_in("| `orip digitise template\\|photo` | |")


def test_tables_of_commands_have_all_kinds_of_results() -> None:
    words = [words for page in pages() for words in named_commands(rows_of(page)) if words[:1] == ["results"]]
    assert {word for _, word, *_ in words} == set(get_args(get_args(What)[0]))


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("`orip solve --snooop`", "'orip solve' takes no --snooop"),
        ("`orip slove`", "there is no command 'orip slove'"),
        ("`orip camera|foto list`", "there is no command 'orip foto'"),
        ("```console\n$ orip -C x prelim absolut\n```", "there is no command 'orip prelim absolut'"),
        ("`orip camera edit C c=8 unknwon=C`", "'orip camera edit' takes no unknwon="),
        ("`orip -C x --quiet run`", None),
        ("    orip observations kill point 101 '*' --yes", None),
    ],
)
def test_what_is_wrong_is_found(line: str, fault: str | None) -> None:
    assert [found for words in named_commands(line) if (found := fault_of(words))] == ([fault] if fault else [])
