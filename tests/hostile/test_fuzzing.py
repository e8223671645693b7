"""Texts, dumps and requests that are nearly right are read or refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest
from hostile.fuzzing import fuzz
from support.long_cases import every


@pytest.mark.parametrize(("count", "seed"), every(2, [(1500, 20), (1_000_000, 21)]))
def test_inputs(tmp_path: Path, count: int, seed: int) -> None:
    assert sum(fuzz(count, seed, tmp_path).values()) == count
