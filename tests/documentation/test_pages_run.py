"""What the pages tell a reader to do is done, in their order, and prints what they show."""

from __future__ import annotations

from pathlib import Path

import pytest
from documentation.pages import Step, pages, shown, steps
from documentation.reader import Reader, agrees

RUN = [page for page in pages() if any(step.is_run for step in steps(page))]


@pytest.mark.parametrize("page", RUN, ids=shown)
def test_commands_print_what_the_page_shows(page: Path, tmp_path: Path) -> None:
    reader = Reader(tmp_path)
    differences = []
    try:
        for step in steps(page):
            printed = reader.do(step)
            if step.printed is not None and not agrees(step.printed, printed):
                differences.append(_difference(page, step, printed))
    finally:
        reader.leave()
    assert reader.exit_code == 0, f"the last command of {shown(page)} ended with exit code {reader.exit_code}"
    assert not differences, "\n".join(differences)


def test_an_ellipsis_stands_for_lines_and_for_text() -> None:
    assert agrees(("a", "...", "d"), "a\nb\nc\nd\n")
    assert agrees(("a", "...", "d"), "a\nd\n")
    assert agrees(("wrote (... MB)",), "wrote (2.2 MB)\n")
    assert not agrees(("a", "..."), "b\na\n")
    assert not agrees(("wrote (... MB)",), "wrote (2.2\nMB)\n")
    assert agrees((), "")
    assert not agrees((), "something\n")


def _difference(page: Path, step: Step, printed: str) -> str:
    expected = "\n".join(step.printed or ())
    return f"{shown(page)}:{step.line}: {step.typed}\n--- shown\n{expected}\n--- printed\n{printed}"
