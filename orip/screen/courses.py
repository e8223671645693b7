"""Courses of the floating mark: profiles and grids at a given spacing, and contours; heights are found by matching.

What is next follows from the file alone: what was recorded, by hand or by matching, is behind, and what was taken back
is ahead again. A place at which nothing matches waits until the mark has been set by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import LinkError, OripError
from orip.files.log.stereo import StereoFile
from orip.records.measurement import FeatureKind, StereoFeature, StereoVertex
from orip.records.names import record_key
from orip.screen.stereo_drawing import StereoView, Triple
from orip.web.page_server import RequestError

CourseKind = Literal["PROFILE", "GRID", "CONTOUR"]
COURSE_KINDS: tuple[CourseKind, ...] = ("PROFILE", "GRID", "CONTOUR")

MOST_PLACES = 20_000

_HEIGHTS = 8
"""Matches at a place after which its height is not found: each begins at the height of the one before."""

_STAYS = 0.1
"""Pixels: within so much the matched place is the one that was asked for, and a contour at its height."""

_TRIES = 8
"""Places at which the height is looked at to find the next one of a contour."""

_CLOSED = 0.75
"""Part of the spacing within which a contour has come back to its beginning."""

_FEWEST = 4
"""Vertices of a contour that may come back to the first one."""

_MOST_TURN = 0.5
"""Radians by which a contour is expected to turn from one vertex to the next."""

_REMEMBERED = 0.1
"""Part of the spacing within which the slope is that of a vertex, and beyond which heights tell it."""

_LEAST_SLOPE = 0.02
"""Height for a unit of way below which no contour is followed: it would run wherever the heights scatter."""


class Course(Struct, frozen=True):
    """What is to be measured.

    Parameters
    ----------
    kind : {"PROFILE", "GRID", "CONTOUR"}
    code, name : str
        Of the line; of a grid the names of its points begin with it.
    spacing : float
        Ground units.
    places : array (n, 2)
        X and Y of a profile or grid.
    names : tuple of str
        Of the points of a grid.
    z : float
        Of a contour.
    """

    kind: CourseKind
    code: str
    name: str
    spacing: float
    places: FloatArray
    names: tuple[str, ...]
    z: float

    @property
    def of_features(self) -> FeatureKind:
        """Return the kind of the features that are recorded."""
        return "POINT" if self.kind == "GRID" else "LINE"


class Target(NamedTuple):
    """Where the mark goes next: X and Y, or the first vertex again; and the name of the feature."""

    name: str
    xy: tuple[float, float]
    closing: StereoVertex | None = None


Pair = tuple[float, float]


def profile(code: str, name: str, ends: tuple[Pair, Pair], spacing: float) -> Course:
    """Return a profile between two places: vertices at the spacing from the first one, and the last one.

    Raises
    ------
    RequestError
        If it has no length, or too many vertices.
    """
    first, last = (np.array(end) for end in ends)
    length = float(np.linalg.norm(last - first))
    _require_few(length / spacing)
    if not length > 0.0:
        message = "the two ends of the profile are the same: go on to the other one first"
        raise RequestError(message)
    along = np.arange(0.0, length * (1.0 - 1e-9), spacing)
    if len(along) > 1 and length - along[-1] < 1e-6 * spacing:
        along = along[:-1]
    places = first + np.append(along, length)[:, None] * (last - first) / length
    return Course("PROFILE", code, name, spacing, places, (), 0.0)


def grid(code: str, name: str, ends: tuple[Pair, Pair], spacing: float) -> Course:
    """Return the points of a rectangle between two corners whose X and Y are multiples of the spacing, row by row.

    Raises
    ------
    RequestError
        If there is none, or there are too many.
    """
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    _require_few(float(np.prod((high - low) / spacing)))
    columns, rows = (
        np.arange(math.ceil(a / spacing - 1e-9), math.floor(b / spacing + 1e-9) + 1)
        for a, b in zip(low.tolist(), high.tolist(), strict=True)
    )
    if not (len(columns) and len(rows)):
        message = f"no X and Y that are multiples of {spacing:g} lie between the two corners"
        raise RequestError(message)
    # there and back: the height of a place begins with that of its neighbour
    cells = [(c, r) for n, r in enumerate(rows.tolist()) for c in columns[:: 1 if n % 2 == 0 else -1].tolist()]
    names = tuple(f"{name}-{c - int(columns[0])}-{r - int(rows[0])}" for c, r in cells)
    return Course("GRID", code, name, spacing, np.array(cells, dtype=np.float64) * spacing, names, 0.0)


def contour(code: str, name: str, z: float, spacing: float) -> Course:
    """Return a contour, which begins where the mark is."""
    return Course("CONTOUR", code, name, spacing, np.empty((0, 2)), (), z)


def _require_few(count: float) -> None:
    if not count <= MOST_PLACES:
        message = f"these are more than {MOST_PLACES} places: choose a larger spacing, or a smaller part"
        raise RequestError(message)


class CourseDriver:
    """Brings the mark to what is next on a course.

    Parameters
    ----------
    processor : StereoView
    match : function
        Sets the right plate to what the left one shows, or raises an `OripError`.
    file : StereoFile
    course : Course
    """

    def __init__(self, processor: StereoView, match: Callable[[], object], file: StereoFile, course: Course) -> None:
        self.course = course
        self._processor, self._match, self._file = processor, match, file
        self.left: set[str] = set()
        """Points of a grid at which nothing matched."""
        self._slope: tuple[FloatArray, FloatArray] | None = None

    def next(self) -> Target | None:
        """Bring the mark to the next place, on the surface; None: there is none.

        Raises
        ------
        OripError
            If no height is found there: the mark is near, to be set by hand.
        """
        if self.course.kind == "CONTOUR":
            return self._next_of_contour()
        target = self._next_place()
        if target is None:
            return None
        try:
            self._height(target.xy, self._mark()[2])
        except OripError:
            if self.course.kind == "GRID":
                self.left.add(target.name)
            raise
        return target

    def next_matched(self) -> Target | None:
        """Bring the mark to the next place as `next` does; of a grid those at which nothing matches are left for later.

        Raises
        ------
        OripError
            If no height is found; of a grid, if none is at any of the places that are left.
        """
        while True:
            before = len(self.left)
            try:
                return self.next()
            except OripError as fault:
                if self.course.kind != "GRID" or len(self.left) == before:
                    if not self.left:
                        raise
                    message = f"{len(self.left)} places are left to be set by hand: {fault}"
                    raise RequestError(message) from fault

    def ahead(self) -> int | None:
        """Return how many places are ahead; None: of a contour nobody knows."""
        course = self.course
        if course.kind == "CONTOUR":
            return None
        if course.kind == "PROFILE":
            return len(course.places) - len(self._vertices())
        return len(self._lacking())

    def _next_place(self) -> Target | None:
        course = self.course
        if course.kind == "PROFILE":
            count = len(self._vertices())
            if count >= len(course.places):
                return None
            return Target(course.name, _pair(course.places[count]))
        lacking = self._lacking()
        row = next((n for n in lacking if course.names[n] not in self.left), lacking[0] if lacking else None)
        return None if row is None else Target(course.names[row], _pair(course.places[row]))

    def _lacking(self) -> list[int]:
        code = record_key(self.course.code)
        there = {one.name for one in self._file.features if record_key(one.code) == code}
        return [row for row, name in enumerate(self.course.names) if name not in there]

    def _feature(self) -> StereoFeature | None:
        last = self._file.features[-1] if self._file.features else None
        key = "LINE", record_key(self.course.code), self.course.name
        return last if last is not None and (last.kind, record_key(last.code), last.name) == key else None

    def _vertices(self) -> tuple[StereoVertex, ...]:
        feature = self._feature()
        return () if feature is None else feature.vertices

    # heights

    def _mark(self) -> Triple:
        xyz: Triple | None = self._processor.read().xyz
        if xyz is None:
            message = "the rays of the two plates do not meet; drive to a point first"
            raise RequestError(message)
        return xyz

    def _drive(self, xy: Pair, z: float) -> None:
        try:
            self._processor.drive((*xy, z))
        except LinkError as fault:
            raise RequestError(getattr(fault, "text", str(fault))) from fault
        if self._processor.read().condition != "IN":
            message = f"no model shows X {xy[0]:.3f} Y {xy[1]:.3f}"
            raise RequestError(message)

    def _height(self, xy: Pair, z: float) -> float:
        """Return the height of the surface at X and Y, where the plates are then as they were matched.

        Where the photos of the model do not match, those of another one may: its border may be farther away.
        """
        try:
            return self._height_in_model(xy, z)
        except OripError as fault:
            self._drive(xy, z)
            for model in self._processor.other_models():
                self._processor.change_model(model)
                with suppress(OripError):
                    return self._height_in_model(xy, z)
            raise fault from None

    def _height_in_model(self, xy: Pair, z: float) -> float:
        for _ in range(_HEIGHTS):
            self._drive(xy, z)
            pixel = self._processor.ground_pixel()
            self._match()
            x, y, z = self._mark()
            if math.hypot(x - xy[0], y - xy[1]) <= _STAYS * pixel[0]:
                return z
        message = "matching: the surface is too steep here for its height to be found; set the mark by hand"
        raise RequestError(message)

    # contours

    def _next_of_contour(self) -> Target | None:
        course, vertices = self.course, self._vertices()
        places = [place for vertex in vertices if (place := self._processor.project_place_of(vertex)) is not None]
        xy = np.array(places)[:, :2] if places else np.array([self._mark()[:2]])
        if len(vertices) > _FEWEST and vertices[-1] == vertices[0]:
            return None
        gradient = self._gradient(xy[-1])
        start = self._predicted(xy, gradient) if places else xy[-1]
        found = self._on_contour(start, xy[-1], gradient)
        if len(xy) >= _FEWEST and np.linalg.norm(found - xy[0]) < _CLOSED * course.spacing:
            return Target(course.name, _pair(xy[0]), vertices[0])
        self._drive(_pair(found), course.z)
        return Target(course.name, _pair(found))

    def _predicted(self, xy: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the place a step ahead of the last vertices (n, 2): along the circle through the last two."""
        uphill = gradient / np.linalg.norm(gradient)
        ahead = np.array([uphill[1], -uphill[0]])  # what is higher is on the left
        if len(xy) > 1:
            chord = xy[-1] - xy[-2]
            if chord @ ahead < 0.0:
                ahead = -ahead
            turn = math.atan2(chord[0] * ahead[1] - chord[1] * ahead[0], chord @ ahead)
            ahead = _turned(ahead, max(-_MOST_TURN, min(_MOST_TURN, turn)))
        found: FloatArray = xy[-1] + self.course.spacing * ahead
        return found

    def _gradient(self, at: FloatArray) -> FloatArray:
        """Return the slope of the surface (2,) at a place: as it was left there, else from heights around it."""
        if self._slope is not None and np.linalg.norm(self._slope[0] - at) < _REMEMBERED * self.course.spacing:
            return self._slope[1]
        step = 0.25 * self.course.spacing
        east, west, north, south = (
            self._height(_pair(at + step * np.array(way)), self.course.z) for way in ((1, 0), (-1, 0), (0, 1), (0, -1))
        )
        return np.array([east - west, north - south]) / (2.0 * step)

    def _on_contour(self, at: FloatArray, before: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the place (2,) near another one, up or down the slope, where the surface has the contour's height.

        The gradient (2,) is kept right by each height that is found (Broyden).
        """
        spacing, last, height = self.course.spacing, before, self.course.z
        for _ in range(_TRIES):
            z, way = self._height(_pair(at), self.course.z), at - last
            if np.linalg.norm(way) > _REMEMBERED * spacing:
                gradient = gradient + (z - height - gradient @ way) / (way @ way) * way
            slope, off = float(np.linalg.norm(gradient)), self.course.z - z
            if not slope >= _LEAST_SLOPE:
                message = "the surface is too flat here for a contour to be followed; go on by hand"
                raise RequestError(message)
            if abs(off) <= _STAYS * self._processor.ground_pixel()[1]:
                self._slope = at, gradient
                return at
            last, height = at, z
            at = at + max(-0.5 * spacing, min(0.5 * spacing, off / slope)) * gradient / slope
        message = f"no place of height {self.course.z:g} is found here; set the mark by hand, or close the line"
        raise RequestError(message)


def _turned(vector: FloatArray, angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def _pair(xy: FloatArray) -> Pair:
    x, y = xy.tolist()
    return x, y
