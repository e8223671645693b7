"""The page for those who know ORIPROGRAM has every menu of the manual (Dueholm 1989), and every key of each."""

from __future__ import annotations

import re

import pytest
from documentation.pages import DOCS
from support.menus_of_the_manual import COMMON_KEYS, MENUS


def sections() -> dict[str, str]:
    """Return the sections of the page by the number of their menu."""
    text = (DOCS / "oriprogram.md").read_text(encoding="utf-8")
    return {body.split(maxsplit=1)[0]: body for body in re.split(r"^#+ ", text, flags=re.MULTILINE) if body}


def answers(section: str) -> dict[str, str]:
    """Return what is said of each key of a section."""
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", section, re.MULTILINE)
    return {key: answer for keys, answer in rows for key in (keys, *keys.split(", "))}


@pytest.mark.parametrize("menu", MENUS)
def test_every_key_has_an_answer(menu: str) -> None:
    found = answers(sections()[menu])
    assert [key for key in MENUS[menu] if not any(key == word or word.startswith(f"{key} (") for word in found)] == []


def test_no_menu_is_made_up() -> None:
    assert [number for number in sections() if number[0].isdigit()] == list(MENUS)


def test_keys_of_all_menus() -> None:
    assert set(COMMON_KEYS) <= {key.partition(" (")[0] for key in answers(sections()["Keys"])}
