"""What the page of `orip plan follow` shows, as JSON documents: the plan, which stays, and the flight, which moves."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from importlib.resources import files

from orip.planning.following.progress import Progress
from orip.planning.following.receiver import Fix
from orip.web.page_server import Document

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
