"""Parts of the reference that are written from the program when the pages are built.

``{orip-commands} WORDS`` describes a command, and all commands below it if it is a group; ``{orip-options}`` the
options that every command takes; ``{orip-gates}`` the figures that a gate may be about; ``{orip-formats}`` the formats
of other programs; ``{orip-documents}`` the documents that commands print with ``--json``.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import typer
from command_tree import SHARED, commands, documents, is_group, program
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from orip.exchange.formats import FORMATS
from orip.records.results.tests import GATE_FIGURES


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("orip-commands", CommandsDirective)
    app.add_directive("orip-options", OptionsDirective)
    app.add_directive("orip-gates", GatesDirective)
    app.add_directive("orip-formats", FormatsDirective)
    app.add_directive("orip-documents", DocumentsDirective)
    app.connect("env-before-read-docs", _read_again)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _read_again(_app: Sphinx, env: Any, docnames: list[str]) -> None:
    """Have the pages with these directives read each time: the program may have changed, which Sphinx cannot see."""
    docnames += [name for name in env.found_docs if name.startswith("reference/") and name not in docnames]


class CommandsDirective(SphinxDirective):
    """Describe the commands that begin with the given words."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Return a section for each command."""
        wanted = " ".join(self.arguments[0].split())
        found = {words: command for words, command in commands().items() if f"{words} ".startswith(f"{wanted} ")}
        if not found:
            message = f"orip has no command '{wanted}'"
            raise self.error(message)
        text = "\n".join(line for words, command in found.items() for line in _section(words, command))
        return self.parse_text_to_nodes(text, allow_section_headings=True)


class OptionsDirective(SphinxDirective):
    """Describe the options of the program itself, most of which every command takes."""

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        whole = program()
        wanted = SHARED | {"--project", "--version"}
        lines = _parameters(whole, typer.Context(whole), lambda parameter: bool(wanted & set(parameter.opts)))
        return self.parse_text_to_nodes("\n".join(lines))


class GatesDirective(SphinxDirective):
    """List the figures that gates may be about."""

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        rows = [(f"`{name}`", meaning) for name, meaning in GATE_FIGURES.items()]
        return self.parse_text_to_nodes("\n".join(_table(("figure", "meaning"), rows)))


class FormatsDirective(SphinxDirective):
    """List the formats of other programs."""

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        said = {True: "yes", False: "no"}
        rows = [
            (f"`{one.name}`", one.title, said[one.read is not None], said[one.write is not None]) for one in FORMATS
        ]
        return self.parse_text_to_nodes("\n".join(_table(("format", "program", "import", "export"), rows)))


class DocumentsDirective(SphinxDirective):
    """List the documents for programs."""

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        return self.parse_text_to_nodes("\n".join(_table(("schema", "written by", "content"), documents())))


def _section(words: str, command: Any) -> Iterator[str]:
    """Yield the section of a command; one of a group is a level below the group."""
    about, label, example = re.split(r"(\bExamples?:|$)", inspect.cleandoc(command.help or ""), maxsplit=1)
    context = typer.Context(command)
    yield f"(command-{words.replace(' ', '-')})="
    yield f"{'#' * (words.count(' ') + 2)} `orip {words}`\n"
    yield about.strip() + "\n"
    if not is_group(command) or command.invoke_without_command:
        pieces = " ".join(map(_plain, command.collect_usage_pieces(context)))
        yield f"```text\norip {words} {pieces}\n```\n"
    yield from _parameters(command, context, lambda parameter: not SHARED & set(parameter.opts))
    if example:
        yield f"{label} `{' '.join(example.split())}`\n"


def _parameters(command: Any, context: Any, is_wanted: Callable[[Any], bool]) -> Iterator[str]:
    """Yield a table of parameters as `--help` has them."""
    rows = []
    for parameter in filter(is_wanted, command.params):
        if record := parameter.get_help_record(context):
            spelling, meaning = record
            is_argument = parameter.param_type_name == "argument"  # with the allowed words behind it, if these are few
            rows.append((f"`{_plain(spelling.partition(' <')[0]) if is_argument else spelling}`", meaning))
    if rows:
        yield from _table(("", "meaning"), rows)


def _plain(piece: str) -> str:
    """Return an argument as books write it: brackets once, and no braces."""
    return piece.replace("{", "").replace("}", "").replace("[[", "[").replace("]]", "]")


def _table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield "| " + " | ".join(heading) + " |"
    yield "|---" * len(heading) + "|"
    for cells in rows:
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
    yield ""
