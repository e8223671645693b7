"""Pages of the documentation as text: their blocks, their links, and the commands that they name.

A block is fenced with three backticks. It is

- **run**, if its language is ``console``: lines that begin with ``$ `` are commands, and what follows each is what it
  prints: a line ``...`` stands for any lines, ``...`` within a line for any text, and a long message may be broken as
  on a terminal;
- **a file**, if it has a ``:caption:`` (``{code-block} toml``), or if the paragraph before it begins with the file's
  name: ```FIRST.PNT` -- ground control``.

A comment ``<!-- $ command -->`` is run too, and not shown. Files of a page that is included are written as well.
"""

from __future__ import annotations

import doctest
import re
from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct

REPOSITORY = Path(__file__).parents[2]
DOCS = REPOSITORY / "docs"

_FENCE = re.compile(r"^```(?:\{code-block\} *)?([\w-]*) *$")
_CAPTION = re.compile(r"^:caption: +(\S+)$")
_NAMED = re.compile(r"^`([^`/ ]+\.[A-Za-z]+)` --")
_INCLUDED = re.compile(r"^```\{include\} (\S+)$")
_HIDDEN = re.compile(r"^<!-- \$ (.+) -->$")
_PROMPT = "$ "


class Step(Struct, frozen=True):
    """One thing that a reader of the page does.

    Parameters
    ----------
    line : int
        Where it stands in the page.
    command : str
        A command; empty where a file is written.
    printed : tuple of str or None
        What the page shows of the command's output; None: nothing is said about it.
    file, text : str
        A file and what is in it.
    statement : str
        A statement of Python; empty where a command is run or a file is written.
    """

    line: int
    command: str = ""
    printed: tuple[str, ...] | None = ()
    file: str = ""
    text: str = ""
    statement: str = ""

    @property
    def is_run(self) -> bool:
        """Tell whether something is run, and not written alone."""
        return bool(self.command or self.statement)

    @property
    def typed(self) -> str:
        """Return what the reader types, after its prompt."""
        return f"$ {self.command}" if self.command else f">>> {self.statement.rstrip()}"


def pages() -> list[Path]:
    """Return all pages: those of `docs`, and the texts beside it."""
    return [*sorted(DOCS.rglob("*.md")), *sorted(REPOSITORY.glob("*.md"))]


def shown(page: Path) -> str:
    """Return a page as the repository names it."""
    return page.relative_to(REPOSITORY).as_posix()


def steps(page: Path) -> Iterator[Step]:
    """Yield what a reader of a page does, in order."""
    paragraph = language = caption = ""
    lines: list[str] = []
    start = 0
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        if included := _INCLUDED.match(line):
            yield from (step for step in steps(page.parent / included[1]) if step.file)
            language, lines = "include", []
        elif language:
            if line == "```":
                yield from _block(language, caption, lines, start)
                language = ""
            elif (found := _CAPTION.match(line)) and not lines:
                caption = found[1]
            else:
                lines.append(line)
        elif fence := _FENCE.match(line):
            named = _NAMED.match(paragraph)
            language, caption, lines, start = fence[1] or "text", named[1] if named else "", [], number
            paragraph = ""
        elif hidden := _HIDDEN.match(line):
            yield Step(number, hidden[1], None)
        elif line.strip():
            paragraph = paragraph or line
        else:
            paragraph = paragraph if _NAMED.match(paragraph) else ""


def _block(language: str, caption: str, lines: list[str], start: int) -> Iterator[Step]:
    if caption:
        yield Step(start, file=caption, text="".join(f"{line}\n" for line in lines).lstrip("\n"))
    elif language == "console":
        prompts = [index for index, line in enumerate(lines) if line.startswith(_PROMPT)]
        for index, following in zip(prompts, [*prompts[1:], len(lines)], strict=True):
            printed = tuple(lines[index + 1 : following])
            yield Step(start + index + 1, lines[index].removeprefix(_PROMPT), printed)
    elif language == "pycon":
        for example in doctest.DocTestParser().get_examples("".join(f"{line}\n" for line in lines)):
            last = start + example.lineno + example.source.count("\n")
            yield Step(last, printed=tuple(example.want.splitlines()), statement=example.source)
