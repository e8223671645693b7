"""Texts, dumps and requests that are nearly right are read or refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest
from hostile.fuzzing import fuzz


def test_some_inputs(tmp_path: Path) -> None:
    assert sum(fuzz(1500, 20, tmp_path).values()) == 1500


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
def test_a_million_inputs(tmp_path: Path) -> None:
    assert sum(fuzz(1_000_000, 21, tmp_path).values()) == 1_000_000
