"""The page for people who read it with a screen reader, the keyboard, or eyes that need contrast (WCAG 2.1 AA)."""

from __future__ import annotations

import re
from collections import Counter
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from report.sample_pages import SAMPLES, sample

import orip.report

CSS = (Path(orip.report.__file__).parent / "page" / "report.css").read_text(encoding="utf-8")
ENOUGH_FOR_TEXT, ENOUGH_FOR_DRAWINGS = 4.5, 3.0
VOID = {"meta", "link", "br", "hr", "img", "input", "col"}


class Tags(HTMLParser):
    """The elements of a page with their attributes, and the text inside each."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None], list[str], tuple[str, ...]]] = []
        self._open: list[int] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        path = tuple(self.found[place][0] for place in self._open)
        self.found.append((tag, dict(attrs), [], path))
        if tag not in VOID:
            self._open.append(len(self.found) - 1)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs), [], tuple(self.found[place][0] for place in self._open)))

    def handle_endtag(self, tag: str) -> None:
        while self._open and self.found[self._open.pop()][0] != tag:
            pass

    def handle_data(self, data: str) -> None:
        for place in self._open:
            self.found[place][2].append(data)

    def of(self, *tags: str) -> list[tuple[str, dict[str, str | None], str, tuple[str, ...]]]:
        return [(tag, attrs, "".join(text).strip(), path) for tag, attrs, text, path in self.found if tag in tags]


@pytest.fixture(params=SAMPLES)
def tags(request: pytest.FixtureRequest) -> Tags:
    return Tags(sample(request.param).page)


def test_language_title_and_one_main_part(tags: Tags) -> None:
    ((_, html, _, _),) = tags.of("html")
    assert html["lang"] == "en"
    assert all(text for _, _, text, path in tags.of("title") if path[-1] == "head")
    assert len(tags.of("main")) == 1
    assert all(
        attrs.get("name") != "viewport" or "user-scalable" not in str(attrs) for _, attrs, _, _ in tags.of("meta")
    )


def test_headings_have_text_and_leave_no_level_out(tags: Tags) -> None:
    headings = tags.of("h1", "h2", "h3", "h4", "h5", "h6")
    assert all(text for _, _, text, _ in headings)
    levels = [int(tag[1]) for tag, _, _, _ in headings]
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_tables_have_names_and_headings_with_a_scope(tags: Tags) -> None:
    tables = [attrs for _, attrs, _, _ in tags.of("table")]
    assert tables
    captions = [text for _, _, text, _ in tags.of("caption") if text]
    assert len(captions) + len([attrs for attrs in tables if attrs.get("aria-label")]) == len(tables)
    headings = tags.of("th")
    assert all(attrs.get("scope") in {"col", "row"} for _, attrs, _, _ in headings)
    assert all(text for _, attrs, text, _ in headings if attrs.get("scope") == "col")


def test_drawings_say_what_they_show(tags: Tags) -> None:
    for _, attrs, text, path in tags.of("svg"):
        if "svg" in path:  # a part of the drawing around it
            continue
        is_hidden = attrs.get("aria-hidden") == "true"
        assert is_hidden or (attrs.get("role") == "img" and (attrs.get("aria-label") or "<title" in text)), attrs
    assert all(attrs.get("alt") is not None for _, attrs, _, _ in tags.of("img"))


def test_what_is_operated_has_a_name(tags: Tags) -> None:
    labelled = {attrs.get("for") for _, attrs, _, _ in tags.of("label")}
    for _, attrs, text, path in tags.of("button", "a", "select", "input", "textarea", "summary"):
        assert text or attrs.get("aria-label") or attrs.get("title") or attrs.get("id") in labelled or "label" in path
    assert all(attrs.get("tabindex") in {None, "0", "-1"} for _, attrs, _, _ in tags.found)


def test_ids_are_unique_and_links_inside_lead_somewhere(tags: Tags) -> None:
    ids = Counter(attrs["id"] for _, attrs, _, _ in tags.found if attrs.get("id"))
    assert [name for name, count in ids.items() if count > 1] == []
    inside = [str(attrs["href"])[1:] for _, attrs, _, _ in tags.of("a") if str(attrs.get("href")).startswith("#")]
    assert set(inside) <= {*ids, "", "top"}


def _colours(block: str) -> dict[str, str]:
    return dict(re.findall(r"--([a-z]+): (#[0-9a-f]{6})", block))


def _luminance(colour: str) -> float:
    parts = [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """Return the ratio of WCAG 2.1: 1 for equal colours, 21 for black on white."""
    low, high = sorted([_luminance(one), _luminance(other)])
    return (high + 0.05) / (low + 0.05)


def test_the_ratio_is_that_of_the_recommendation() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    # the grey that is known as the lightest with 4.5 on white
    assert contrast("#767676", "#ffffff") == pytest.approx(4.54, abs=0.005)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_stand_out_from_what_is_behind_them(scheme: str) -> None:
    light, dark = CSS.split("@media (prefers-color-scheme: dark)", 1)
    colours = _colours(light) if scheme == "light" else _colours(dark.split("\n* {")[0])
    for text in ("ink", "soft", "link"):
        for behind in ("paper", "panel"):
            assert contrast(colours[text], colours[behind]) >= ENOUGH_FOR_TEXT, (text, behind)
    for drawn in ("good", "caution", "bad", "first", "second", "third", "photo", "control", "check", "rejected", "tie"):
        assert contrast(colours[drawn], colours["paper"]) >= ENOUGH_FOR_DRAWINGS, drawn
