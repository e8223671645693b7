"""What tests of stations look for in what orip says."""

from __future__ import annotations

import re

from cli.command_line import Said
from mistakes.first_line import DOCUMENT, diagnosis


def complaints(said: Said) -> int:
    return len(re.findall("^(?:error|warning): ", said.told, re.MULTILINE))


def assert_documented(title: str, first: str) -> None:
    row = f"| {title} | {diagnosis(first)} |\n"
    assert row in DOCUMENT.read_text(encoding="utf-8"), row
