"""Links to the glossary: on every page the first use of each of its terms in running text leads there."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.nodes import make_refnode

NOT_RUNNING_TEXT = (
    nodes.title,
    nodes.term,
    nodes.reference,
    nodes.literal,
    nodes.literal_block,
    nodes.math,
    nodes.math_block,
    nodes.raw,
    nodes.comment,
    nodes.rubric,
)
UNLINKED_PAGES = ("glossary", "changelog")


def setup(app: Sphinx) -> dict[str, Any]:
    """Link the pages when their references are resolved: then the glossary has been read."""
    app.connect("doctree-resolved", link_terms)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def link_terms(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    """Turn the first use of each term on a page into a link to the glossary."""
    if docname in UNLINKED_PAGES or app.builder.name == "man":  # paper has no links
        return
    places = glossary_places(app)
    unused = dict(places)
    for text in list(doctree.findall(nodes.Text)):
        if unused and _is_running(text):
            parts = [_part(app, docname, places, part) for part in split_at_terms(str(text), unused)]
            text.parent.replace(text, parts)


def glossary_places(app: Sphinx) -> dict[str, tuple[str, str]]:
    """Return page and anchor of each term."""
    objects = app.env.get_domain("std").get_objects()
    return {name: (page, anchor) for name, _, kind, page, anchor, _ in objects if kind == "term"}


def split_at_terms(text: str, unused: dict[str, Any]) -> Iterator[str]:
    """Yield a text in parts, terms at their first use among them; these leave `unused`.

    A term counts in singular and plural, with a capital letter at the beginning of a sentence, and over the end of a
    line; where terms overlap, the longest does.
    """
    rest = text
    while unused:
        terms = "|".join(r"\s".join(map(re.escape, term.split())) for term in sorted(unused, key=len, reverse=True))
        found = re.search(rf"(?<![\w-])(?:{terms})(?:s|(?<=s)es)?(?![\w-])", rest, re.IGNORECASE)
        if not found:
            break
        if found.start():
            yield rest[: found.start()]
        yield found[0]
        del unused[term_of(found[0], unused)]
        rest = rest[found.end() :]
    if rest:
        yield rest


def term_of(words: str, terms: Mapping[str, Any]) -> str:
    """Return the term that some words are.

    Raises
    ------
    KeyError
        If they are none.
    """
    said = " ".join(words.split()).lower()
    by_letters = {term.lower(): term for term in terms}
    for ending in ("", "s", "es"):
        if said.endswith(ending) and said.removesuffix(ending) in by_letters:
            return by_letters[said.removesuffix(ending)]
    raise KeyError(words)


def _is_running(text: nodes.Text) -> bool:
    node: Any = text.parent
    while node is not None:
        if isinstance(node, NOT_RUNNING_TEXT):
            return False
        node = node.parent
    return True


def _part(app: Sphinx, docname: str, places: Mapping[str, tuple[str, str]], part: str) -> nodes.Node:
    try:
        page, anchor = places[term_of(part, places)]
    except KeyError:
        return nodes.Text(part)
    link = make_refnode(app.builder, docname, page, anchor, nodes.Text(part))
    link["classes"] += ["term"]
    return link
