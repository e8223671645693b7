"""Ten thousand kills of all commands that write: no store is lost, no text is half written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hostile.killed_commands import KILLED, OF_ARCHIVES, ONLY_READING, UNTIL_A_SIGNAL, WHOLE_TEXTS
from typer.main import get_command

from orip.cli.main import app


def commands(group: Any, *words: str) -> Iterator[str]:
    """Yield the words of all commands of a group; those of late groups are only there when they are asked for."""
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "list_commands"):
            yield from commands(command, *words, name)
        else:
            yield " ".join((*words, name))


def test_every_command_is_killed_or_only_reads() -> None:
    killed = {name for _, words in KILLED for name in (" ".join(words.split()[:n]) for n in (1, 2, 3))}
    known = set(commands(get_command(app)))
    not_killed = ONLY_READING | UNTIL_A_SIGNAL | OF_ARCHIVES | WHOLE_TEXTS
    assert known >= not_killed
    assert known - killed - not_killed == set()
    assert not killed & ONLY_READING


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="processes are forked")
@pytest.mark.timeout(6 * 3600)
def test_ten_thousand_kills(tmp_path: Path) -> None:
    from hostile.killing import kills

    killed, faults = kills(10_000, 3, tmp_path)
    assert not faults
    # some come too late, as the machine's speed varies; half of them at least must have hit
    assert sum(killed.values()) > 5_000
