"""Blunders planted in published blocks: the first line names them, and of the blocks as they are nothing is said."""

from __future__ import annotations

from functools import cache

import pytest
from mistakes.planted.blunders import KINDS, judged, planted_in, said_of, sound_block
from mistakes.planted.published import PUBLISHED

NAMED = [
    ("dcs weighted", "control: two points exchanged", 1),
    ("dcs constant", "photo mirrored", 0),
    ("dcs constant", "x for y in a photo", 0),
    pytest.param("zurich constant", "photo mirrored", 0, marks=pytest.mark.long),
    ("zurich weighted", "two numbers for one point", 0),
    ("olympus calibrated", "two numbers for one point", 0),
    ("olympus calibrated", "photo twice", 0),
    pytest.param("olympus weighted", "photo mirrored", 0, marks=pytest.mark.long),
    ("olympus constant", "photo coordinate off", 0),
    ("sceaux", "photo twice", 0),
    ("sceaux", "control: two points exchanged", 0),
    ("sceaux", "control: X for Y", 0),
    ("strasbourg stations", "camera constant", 0),
    ("strasbourg stations", "another lens", 0),
    ("strasbourg stations", "check point", 0),
    pytest.param("strasbourg thinned", "another lens", 0, marks=pytest.mark.long),
]


@cache
def said_of_sound(block_name: str) -> list[str]:
    sound, _ = sound_block(block_name)
    return said_of(sound)


@pytest.mark.parametrize(("block_name", "kind", "place"), NAMED)
def test_a_blunder_in_a_published_block_is_named_first(block_name: str, kind: str, place: int) -> None:
    sound, _ = sound_block(block_name)
    block, truth = planted_in(sound, block_name, kind, place)
    assert truth is not None
    said = [line for line in said_of(block) if line not in said_of_sound(block_name)]
    assert judged(said, truth, KINDS[kind].subjects) == "named", said[:2]


@pytest.mark.parametrize(
    "block_name",
    [pytest.param(name, marks=pytest.mark.long if name == "zurich constant" else ()) for name in PUBLISHED],
)
def test_of_published_blocks_as_they_are_nothing_is_accused(block_name: str) -> None:
    assert [line for line in said_of_sound(block_name) if not line.endswith("misfits")] == []


def test_a_control_point_whose_exchange_is_named_is_not_accused_by_a_group() -> None:
    sound, _ = sound_block("sceaux")
    block, _ = planted_in(sound, "sceaux", "control: two points exchanged", 0)
    assert not [found for found in block.block().adjust().diagnosis if found.code == "group"]
