"""Blocks in which nothing is wrong but chance, a-priori errors and preliminary values: orip suspects nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mistakes.simulated import explained
from support.long_cases import in_turn
from support.synthetic_block import Scene, synthetic_block

NOISE_MM = 0.005

ROUGH: dict[str, dict[str, Any]] = {
    "sound": {},
    "errors too large": {"noise_mm": NOISE_MM / 2.0},
    "errors too small": {"noise_mm": 3.0 * NOISE_MM},
    "rough start": {"start_error": 0.1},
}


@pytest.mark.parametrize(("kind", "scene"), in_turn(ROUGH, ["strip", "convergent", "terrestrial"]))
def test_chance_is_no_mistake(kind: str, scene: Scene) -> None:
    # with constant control too where nothing has to be explained, which takes seconds
    for control in ("weighted",) if kind == "errors too small" else ("weighted", "constant"):
        settings = {"noise_mm": NOISE_MM, "control": control, **ROUGH[kind]}
        assert explained(synthetic_block(scene, f"{scene} {control} {kind}", **settings).block) == []


@pytest.mark.long
@pytest.mark.parametrize("scene", ["strip", "convergent", "terrestrial"])
@pytest.mark.parametrize("kind", ROUGH)
def test_chance_is_no_mistake_in_a_hundred_blocks(scene: Scene, kind: str) -> None:
    said = [
        warning
        for number in range(100)
        for warning in explained(
            synthetic_block(
                scene,
                f"{kind} {number}",
                **{"noise_mm": NOISE_MM, "control": ("weighted", "constant")[number % 2], **ROUGH[kind]},
            ).block
        )
    ]
    # blunders by chance: a standard residual above 5 is rare, but there are some fifteen thousand
    assert np.count_nonzero([warning.code != "blunder" for warning in said]) == 0
