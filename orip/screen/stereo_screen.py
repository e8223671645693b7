"""What the stereo page of `orip screen` shows and asks for: rectified photos, the floating mark, features."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path

from orip.errors import LinkError
from orip.files.log.stereo import StereoFile
from orip.images.tiles import TILE, TileName, TileStore, level_count
from orip.records.measurement import FEATURE_KINDS, LEAST_VERTICES, FeatureKind, StereoFeature, StereoVertex
from orip.screen.courses import COURSE_KINDS, CourseDriver, CourseKind, contour, grid, profile
from orip.screen.plates import Plate, rectified_tile
from orip.screen.proposals import propose
from orip.screen.stereo_drawing import StereoDrawing, StereoView
from orip.web.page_server import Document, RequestError, number, numbers, one_of, word

STEREO_FILE = "STEREO.STE"
"""In the project folder; `orip restitute compute` takes it."""

GUIDES = ("OBJECT", "MODEL", "BOTH", "UPPER", "LOWER")

_MOST_NAMES = 5000
"""Of points that are offered to go to."""

_SURROUNDINGS = 16.0
"""Pixels around the mark that matching compares: beyond the border of an image there are none."""

_MOST_PIXELS = 1e5
"""Of a movement."""

_FARTHEST = 1e15
"""Ground units."""

_AT_ONCE_S = 0.5
"""Seconds for which vertices of a course are recorded before the page is told."""


class StereoScreen:
    """The page's side of a plate processor; called from several threads at once.

    Parameters
    ----------
    processor : StereoView
    title, unit : str
        Of the project and bundle; of the ground.
    plates : mapping of Plate
        By photo.
    folder : Path
        Of the project.
    file : StereoFile
        What is measured goes there.
    """

    def __init__(
        self, processor: StereoView, title: str, unit: str, plates: Mapping[str, Plate], folder: Path, file: StereoFile
    ) -> None:
        self.page = files("orip.screen") / "page" / "stereo.html"
        self._processor, self._plates, self._file = processor, plates, file
        self._store, self._lock = TileStore(folder), threading.RLock()
        self._drawing = StereoDrawing(processor, file)
        self._state: Document = {"serial": 0}
        self._closed = file.unfinished is None
        self._course: CourseDriver | None = None
        self._target: Document = {}
        self.scene: Document = {
            "title": title,
            "unit": unit,
            "tile": TILE,
            "file": file.shown,
            "guides": GUIDES,
            "kinds": FEATURE_KINDS,
            "courses": COURSE_KINDS,
            "models": [self._model(number) for number in range(len(processor.block.models))],
            "points": list(processor.points)[:_MOST_NAMES],
        }
        self.commands: Mapping[str, Callable[[Document], Document]] = {
            "move": self._done(self._move),
            "drive": self._done(self._drive),
            "plate": self._done(self._plate),
            "model": self._done(lambda asked: processor.change_model(word(asked, "name"))),
            "next": self._done(lambda _: processor.next_model()),
            "guide": self._done(self._guide),
            "automatic": self._done(self._automatic),
            "match": self._done(lambda _: self._match()),
            "record": self._done(self._record),
            "close": self._done(lambda _: self._close()),
            "undo": self._done(lambda _: self._undo()),
            "course": self._done(self._begin_course),
            "step": self._done(lambda _: self._step()),
            "run": self._done(lambda _: self._run()),
            "drawn": lambda _: self._drawn(),
        }

    def state(self) -> Document:
        """Return where everything is; `serial` counts up whenever anything has changed."""
        with self._lock:
            moving = self._moving()
            if {**moving, "serial": self._state["serial"]} != self._state:
                self._state = {**moving, "serial": self._state["serial"] + 1}
            return self._state

    def picture(self, name: str) -> bytes:
        """Return a tile of a rectified photo, ``MODEL/SIDE/LEVEL/COLUMN/ROW``, all of them numbers.

        Raises
        ------
        RequestError
            If there is no such tile.
        InputError
            If the image cannot be read.
        """
        words = name.split("/")
        if len(words) != 5 or not all(word.isascii() and word.isdecimal() and len(word) < 7 for word in words):
            message = "a picture has the number of its model, its side, level, column and row"
            raise RequestError(message)
        model, side, level, column, row = map(int, words)
        if model >= len(self._processor.block.models) or side > 1:
            message = f"there is no model {model} with a photo {side}"
            raise RequestError(message)
        with self._lock:
            pair = self._processor.rectified(model)
            plate = self._plates[self._processor.photo_names(model)[side]]
        size = pair.columns[side], pair.rows
        return rectified_tile(
            self._store, plate, size, TileName(level, column, row), lambda at: pair.logs_of(side, at) + plate.origin
        )

    def _model(self, number: int) -> Document:
        pair, names = self._processor.rectified(number), self._processor.photo_names(number)
        fault = "" if pair.rows else "its photos have no rows in common: they show no stereo"
        return {
            "name": pair.model.name,
            "photos": names,
            "stages": [photo.stage for photo in pair.model.photos],
            "columns": pair.columns,
            "rows": pair.rows,
            "levels": [0 if fault else level_count(columns, pair.rows) for columns in pair.columns],
            "fault": fault,
        }

    def _done(self, command: Callable[[Document], str | None]) -> Callable[[Document], Document]:
        def do(asked: Document) -> Document:
            said, refused = None, None
            with self._lock:
                try:
                    said = command(asked)
                except LinkError as fault:
                    refused = getattr(fault, "text", str(fault))
                return {"state": self.state(), "said": said, "refused": refused}

        return do

    def _moving(self) -> Document:
        reading = self._processor.read()
        pair, last = self._processor.rectified(reading.model), self._file.features[-1:]
        names = self._processor.photo_names(reading.model)
        open_one = None if self._closed or not last else _counted(last[0])
        return {
            "model": reading.model,
            "guide": reading.guide,
            "automatic": reading.automatic,
            "condition": reading.condition,
            "mark": reading.xyz,
            "y_parallax": _finite(reading.y_parallax),
            "y_pixels": _finite(reading.y_parallax / pair.pitch),
            "plates": reading.plates,
            "photos": reading.photos,
            "pixels": [
                self._plates[name].to_pixel(log) for name, log in zip(names, reading.logs, strict=True)
            ],
            "places": [list(map(_finite, place)) for place in reading.places],
            "open": open_one,
            "target": self._target,
            "drawn": self._drawing.serial(),
        }  # fmt: skip

    def _move(self, asked: Document) -> None:
        right, up, higher = (number(asked.get(key, 0.0), _MOST_PIXELS) for key in ("right", "up", "higher"))
        self._processor.move(right, up, higher)

    def _drive(self, asked: Document) -> None:
        if "point" in asked:
            xyz = self._processor.points.get(word(asked, "point"))
            if xyz is None:
                message = f"there is no adjusted point {asked['point'][:60]}"
                raise RequestError(message)
        else:
            x, y, z = numbers(asked.get("object"), 3, _FARTHEST, "'object'")
            xyz = x, y, z
        self._processor.drive(xyz)

    def _plate(self, asked: Document) -> None:
        names = self._processor.photo_names(self._processor.read().model)
        photo = word(asked, "photo")
        if photo not in names:
            message = f"photo {photo[:60]} is not in the model"
            raise RequestError(message)
        pixel = number(asked.get("x"), 1e9), number(asked.get("y"), 1e9)
        self._processor.set_plate(names.index(photo), self._plates[photo].to_log(pixel))

    def _guide(self, asked: Document) -> None:
        self._processor.guide(one_of(asked, "system", GUIDES))

    def _automatic(self, asked: Document) -> None:
        on = asked.get("on")
        if not isinstance(on, bool):
            message = "automatic takes 'on', true or false"
            raise RequestError(message)
        self._processor.automatic(on)

    def _match(self) -> str:
        """Set the right plate to what the left one is at, by matching."""
        reading = self._processor.read()
        transfer = self._processor.transfer_to_right()
        left = self._plates[self._processor.photo_names(reading.model)[0]]
        self._require_surroundings(left, left.to_pixel(reading.logs[0]))
        found, faults = propose(
            self._store, self._plates, left.photo, left.to_pixel(reading.logs[0]), [transfer], checks_back=False
        )
        if not found:
            message = "; ".join(faults) or "the photos differ too much in scale to be compared here"
            raise RequestError(message)
        if found[0].reason:
            message = f"matching: {found[0].reason}; bring the mark nearer to the surface, or set it by hand"
            raise RequestError(message)
        self._require_surroundings(self._plates[transfer.photo], found[0].place)
        self._processor.set_plate(1, self._plates[transfer.photo].to_log(found[0].place))
        return f"matched, ±{found[0].error:.2f} px, {found[0].off:.2f} px off the epipolar line"

    def _require_surroundings(self, plate: Plate, pixel: tuple[float, float]) -> None:
        if not all(_SURROUNDINGS <= at <= side - _SURROUNDINGS for at, side in zip(pixel, plate.size, strict=True)):
            message = f"matching: too near to the border of photo {plate.photo}; set the mark by hand"
            raise RequestError(message)

    def _record(self, asked: Document) -> str:
        kind: FeatureKind = one_of(asked, "kind", FEATURE_KINDS)
        if self._processor.read().xyz is None:
            message = "the rays of the two plates do not meet; drive to the point first"
            raise RequestError(message)
        for photo in self._processor.photo_names(self._processor.read().model):
            if self._plates[photo].image is not None and not self._plates[photo].fault:
                self._store.require_as_found(self._plates[photo].stored)
        snapped = self._snap(asked["snap"]) if "snap" in asked else ""
        return self._put(kind, word(asked, "code"), word(asked, "name"), self._processor.vertex()) + snapped

    def _put(self, kind: FeatureKind, code: str, name: str, vertex: StereoVertex) -> str:
        feature = self._file.put(kind, code, name, vertex)
        self._closed = kind == "POINT"
        return f"recorded {_counted(feature)}"

    def _snap(self, within: object) -> str:
        """Bring the mark to the vertex or point that is nearest, where there is one within some pixels."""
        near = self._drawing.nearest(self._processor.read(), number(within, _MOST_PIXELS))
        if near is None:
            return ""
        if near.vertex is None:
            self._processor.drive(self._processor.points[near.shown])
        else:
            self._processor.go_to_vertex(near.vertex)
        return f", snapped to {near.shown}"

    # courses

    def _begin_course(self, asked: Document) -> str:
        """Begin a profile or grid between two places, or a contour from where the mark is."""
        kind: CourseKind = one_of(asked, "kind", COURSE_KINDS)
        code, name = word(asked, "code"), word(asked, "name")
        spacing = number(asked.get("spacing"), _FARTHEST)
        least = self._processor.ground_pixel()[0]
        if not spacing >= least:
            message = f"the spacing is below a pixel, which is {least:.3g} on the ground; choose a larger one"
            raise RequestError(message)
        self._file.require_finished()
        if kind == "CONTOUR":
            course = contour(code, name, number(asked.get("z"), _FARTHEST), spacing)
        else:
            (x, y), (u, v) = (numbers(asked.get(end), 2, _FARTHEST, f"'{end}'") for end in ("from", "to"))
            course = (profile if kind == "PROFILE" else grid)(code, name, ((x, y), (u, v)), spacing)
        self._course = CourseDriver(self._processor, self._match, self._file, course)
        ahead = self._course.ahead()
        return f"{kind.lower()} {code} {name}" + ("" if ahead is None else f": {ahead} places ahead")

    def _step(self) -> str:
        """Bring the mark to what is next on the course, to be looked at and recorded."""
        target = self._driver.next()
        if target is None:
            return "nothing is ahead"
        course = self._driver.course
        self._target = {"kind": course.of_features, "code": course.code, "name": target.name}
        return f"at {target.name}: look, correct, record"

    def _run(self) -> str:
        """Record what is next on the course, as it is matched, for a while."""
        driver, said, until = self._driver, "", time.monotonic() + _AT_ONCE_S
        while time.monotonic() < until:
            target = driver.next_matched()
            if target is None:
                return f"{said or 'nothing is ahead'}; all is done"
            vertex = self._processor.vertex() if target.closing is None else target.closing
            said = self._put(driver.course.of_features, driver.course.code, target.name, vertex)
            if target.closing is not None or driver.ahead() == 0:
                return f"{said}; all is done"
        ahead = driver.ahead()
        return said + ("" if ahead is None else f"; {ahead} ahead")

    @property
    def _driver(self) -> CourseDriver:
        if self._course is None:
            message = "begin a profile, a grid or a contour first"
            raise RequestError(message)
        return self._course

    def _close(self) -> str:
        self._file.require_finished()
        if self._closed:
            message = "no line or area is open"
            raise RequestError(message)
        self._closed = True
        return f"closed {_counted(self._file.features[-1])}"

    def _undo(self) -> str:
        taken = self._file.undo()
        last = self._file.features[-1:]
        self._closed = not (last and (last[0].code, last[0].name) == (taken.code, taken.name))
        return f"taken back: vertex {len(taken.vertices)} of {taken.kind} {taken.code} {taken.name}"

    def _drawn(self) -> Document:
        with self._lock:
            return self._drawing.drawn(self._processor.read().model)


def _counted(feature: StereoFeature) -> str:
    name = f"{feature.kind} {feature.code} {feature.name}"
    if feature.kind == "POINT":
        return name
    count, least = len(feature.vertices), LEAST_VERTICES[feature.kind]
    return f"{name}, vertex {count}" + (f" of at least {least}" if count < least else "")


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
