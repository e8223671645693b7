"""A session that answers lines, whoever sends them, with the page that shows its photos and rays."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from orip.errors import OripError, UsageError
from orip.files.text.regular_file import natural_key
from orip.images.matching.one_point import Transfer
from orip.interior.mounting import frame_corners
from orip.online.answers import State, words_of
from orip.online.block.measurements import ray_error
from orip.online.film_marks import MarkEdit
from orip.online.fit import residuals_of
from orip.online.measuring import Measuring
from orip.online.point_views import (
    SeenBlock,
    View,
    control_difference,
    distance_along,
    ray_images,
    seen,
    transferred,
    views_of,
)
from orip.online.replies import Reply, reconsidered_of, reply_of, reply_to, shown
from orip.online.sequential.observation_rows import ObservationKey
from orip.online.session import OnlineSession
from orip.records.names import record_key
from orip.web.page_server import Document

_CHECKED_RAYS = 3
"""Rays from which an error of one of them shows in every direction."""


class RayState(NamedTuple):
    """A photo point, its stored coordinates and its state."""

    photo: str
    point: str
    xy: tuple[float, float]
    state: State


def ray_states(measuring: Measuring, photos: Iterable[str] | None = None) -> Iterator[RayState]:
    """Yield the photo points that are measured, photo by photo; None: of all photos.

    Whether one is checked is told by the number of rays, and by control; an answer tells it from redundancy numbers.
    """
    block = measuring.block
    included, is_checked = block.equations.included, _checked_points(measuring)
    for photo in block.measurements.photos if photos is None else photos:
        for point in block.measurements.points_in(photo):
            key = ObservationKey("photo", photo, point)
            xy = block.measurements.at(photo, point)
            assert xy is not None, "it is measured"
            if key in measuring.excluded:
                yield RayState(photo, point, xy, "excluded")
            elif key in measuring.suspects:
                yield RayState(photo, point, xy, "suspect")
            elif key not in included:
                yield RayState(photo, point, xy, "waiting")
            else:
                yield RayState(photo, point, xy, "included" if point in is_checked else "unchecked")


def _checked_points(measuring: Measuring) -> set[str]:
    """Return the points with control, or with as many rays as check each other."""
    rays: dict[str, int] = {}
    for key in measuring.block.equations.included:
        rays[key.point] = rays.get(key.point, 0) + (_CHECKED_RAYS if key.kind == "control" else 1)
    return {point for point, count in rays.items() if count >= _CHECKED_RAYS}


_LONGEST_HISTORY = 2000
"""Values of sigma0 that are drawn."""

_MOST_WAITING = 30
"""Sentences about what waits that are shown."""


class OnlinePage:
    """A session as its page shows it. `state` may be called from several threads at once.

    Parameters
    ----------
    lock : lock
        Held while a request is answered.
    """

    def __init__(self, session: OnlineSession, lock: threading.Lock) -> None:
        self.page = files("orip.online") / "page" / "online.html"
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
        return self._now(self._photos)

    def told(self) -> Document:
        """Return `state` without the photos."""
        return self._now(lambda _: {})

    def _now(self, drawn: Callable[[Measuring], Document]) -> Document:
        with self._lock:
            if self._is_old:
                self._serial += 1
                is_busy = self._session.is_busy
                found = {} if is_busy else {**drawn(self._session.measuring), **_told(self._session.measuring)}
                self._state = {**self._state, **found, **self._answered(), "serial": self._serial}
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
        return {"photos": photos}

    def _answered(self) -> Document:
        return {"answer": self._answer, "history": self._history}


def _told(measuring: Measuring) -> Document:
    return {
        "suspects": [words_of(key) for key in measuring.suspects],
        "waiting": list(dict.fromkeys(measuring.waiting().values()))[:_MOST_WAITING],
    }


class ServedSession:
    """A session, one request at a time; its page may be looked at meanwhile."""

    def __init__(self, session: OnlineSession, folder: Path) -> None:
        self._session, self._folder = session, folder
        self._lock = threading.Lock()
        self._kept: tuple[int, SeenBlock] | None = None
        self.page = OnlinePage(session, self._lock)

    def greeting(self) -> Reply:
        """Return what a program is told first."""
        with self._lock:
            return shown(self._session)

    def reply(self, line: str) -> Reply | None:
        """Return the reply to a line; None: who has sent it wants to leave."""
        with self._lock:
            reply = reply_to(self._session, self._folder, line)
            self._kept = None  # to relinearise is no request to what is measured
            if reply is not None:
                self.page.answered(reply)
            return reply

    def written(self, photo: str, point: str, xy: tuple[float, float] | None) -> Reply | None:
        """Return the reply to what this program has written to a log; see `OnlineSession.written`."""
        with self._lock:
            answer = self._session.written(photo, point, xy)
            if answer is None:
                return None
            reply = reply_of(self._session, answer)
            self.page.answered(reply)
            return reply

    def points(self, photos: Iterable[str]) -> Document | None:
        """Return by photo its points, ``[name, x, y, state]`` as in a measurement file, and what is up in it.

        None while something is reconsidered.
        """
        with self._lock:
            if self._session.is_busy:
                return None
            seen_photos, to_logs = self._seen().photos, self._session.to_logs()
            found: Document = {name: {"points": [], "up": None} for name in photos}
            for name, group in groupby(ray_states(self._session.measuring, found), key=lambda ray: ray.photo):
                rays = list(group)
                places = to_logs[record_key(name)].apply(np.array([ray.xy for ray in rays])).round(4).tolist()
                found[name]["points"] = [[ray.point, x, y, ray.state] for ray, (x, y) in zip(rays, places, strict=True)]
        for name in found.keys() & seen_photos.keys():
            found[name]["up"] = (seen_photos[name].to_log.matrix @ seen_photos[name].upwards()).tolist()
        return found

    def marks(self, photo: str) -> list[Document]:
        """Return the fiducial and tick marks in the image of a photo, with places as in a measurement file."""
        with self._lock:
            return [marks.shown() for marks in self._session.marks(photo)]

    def mark(self, photo: str, what: str, name: str, to: tuple[float, float] | MarkEdit) -> Document:
        """Measure a fiducial or tick mark, or edit it; return what the marks give then, as an answer of the session."""
        with self._lock:
            marks = self._session.mark(photo, what, name, to)
            self._kept = None
            reply = {"photo": photo, "mark": name, "state": marks.state(name), "text": marks.answer(name)}
            self.page.answered(reply)
            return reply

    def control(self) -> list[str]:
        """Return the names of the points with control."""
        return sorted(self._session.measuring.block.project.control.points, key=natural_key)

    def residuals(self, most: int, photo: str = "") -> list[dict[str, Any]]:
        """Return what fits least, in a photo or in all of them; see `residuals_of`."""
        with self._lock:
            return residuals_of(self._session.measuring, photo and self._session.name_of(photo), most=most)

    def views(self, point: str) -> tuple[list[View], list[float | None] | None]:
        """Return where the photos show a point, best first, and its coordinates less those that control gives."""
        with self._lock:
            view = self._seen()
            return views_of(view, point), control_difference(view, point)

    def transferred(self, photo: str, xy: tuple[float, float], point: str) -> list[Transfer]:
        """Return where the other photos show what is at a place of a photo, as far away as the point or its neighbours.

        Raises
        ------
        UsageError
            If the photo is not oriented, or nothing tells how far away it is.
        """
        with self._lock:
            view = self._seen()
            name, distance = self._distance(view, photo, xy, point)
            return transferred(view, name, np.array(xy), distance, ray_error(view.block.measurements.inputs))

    def ray(self, photo: str, xy: tuple[float, float], point: str) -> dict[str, Any]:
        """Return by photo the line in which the others show the ray of a place in a photo; see `transferred`."""
        with self._lock:
            view = self._seen()
            name, distance = self._distance(view, photo, xy, point)
            return dict(ray_images(view.photos, name, np.array(xy), distance))

    def _seen(self) -> SeenBlock:
        """Return the block at its solution, which is computed once for each change."""
        block, count = self._session.measuring.block, self._session.changes
        if self._kept is None or self._kept[0] != count or self._kept[1].block is not block:
            self._kept = count, seen(block, self._session.to_logs())
        return self._kept[1]

    def _distance(self, view: SeenBlock, photo: str, xy: tuple[float, float], point: str) -> tuple[str, float]:
        """Return a photo's name as it is defined, and how far the ground is at a place of it."""
        name = self._session.name_of(photo)
        if name not in view.photos:
            message = f"photo {name} is not oriented yet: measure more of its points first"
            raise UsageError(message)
        distance = distance_along(view, name, np.array(xy), point)
        if distance is None:
            message = f"nothing tells how far away this place of photo {name} is: measure a point near it in two photos"
            raise UsageError(message)
        return name, distance

    def on_news(self, wake: Callable[[], None]) -> None:
        """Have a function called, in any thread, when `news` may have something to say."""
        self._session.on_news(wake)

    def news(self) -> Iterator[Reply]:
        """Yield what has been reconsidered since, and replies to what others have written to measurement files."""
        with self._lock:
            replies = [*self._said_by(self._reconsidered()), *self._said_by(self._appended())]
        yield from replies

    def ended(self) -> Iterator[Reply]:
        """Yield what is still to be reconsidered, when it is."""
        with self._lock:
            assert self._session.measuring, "waited for"
            replies = list(self._said_by(self._reconsidered()))
        yield from replies

    def _reconsidered(self) -> Iterator[Reply]:
        for answer in self._session.reconsidered():
            reply = reconsidered_of(self._session, answer)
            self.page.answered(reply["reconsidered"])
            yield reply

    def _appended(self) -> Iterator[Reply]:
        for answer in self._session.appended():
            reply = reply_of(self._session, answer)
            self.page.answered(reply)
            yield reply

    def _said_by(self, replies: Iterator[Reply]) -> Iterator[Reply]:
        """Yield replies, the last one being what is wrong where something is."""
        try:
            yield from replies
        except OripError as error:
            reply = {"error": str(error)}
            self.page.answered(reply)
            yield reply
