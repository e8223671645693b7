"""What the page of `orip online` shows: the frames of all photos with their points, and what was answered last."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from itertools import groupby

import numpy as np

from orip.interior.mounting import frame_corners
from orip.link.watch import Document
from orip.online.answers import words_of
from orip.online.measuring import Measuring
from orip.online.ray_states import ray_states
from orip.records.names import record_key
from orip.workflow.online.session import OnlineSession

_LONGEST_HISTORY = 2000
"""Values of sigma0 that are drawn."""

_MOST_WAITING = 30
"""Sentences about what waits that are shown."""


class OnlinePage:
    """A session as its page shows it. `state` may be called from several threads at once.

    Parameters
    ----------
    session : OnlineSession
    lock : lock
        Held while a request is answered.
    """

    page = "online.html"

    def __init__(self, session: OnlineSession, lock: threading.Lock) -> None:
        self.scene: Document = {"project": session.bundle.name}
        self.commands: Mapping[str, Callable[[Document], Document]] = {}
        self._session, self._lock = session, lock
        self._serial, self._is_old = 0, True
        self._answer: Document = {}
        self._history: list[float] = []
        self._state: Document = {"photos": [], "suspects": [], "waiting": []}

    def answered(self, reply: Document) -> None:
        """Keep what was answered last; the lock is held."""
        if "state" in reply or "error" in reply:
            self._answer = reply
        sigma0 = reply.get("sigma0")
        if isinstance(sigma0, float):
            self._history = [*self._history, sigma0][-_LONGEST_HISTORY:]
        self._is_old = True

    def state(self) -> Document:
        """Return all photos with their points, mm, the last answer, what waits and sigma0 over time.

        While something is reconsidered, the photos are those of before.
        """
        with self._lock:
            if self._is_old:
                self._serial += 1
                is_busy = self._session.is_busy
                photos = {} if is_busy else self._photos(self._session.measuring)
                self._state = {**self._state, **photos, **self._answered(), "serial": self._serial}
                self._is_old = is_busy
            return self._state

    def _photos(self, measuring: Measuring) -> Document:
        records, interior = measuring.block.measurements.inputs.records, measuring.block.measurements.inputs.interior
        photos: list[Document] = []
        for name, group in groupby(ray_states(measuring), key=lambda ray: ray.photo):
            rays = list(group)
            corners = frame_corners(records.camera_of(records.photos[record_key(name)]))
            places = interior.to_photo[record_key(name)].apply(np.array([ray.xy for ray in rays])).round(3).tolist()
            photos.append(
                {
                    "name": name,
                    "oriented": name in measuring.block.values.orientations,
                    "frame": None if corners is None else [*corners[0].tolist(), *corners[1].tolist()],
                    "points": [[ray.point, x, y, ray.state] for ray, (x, y) in zip(rays, places, strict=True)],
                }
            )
        return {
            "photos": photos,
            "suspects": [words_of(key) for key in measuring.suspects],
            "waiting": list(dict.fromkeys(measuring.waiting().values()))[:_MOST_WAITING],
        }

    def _answered(self) -> Document:
        return {"answer": self._answer, "history": self._history}
