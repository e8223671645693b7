"""Following the first sentence on a mistake leads to a block that converges and fits; see `mistakes.advice`."""

from __future__ import annotations

import pytest
from mistakes.advice import MISTAKES, followed

CASES = [
    ("position: digit", "ELE"), ("position: no fix", "STA"), ("position: axes of one", "STA"),
    ("position: axes of one", "ELE"), ("positions: two exchanged", "STA"), ("positions: two exchanged", "ELE"),
    ("positions: a strip", "STA"), ("positions: a strip", "ELE"), ("positions: moved by one", "ELE"),
    ("positions: zone", "ELE"), ("positions: errors in mm", "STA"), ("positions: errors in mm", "ELE"),
    ("positions: errors in cm", "STA"), ("positions: degrees", "ELE"), ("control: hyphens", "STA"),
    ("control: errors in mm", "STA"),
    ("control: wrong stone", ""), ("control: height off", "STA"), ("control: two exchanged", "ELE"),
]  # fmt: skip


@pytest.mark.parametrize(("mistake", "ending"), CASES)
def test_the_advice_mends_the_block(mistake: str, ending: str) -> None:
    assert ending in MISTAKES[mistake][0]
    found = followed(mistake, ending, 2)
    assert found.complaints == 1, "what follows from a mistake is no second complaint"
    assert found.can_be_followed, found.first
    assert found.is_well, found.after
