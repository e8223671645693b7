"""Where a flight is beside its plan: what is flown, what comes next, what was passed too far away."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files
from itertools import groupby, pairwise
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.planning.following.receiver import Fix
from orip.records.control import Station
from orip.structs import replace
from orip.web.page_server import Document

PhotoState = Literal["planned", "flown", "missed"]

_WITHIN = 0.25
"""Of base and spacing, whichever is less: how far beside its plan an exposure still is as planned."""

_NEAR = 0.5
"""Of the spacing: farther away nothing is passed, but flown elsewhere."""


class Flight(Struct, frozen=True):
    """Planned exposures in the order of flight.

    Parameters
    ----------
    places : array (n, 3)
    within : float
        An exposure is flown where it is passed within this distance, level and in height.
    near : float
        It is passed where it is within this distance.
    """

    names: tuple[str, ...]
    strips: tuple[str, ...]
    places: FloatArray
    within: float
    near: float


class Beside(Struct, frozen=True):
    """A place beside the next planned exposure, in ground units.

    Parameters
    ----------
    ahead : float
        Level distance that is left along the strip; negative behind it.
    right, above : float
        Of the strip's line and of the planned height.
    """

    ahead: float
    right: float
    above: float


class Progress(Struct, frozen=True):
    """How far a flight is.

    Parameters
    ----------
    states : tuple of {"planned", "flown", "missed"}
    place : array (3,) or None
        Where the camera is.
    course : float
        Of the last movement, radians from Y to X; NaN before one.
    last : int or None
        Exposure that was passed last.
    forwards : bool
        Its strip is flown in the order of the plan.
    """

    flight: Flight
    states: tuple[PhotoState, ...]
    place: FloatArray | None = None
    course: float = math.nan
    last: int | None = None
    forwards: bool = True

    @property
    def next(self) -> int | None:
        """Return the exposure that comes next: ahead in the strip that is flown, else the first that is not flown."""
        if self.last is not None:
            step = 1 if self.forwards else -1
            strips, number = self.flight.strips, self.last + step
            while 0 <= number < len(strips) and strips[number] == strips[self.last]:
                if self.states[number] == "planned":
                    return number
                number += step
        return next((number for number, state in enumerate(self.states) if state == "planned"), None)

    def of(self, state: PhotoState) -> tuple[str, ...]:
        """Return the names of the exposures in a state."""
        return tuple(name for name, found in zip(self.flight.names, self.states, strict=True) if found == state)

    def beside(self) -> Beside | None:
        """Return where the camera is beside the next exposure; None where there is none, or it is nowhere yet."""
        number = self.next
        if number is None or self.place is None:
            return None
        along = _direction(self.flight, number)
        if not self.forwards and self.last is not None and self.flight.strips[self.last] == self.flight.strips[number]:
            along = -along
        left = self.flight.places[number] - self.place
        return Beside(float(left[:2] @ along), float(left[0] * -along[1] + left[1] * along[0]), float(-left[2]))


def begin_flight(stations: Sequence[Station], within: float | None = None) -> Progress:
    """Return a flight of which nothing has been flown.

    Parameters
    ----------
    stations : sequence of Station
        Planned exposures.
    within : float, optional
        See `Flight`; a quarter of base or spacing otherwise.
    """
    places = np.array([station.position for station in stations])
    strips = tuple(station.strip for station in stations)
    steps = np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1)
    same = np.array([one == other for one, other in pairwise(strips)], dtype=bool)
    base = float(np.median(steps[same & (steps > 0.0)])) if (same & (steps > 0.0)).any() else math.inf
    spacing = _spacing(places, strips)
    least = min(base, spacing)
    chosen = within if within is not None else _WITHIN * least if math.isfinite(least) else 1.0
    near = _NEAR * spacing if math.isfinite(spacing) else 4.0 * chosen
    names = tuple(station.photo for station in stations)
    flight = Flight(names, strips, places, chosen, max(near, chosen))
    states: tuple[PhotoState, ...] = tuple("planned" for _ in names)
    return Progress(flight, states)


def move_to(progress: Progress, place: FloatArray) -> Progress:
    """Return how far the flight is when the camera has flown on to a place (3,), straight from the last one."""
    if progress.place is None:
        return replace(progress, place=place)
    way = (place - progress.place)[:2]
    if float(way @ way) == 0.0:
        return replace(progress, place=place)
    start = progress.place
    progress = replace(progress, place=place, course=math.atan2(way[0], way[1]))
    for number, off in _passed(progress.flight, start, place):
        progress = _pass(progress, number, off)
    return progress


def _passed(flight: Flight, start: FloatArray, end: FloatArray) -> Iterator[tuple[int, float]]:
    """Yield the exposures that are abreast on a straight way, in its order, and how far each is from it."""
    way = end - start
    part = ((flight.places - start)[:, :2] @ way[:2]) / float(way[:2] @ way[:2])
    nearest = start + part[:, None] * way
    left = flight.places - nearest
    level = np.linalg.norm(left[:, :2], axis=1)
    abreast = np.flatnonzero((part > 0.0) & (part <= 1.0) & (level <= flight.near))
    for number in abreast[np.argsort(part[abreast], kind="stable")].tolist():
        yield number, float(max(level[number], abs(left[number, 2])))


def _pass(progress: Progress, number: int, off: float) -> Progress:
    """Return the progress with an exposure passed, and with those before it in its strip that were left out."""
    flight, states = progress.flight, list(progress.states)
    last, forwards = progress.last, progress.forwards
    if last is not None and flight.strips[last] == flight.strips[number] and last != number:
        forwards = number > last
        step = 1 if forwards else -1
        for between in range(last + step, number, step):
            if states[between] == "planned":
                states[between] = "missed"
    if off <= flight.within:
        states[number] = "flown"
    elif states[number] == "planned":
        states[number] = "missed"
    return replace(progress, states=tuple(states), last=number, forwards=forwards)


def _direction(flight: Flight, number: int) -> FloatArray:
    """Return the level direction (2,) of the strip of an exposure, in the order of the plan."""
    rows = [row for row, strip in enumerate(flight.strips) if strip == flight.strips[number]]
    way = flight.places[rows[-1], :2] - flight.places[rows[0], :2]
    length = float(np.linalg.norm(way))
    return np.array([0.0, 1.0]) if length == 0.0 else way / length


def _spacing(places: FloatArray, strips: Sequence[str]) -> float:
    """Return the least level distance between the middles of strips that follow each other, across the first one."""
    rows = [[row for row, _ in group] for _, group in groupby(enumerate(strips), key=lambda pair: pair[1])]
    ways = [places[one[-1], :2] - places[one[0], :2] for one in rows]
    found = []
    for number in range(len(rows) - 1):
        length = float(np.linalg.norm(ways[number]))
        between = places[rows[number + 1], :2].mean(axis=0) - places[rows[number], :2].mean(axis=0)
        if length > 0.0:
            across = abs(float(between[0] * ways[number][1] - between[1] * ways[number][0])) / length
            found += [across] if across > 0.0 else []
    return min(found, default=math.inf)


QUALITY = {1: "alone", 2: "differential", 3: "PPS", 4: "RTK fixed", 5: "RTK float", 6: "estimated"}
"""What the quality of a GGA sentence says."""

_TAIL = 600
"""Places that the flown line shows."""


class FollowedFlight:
    """A flight, and what a page shows of it. Its methods may be called from several threads at once."""

    def __init__(self, progress: Progress, unit: str) -> None:
        self.page = files("orip.planning.following") / "follow.html"
        self.commands: Mapping[str, Callable[[Document], Document]] = {}
        flight = progress.flight
        self.scene: Document = {
            "unit": unit,
            "within": flight.within,
            "photos": [
                {"name": name, "strip": strip, "place": place[:2]}
                for name, strip, place in zip(flight.names, flight.strips, flight.places.tolist(), strict=True)
            ],
        }
        self._lock = threading.Lock()
        self._tail: list[list[float]] = []
        self._state: Document = {"serial": 0}
        self.show(progress, None)

    def show(self, progress: Progress, fix: Fix | None) -> None:
        """Take over how far the flight is."""
        beside, number = progress.beside(), progress.next
        with self._lock:
            if progress.place is not None:
                self._tail = [*self._tail[1 - _TAIL :], progress.place[:2].tolist()]
            self._state = {
                "serial": self._state["serial"] + 1,
                "states": "".join(state[0] for state in progress.states),
                "next": None if number is None else progress.flight.names[number],
                "beside": None
                if beside is None
                else {"ahead": beside.ahead, "right": beside.right, "above": beside.above},
                "place": None if progress.place is None else progress.place.tolist(),
                "course": None if math.isnan(progress.course) else math.degrees(progress.course),
                "quality": None if fix is None else QUALITY.get(fix.quality, str(fix.quality)),
                "tail": self._tail,
                "flown": len(progress.of("flown")),
                "missed": list(progress.of("missed")),
            }

    def state(self) -> Document:
        """Return where the flight is; `serial` counts up whenever anything has changed."""
        with self._lock:
            return self._state
