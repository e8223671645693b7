"""What the README shows is what orip says."""

from __future__ import annotations

import re
from pathlib import Path

from cli.command_line import orip
from workflow.small_projects import REPOSITORY, first_project, replace_in

SESSIONS = re.findall(r"```console\n(.*?)```", (REPOSITORY / "README.md").read_text(encoding="utf-8"), re.DOTALL)


def shown(session: str) -> list[tuple[list[str], str]]:
    """Return the commands of a session and what they say, lines put together again that the page breaks."""
    parts = re.split(r"^\$ orip (.*)\n", session, flags=re.MULTILINE)
    return [(words.split(), text) for words, text in zip(parts[1::2], parts[2::2], strict=True)]


def in_words(text: str) -> str:
    return re.sub(r"\(\d+\.\d MB\)", "(MB)", " ".join(text.split()))  # the page has plotly in it, of any version


def test_the_first_project(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    commands = shown(SESSIONS[0])
    assert [words[0] for words, _text in commands] == ["run", "results", "status"]
    for words, text in commands:
        said = orip(folder, *words)
        whole = in_words(said.out + said.err)
        expected = in_words(text)
        if expected.endswith(" ..."):
            assert whole.startswith(expected.removesuffix("..."))
        else:
            assert whole == expected


def test_mistakes_are_told_at_once(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    replace_in(folder / "FIRST.PNT", "1012.40 ", "1012,40 ")
    replace_in(folder / "FIRST.PNT", "2012.70", "2012.7O")
    ((words, text),) = shown(SESSIONS[1])
    assert orip(folder, *words).err == text
