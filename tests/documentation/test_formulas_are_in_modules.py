"""The page of formulas leads to the code: each section names functions, and the modules that define them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from documentation.pages import DOCS

PAGE = DOCS / "formulas.md"
CODE = re.compile(r"\[(\w+)\]\((\.\./orip/[\w/]+\.(?:py|h))\)")
HEADING = re.compile(r"^#{2,3} ", flags=re.MULTILINE)
WITHOUT_FORMULAS = {"Sources"}


def named() -> list[tuple[str, str]]:
    return CODE.findall(PAGE.read_text(encoding="utf-8"))


@pytest.mark.parametrize(("name", "target"), named(), ids=lambda value: Path(value).stem)
def test_the_module_defines_what_is_named(name: str, target: str) -> None:
    path = PAGE.parent / target
    begins = r"(?:static )?[\w ]+ \*?" if path.suffix == ".h" else r"(?:def |class )?"
    text = path.read_text(encoding="utf-8")
    assert re.search(rf"^{begins}{name}(?:\(|:|\b)", text, flags=re.MULTILINE), f"{path.name} does not define {name}"


def test_every_section_leads_to_its_code() -> None:
    _, *sections = HEADING.split(PAGE.read_text(encoding="utf-8"))
    bare = {section.splitlines()[0] for section in sections if not CODE.search(section)}
    assert bare == WITHOUT_FORMULAS


def test_every_paragraph_of_preliminary_values_leads_to_its_code() -> None:
    text = PAGE.read_text(encoding="utf-8").partition("## Preliminary values")[2].partition("\n## ")[0]
    terms = re.split(r"\n: ", text)[1:]
    assert terms
    assert all(CODE.match(term) for term in terms)
