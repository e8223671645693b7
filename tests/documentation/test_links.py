"""Links to files: what they name is there. Links to headings are looked at when the pages are built."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from documentation.pages import REPOSITORY, pages, shown

LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


def texts() -> list[Path]:
    return [*pages(), *sorted((REPOSITORY / "orip" / "sample_projects").rglob("*.md"))]


@pytest.mark.parametrize("page", texts(), ids=shown)
def test_relative_links_lead_somewhere(page: Path) -> None:
    targets = [target for target in LINK.findall(page.read_text(encoding="utf-8")) if "://" not in target]
    assert [target for target in targets if not (page.parent / target).exists()] == []
