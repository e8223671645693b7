"""Links to files, and names of programs and tests: what they name is there.

Links to headings are looked at when the pages are built.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from documentation.pages import REPOSITORY, pages, shown

PROGRAM = re.compile(r"`((?:[\w-]+/)+[\w-]+\.(?:py|c|h))`")
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


def texts() -> list[Path]:
    return [*pages(), *sorted((REPOSITORY / "sample_projects").rglob("*.md"))]


@pytest.mark.parametrize("page", texts(), ids=shown)
def test_relative_links_lead_somewhere(page: Path) -> None:
    targets = [target for target in LINK.findall(page.read_text(encoding="utf-8")) if "://" not in target]
    assert [target for target in targets if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", pages(), ids=shown)
def test_programs_that_are_named_exist(page: Path) -> None:
    places = [REPOSITORY, REPOSITORY / "tests", REPOSITORY / "orip"]
    named = PROGRAM.findall(page.read_text(encoding="utf-8"))
    assert [name for name in named if not any((place / name).exists() for place in places)] == []
