"""The glossary: its terms are in order and in use, and pages lead to them."""

from __future__ import annotations

import re

import pytest
from documentation.pages import pages
from glossary_links import split_at_terms, term_of
from workflow.small_projects import REPOSITORY

GLOSSARY = REPOSITORY / "docs" / "glossary.md"
PARTS = re.findall(r"```\{glossary\}\n(.*?)```", GLOSSARY.read_text(encoding="utf-8"), re.DOTALL)


def terms_of(part: str) -> list[str]:
    return [line for line in part.splitlines() if line and not line.startswith(" ")]


TERMS = [term for part in PARTS for term in terms_of(part)]


def test_terms_are_in_alphabetical_order() -> None:
    assert len(PARTS) == 2
    for part in PARTS:
        assert terms_of(part) == sorted(terms_of(part), key=str.lower)
    assert len(set(TERMS)) == len(TERMS) > 60


@pytest.mark.parametrize("term", TERMS)
def test_a_term_is_used_on_a_page(term: str) -> None:
    words = r"\s+".join(map(re.escape, term.split()))
    used = re.compile(rf"\b{words}", re.IGNORECASE)
    texts = [page.read_text(encoding="utf-8") for page in pages() if page != GLOSSARY]
    assert any(used.search(text) for text in texts)


def test_the_longest_term_is_linked_once_in_singular_or_plural_and_over_a_line_end() -> None:
    unused = dict.fromkeys(["redundancy", "redundancy number", "tie point"])
    text = "Tie points have redundancy\nnumbers; a tie point adds redundancy, as redundancies do."
    assert list(split_at_terms(text, unused)) == [
        "Tie points",
        " have ",
        "redundancy\nnumbers",
        "; a tie point adds ",
        "redundancy",
        ", as redundancies do.",
    ]
    assert unused == {}


def test_words_that_only_contain_a_term_are_left_alone() -> None:
    unused = dict.fromkeys(["block", "strip"])
    assert list(split_at_terms("building-block, blocked, stripes", unused)) == ["building-block, blocked, stripes"]
    assert set(unused) == {"block", "strip"}


def test_plurals_belong_to_their_term() -> None:
    assert term_of("Tie\n points", ["tie point"]) == "tie point"
    with pytest.raises(KeyError):
        term_of("point", ["tie point"])
