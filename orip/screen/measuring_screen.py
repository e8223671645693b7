"""What the page of `orip screen` shows and asks for: photos, their points, measurements, control and what is wrong."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from orip.errors import InputError, OripError
from orip.images.matching.one_point import Transfer
from orip.images.tiles import TILE, TileName, TileStore, level_count
from orip.screen.plates import Plate
from orip.screen.proposals import propose
from orip.web.page_server import Document, RequestError, one_of, word

_NEWS_EVERY_S = 0.25
"""Seconds after which is looked for what others have written to measurement files."""

_MOST_MISFITS = 200

_EDITS: Mapping[str, Literal["KILL", "DISREGARD", "INCLUDE"]] = {
    "remove": "KILL", "exclude": "DISREGARD", "include": "INCLUDE",
}  # fmt: skip

_DECIMALS = 4
"""Of pixels that are measured."""


class PageOfSession(Protocol):
    """What a session shows."""

    def told(self) -> Document:
        """Return what was answered, what waits and what is suspect; `serial` counts up with every change."""


class MeasuringSession(Protocol):
    """A session of measuring; every measurement is on the disk before it is answered."""

    page: PageOfSession

    def reply(self, line: str) -> Document | None:
        """Return the reply to a request."""

    def news(self) -> Iterator[Document]:
        """Yield what has been reconsidered, and what others have measured."""

    def points(self, photos: Iterable[str]) -> Document | None:
        """Return by photo its points as in a measurement file, and what is up; None while that is being changed."""

    def marks(self, photo: str) -> list[Document]:
        """Return the fiducial and tick marks in the image of a photo: `what`, `owner`, `text` and `marks`."""

    def mark(
        self, photo: str, what: str, name: str, to: tuple[float, float] | Literal["KILL", "DISREGARD", "INCLUDE"]
    ) -> Document:
        """Measure a fiducial or tick mark, or edit it, and return the answer."""

    def control(self) -> list[str]:
        """Return the names of the points with control."""

    def residuals(self, most: int, photo: str = "") -> list[dict[str, Any]]:
        """Return what fits least, in a photo or in all of them: `photo`, `point`, `w` and `limit`."""

    def views(self, point: str) -> tuple[list[Any], list[float | None] | None]:
        """Return where the photos show a point, and its coordinates less those that control gives."""

    def transferred(self, photo: str, xy: tuple[float, float], point: str) -> list[Transfer]:
        """Return where the other photos show what is at a place of a photo."""

    def ray(self, photo: str, xy: tuple[float, float], point: str) -> dict[str, Any]:
        """Return by photo the line in which the others show the ray of a place in a photo."""


class MeasuringScreen:
    """The page's side of a session; called from several threads at once.

    Parameters
    ----------
    session : MeasuringSession
    title : str
        Of the project and bundle.
    plates : mapping of Plate
        By photo.
    folder : Path
        Of the project.
    """

    def __init__(self, session: MeasuringSession, title: str, plates: Mapping[str, Plate], folder: Path) -> None:
        self.page = files("orip.screen") / "page" / "screen.html"
        self._session, self._plates = session, plates
        self._in_order = tuple(plates.values())
        self._store = TileStore(folder)
        self.scene: Document = {
            "title": title,
            "tile": TILE,
            "photos": [_shown_plate(plate) for plate in self._in_order],
            "control": session.control(),
        }
        self.commands: Mapping[str, Callable[[Document], Document]] = {
            "measure": self._measure,
            "remove": lambda asked: self._of_point("remove", asked),
            "exclude": lambda asked: self._of_point("exclude", asked),
            "include": lambda asked: self._of_point("include", asked),
            "undo": lambda _: self._reply({"do": "undo"}),
            "points": self._points,
            "marks": self._marks,
            "mark": self._mark,
            "views": self._views,
            "propose": self._propose,
            "ray": self._ray,
            "misfits": self._misfits,
            "next": lambda _: self._next(),
        }
        self._looked_at, self._serial = 0.0, -1
        self._state: Document = {"serial": 0}

    def state(self) -> Document:
        """Return the last answer, what waits and what is suspect."""
        now = time.monotonic()
        if now > self._looked_at + _NEWS_EVERY_S:
            self._looked_at = now
            for _ in self._session.news():
                pass  # its page has it
        state = self._session.page.told()
        if state["serial"] != self._serial:
            shown: Document = {key: state[key] for key in ("suspects", "waiting") if key in state}
            history = state.get("history") or [None]
            self._state = {
                **shown,
                "serial": self._state["serial"] + 1,
                "answer": self._advised(state.get("answer") or {}),
                "sigma0": history[-1],
            }
            self._serial = state["serial"]
        return self._state

    def picture(self, name: str) -> bytes:
        """Return a tile, ``PHOTO/LEVEL/COLUMN/ROW`` with the number of the photo.

        Raises
        ------
        RequestError
            If there is no such tile.
        InputError
            If the image cannot be read.
        """
        words = name.split("/")
        if len(words) != 4 or not all(word.isascii() and word.isdecimal() and len(word) < 7 for word in words):
            message = "a picture has the number of its photo, its level, column and row"
            raise RequestError(message)
        photo, level, column, row = map(int, words)
        if photo >= len(self._in_order) or self._in_order[photo].image is None:
            message = f"there is no photo {photo} with an image"
            raise RequestError(message)
        plate = self._in_order[photo]
        return self._store.tile(plate.stored, TileName(level, column, row))

    def _measure(self, asked: Document) -> Document:
        plate, x, y = self._place(asked)
        return self._reply({"do": "measure", "photo": plate.photo, "point": asked.get("point"), "x": x, "y": y})

    def _place(self, asked: Document) -> tuple[Plate, float, float]:
        """Return where is measured, as in a measurement file."""
        plate, pixel = self._usable(asked), _pixel(asked)
        if not (0.0 <= pixel[0] <= plate.size[0] and 0.0 <= pixel[1] <= plate.size[1]):
            message = f"the place is outside of the image of photo {plate.photo}"
            raise RequestError(message)
        try:
            self._store.require_as_found(plate.stored)
        except InputError as error:
            raise RequestError(str(error)) from error
        x, y = (round(value, _DECIMALS) for value in plate.to_log(pixel))
        return plate, x, y

    def _mark(self, asked: Document) -> Document:
        """Measure a mark, remove it, leave it out or take it back."""
        do = one_of(asked, "do", ("measure", *_EDITS))
        what, name = one_of(asked, "what", ("MARK", "TICK")), word(asked, "name")
        plate = self._usable(asked)
        to = self._place(asked)[1:] if do == "measure" else _EDITS[do]
        try:
            return self._session.mark(plate.photo, what, name, to)
        except OripError as error:
            raise RequestError(str(error)) from error

    def _marks(self, asked: Document) -> Document:
        plate = self._plate(asked)
        groups = [] if plate.fault else self._session.marks(plate.photo)
        for mark in (mark for group in groups for mark in group["marks"]):
            for key in ("measured", "expected"):
                mark[key] = mark[key] and plate.to_pixel(mark[key])
        return {"photo": plate.photo, "groups": groups}

    def _of_point(self, do: str, asked: Document) -> Document:
        return self._reply({"do": do, "photo": asked.get("photo"), "point": asked.get("point")})

    def _reply(self, request: Document) -> Document:
        reply = self._session.reply(json.dumps(request))
        assert reply is not None, "the page does not end a session"
        return self._advised(reply)

    def _advised(self, reply: Document) -> Document:
        """Return a reply with pixels in what it says is to be measured next."""
        if not reply.get("next"):
            return reply
        return {**reply, "next": [self._candidate(one) for one in reply["next"]]}

    def _candidate(self, one: Document) -> Document:
        plate = self._plates.get(one["photo"])
        x, y = (one["x"], one["y"]) if plate is None else plate.to_pixel((one["x"], one["y"]))
        return {"photo": one["photo"], "point": one["point"], "x": x, "y": y, "text": one["text"]}

    def _views(self, asked: Document) -> Document:
        point = word(asked, "point")
        views, difference = self._session.views(point)
        shown = [self._view(view, plate) for view in views if (plate := self._plates.get(view.photo)) is not None]
        return {"point": point, "views": shown, "control": difference}

    def _view(self, view: Any, plate: Plate) -> Document:
        origin, residual = plate.origin, None
        if view.measured is not None and view.expected is not None:
            residual = (view.expected - view.measured).round(3).tolist()
        return {
            "photo": view.photo,
            "expected": None if view.expected is None else (view.expected + origin).round(3).tolist(),
            "measured": None if view.measured is None else (view.measured + origin).round(3).tolist(),
            "ellipse": None if view.covariance is None else _ellipse(view.covariance),
            "residual": residual,
        }

    def _propose(self, asked: Document) -> Document:
        plate, pixel = self._usable(asked), _pixel(asked)
        try:
            transfers = self._session.transferred(plate.photo, plate.to_log(pixel), word(asked, "point"))
            proposals, faults = propose(self._store, self._plates, plate.photo, pixel, transfers)
        except OripError as error:
            raise RequestError(str(error)) from error
        return {
            "proposals": [
                {"photo": one.photo, "x": one.place[0], "y": one.place[1], "error": round(one.error, 3),
                 "off": round(one.off, 2), "reason": one.reason}
                for one in proposals
            ],
            "faults": faults,
        }  # fmt: skip

    def _ray(self, asked: Document) -> Document:
        plate, pixel = self._usable(asked), _pixel(asked)
        try:
            lines = self._session.ray(plate.photo, plate.to_log(pixel), word(asked, "point"))
        except OripError as error:
            raise RequestError(str(error)) from error
        return {
            "lines": {
                name: [self._plates[name].to_pixel((x, y)) for x, y in line]
                for name, line in lines.items()
                if name in self._plates
            }
        }

    def _misfits(self, asked: Document) -> Document:
        """Return what is suspect and what fits least; or of a photo, which takes less time, what fits least in it."""
        photo = self._plate(asked).photo if "photo" in asked else ""
        suspects = [] if photo else self._reply({"do": "show", "what": "suspects"}).get("suspects", [])
        residuals = self._session.residuals(_MOST_MISFITS, photo)
        keys = ("photo", "point", "w", "limit")
        return {"suspects": suspects, "residuals": [{key: one[key] for key in keys} for one in residuals]}

    def _next(self) -> Document:
        todo = self._reply({"do": "show", "what": "todo"}).get("todo", [])
        return {"next": [self._candidate(one) for one in todo]}

    def _points(self, asked: Document) -> Document:
        """Return the points of photos, pixels; null while they change."""
        numbers = asked.get("photos")
        if not isinstance(numbers, list) or not all(type(n) is int and 0 <= n < len(self._in_order) for n in numbers):
            message = "'photos' are numbers of photos"
            raise RequestError(message)
        points = self._session.points(self._in_order[number].photo for number in numbers)
        return {"photos": None if points is None else self._in_pixels(points)}

    def _in_pixels(self, points: Document) -> Document:
        found = {}
        for photo, of_photo in points.items():
            origin = self._plates[photo].origin
            rows = [[name, x + origin, y + origin, state] for name, x, y, state in of_photo["points"]]
            found[photo] = {"points": rows, "up": of_photo["up"]}
        return found

    def _plate(self, asked: Document) -> Plate:
        plate = self._plates.get(word(asked, "photo"))
        if plate is None:
            message = f"there is no photo {asked['photo'][:60]}"
            raise RequestError(message)
        return plate

    def _usable(self, asked: Document) -> Plate:
        plate = self._plate(asked)
        if plate.fault:
            message = f"photo {plate.photo}: {plate.fault}"
            raise RequestError(message)
        return plate


def _shown_plate(plate: Plate) -> Document:
    columns, rows = plate.size
    levels = level_count(columns, rows) if not plate.fault else 0
    return {"name": plate.photo, "columns": columns, "rows": rows, "levels": levels, "fault": plate.fault}


def _pixel(asked: Document) -> tuple[float, float]:
    found = asked.get("x"), asked.get("y")
    if any(isinstance(v, bool) or not isinstance(v, int | float) or not math.isfinite(v) for v in found):
        message = "'x' and 'y' are numbers of pixels"
        raise RequestError(message)
    return float(asked["x"]), float(asked["y"])


def _ellipse(covariance: Any) -> list[float]:
    """Return semi-axes, pixels, and the direction of the larger one, degrees from columns towards rows."""
    values, vectors = np.linalg.eigh(covariance)
    minor, major = np.sqrt(np.clip(values, 0.0, None)).tolist()
    return [round(major, 3), round(minor, 3), round(math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0, 2)]
