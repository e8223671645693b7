"""The steps of the work, and whether each is up to date."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

StepState = Literal["missing", "out of date", "up to date"]

WRITTEN_BY = "the next init, measure, solve or run writes it"


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the work: its command, its state, and why."""

    command: str
    state: StepState
    text: str


def changed_inputs(old: Sequence[tuple[str, str]], new: Sequence[tuple[str, str]]) -> list[str]:
    """Return the names of inputs that are new, gone or different."""
    before, after = dict(old), dict(new)
    return [name for name in {**before, **after} if before.get(name) != after.get(name)]
