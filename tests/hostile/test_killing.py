"""Ten thousand kills of all commands that write: no store is lost, no text is half written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(os.name != "posix", reason="processes are forked"),
    pytest.mark.timeout(6 * 3600),
]


def test_ten_thousand_kills(tmp_path: Path) -> None:
    from hostile.killing import COMMANDS, DIGITISING, digitising, kills

    with digitising(tmp_path) as url:
        killed = kills(10_000, 3, tmp_path, (*COMMANDS, *DIGITISING), url)
    # some come too late, as the machine's speed varies; half of them at least must have hit
    assert sum(killed.values()) > 5_000
