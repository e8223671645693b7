"""Following the first sentence on a mistake leads to a block that converges and fits; see `mistakes.advice`."""

from __future__ import annotations

import pytest
from mistakes.advice import MISTAKES, followed
from support.long_cases import every

CASES = [
    ("position: axes of one", "STA"), ("position: axes of one", "ELE"),
    ("positions: two exchanged", "STA"), ("positions: two exchanged", "ELE"),
    ("positions: a strip", "STA"), ("positions: a strip", "ELE"),
    ("positions: errors in mm", "STA"), ("positions: errors in mm", "ELE"),
    ("position: digit", "ELE"), ("positions: errors in cm", "STA"),
    ("position: no fix", "STA"), ("positions: zone", "ELE"),
    ("positions: moved by one", "ELE"), ("positions: degrees", "ELE"),
    ("control: hyphens", "STA"), ("control: errors in mm", "STA"),
    ("control: wrong stone", ""), ("control: height off", "STA"), ("control: two exchanged", "ELE"),
]  # fmt: skip


@pytest.mark.parametrize(("mistake", "ending"), every(2, CASES))
def test_the_advice_mends_the_block(mistake: str, ending: str) -> None:
    assert ending in MISTAKES[mistake][0]
    found = followed(mistake, ending, 2)
    assert found.complaints == 1, "what follows from a mistake is no second complaint"
    assert found.can_be_followed, found.first
    assert found.is_well, found.after
