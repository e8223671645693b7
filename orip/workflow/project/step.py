"""The steps of the work, and whether each is up to date."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from msgspec import Struct

StepState = Literal["missing", "out of date", "failed", "up to date"]
"""Failed: with this input it comes to nothing, and doing it again would not help."""

WRITTEN_BY = "the next init, measure, solve or run writes it"


class Step(Struct, frozen=True):
    """One step of the work: its command, its state, and why; and what comes next where it is not this command."""

    command: str
    state: StepState
    text: str
    instead: str | None = None

    @property
    def following(self) -> str:
        """Return what comes next while the step is not up to date."""
        return self.command if self.instead is None else self.instead


def changed_inputs(old: Sequence[tuple[str, str]], new: Sequence[tuple[str, str]]) -> list[str]:
    """Return the names of inputs that are new, gone or different."""
    before, after = dict(old), dict(new)
    return [name for name in {**before, **after} if before.get(name) != after.get(name)]
