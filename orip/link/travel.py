"""Simulated travel: the stages take their time to where they are driven."""

from __future__ import annotations

from math import dist, floor
from typing import NamedTuple

from orip.multimodel.state import Position, ProcessorState
from orip.structs import replace

Plates = tuple[Position, Position]


class Pace(NamedTuple):
    """Speed of a stage, plate units a second, and how often a second its place is set."""

    speed: float
    rate_hz: float


class Travel(NamedTuple):
    """Where the stages were, (upper, lower), when they set off, and the time then, s."""

    origin: Plates
    began_s: float


def on_the_way(pace: Pace, travel: Travel, goal: ProcessorState, now_s: float) -> ProcessorState | None:
    """Return what shows of stages that go to their places straight and at equal speed; None: they have arrived."""
    covered = pace.speed * floor((now_s - travel.began_s) * pace.rate_hz) / pace.rate_hz
    pairs = zip(travel.origin, goal.plates, strict=True)
    upper, lower = (_between(origin, end, covered) for origin, end in pairs)
    if (upper, lower) == goal.plates:
        return None
    return replace(goal, plates=(upper, lower), mark=None)


def _between(origin: Position, end: Position, covered: float) -> Position:
    length = dist(origin, end)
    if covered >= length:
        return end
    part = covered / length
    return origin[0] + part * (end[0] - origin[0]), origin[1] + part * (end[1] - origin[1])
