"""How far an archive is: what has ended and how, how many projects an hour, the time that is left."""

from __future__ import annotations

from collections import Counter

from msgspec import Struct, field

from orip.archive.outcome import State
from orip.wording import agreeing

_MINUTE, _HOUR = 60.0, 3600.0


class Progress(Struct):
    """How far a run of an archive is.

    Parameters
    ----------
    total : int
        Projects of the archive.
    states : Counter of State
        How many have ended, and how.
    repeated : int
        How many of these were finished before and were not adjusted again.
    seconds : float
        Since the run began.
    """

    total: int
    states: Counter[State] = field(default_factory=Counter)
    repeated: int = 0
    seconds: float = 0.0

    @property
    def ended(self) -> int:
        """Return how many projects have ended."""
        return self.states.total()

    @property
    def rate(self) -> float:
        """Return the projects adjusted a second; those that were finished before take next to no time."""
        computed = self.ended - self.repeated
        return computed / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def seconds_left(self) -> float | None:
        """Return the time that is left at this rate; None while nothing is known."""
        return (self.total - self.ended) / self.rate if self.rate > 0.0 else None

    def __str__(self) -> str:
        """Return ``120 of 5000 projects, 3 wrong; 3.2 a second, 25 min left``."""
        others = [f"{count} {state}" for state, count in sorted(self.states.items()) if state != "adjusted"]
        text = ", ".join([f"{self.ended} of {self.total} {agreeing(self.total, 'project')}", *others])
        if self.repeated:
            text += f", {self.repeated} finished before"
        if self.ended < self.total and self.seconds_left is not None:
            text += f"; {self.rate:.2g} a second, {duration(self.seconds_left)} left"
        return text


def duration(seconds: float) -> str:
    """Return a time as ``40 s``, ``25 min`` or ``3.5 h``."""
    if seconds < 2 * _MINUTE:
        return f"{seconds:.0f} s"
    if seconds < 2 * _HOUR:
        return f"{seconds / _MINUTE:.0f} min"
    return f"{seconds / _HOUR:.1f} h"
