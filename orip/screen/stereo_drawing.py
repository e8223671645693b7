"""Features and adjusted points as they are seen in the rectified photos of a model; and what drives the mark."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from orip.arrays import FloatArray
from orip.files.log.stereo import StereoFile
from orip.records.measurement import StereoFeature, StereoVertex
from orip.web.page_server import Document

Triple = tuple[float, float, float]

_MOST_VERTICES = 5000
"""That are drawn: of more, those of the features that were measured last."""

_MOST_POINTS = 2000


class StereoView(Protocol):
    """A plate processor with rectified photos, as `orip.multimodel.stereo_processor` makes it.

    Movements raise a `LinkError` with a `text` where it refuses.
    """

    points: Mapping[str, Triple]

    @property
    def block(self) -> Any:
        """Return the block that is driven in, with `models`."""

    def photo_names(self, model: int) -> tuple[str, str]:
        """Return the names of the left and right photo of a model."""

    def rectified(self, model: int) -> Any:
        """Return a model with its photos rectified."""

    def read(self) -> Any:
        """Return where everything is."""

    def vertex(self) -> StereoVertex:
        """Return what is measured."""

    def place_of(self, vertex: StereoVertex) -> Triple | None:
        """Return where the rays of a vertex meet, in the object system."""

    def local(self, xyz: FloatArray) -> FloatArray:
        """Return points (n, 3) of the project in the object system."""

    def drive(self, xyz: Triple) -> None:
        """Drive to a point of the project."""

    def move(self, right: float, up: float, higher: float) -> None:
        """Move by pixels of the rectified photos in the guiding system."""

    def set_plate(self, side: int, log: tuple[float, float]) -> None:
        """Drive the plate of the left (0) or right photo."""

    def change_model(self, name: str) -> None:
        """Change to a model."""

    def next_model(self) -> None:
        """Change to the next model."""

    def other_models(self) -> list[str]:
        """Return the names of the other models that show the mark, farthest from their borders first."""

    def guide(self, system: Any) -> None:
        """Choose the guiding system."""

    def automatic(self, on: bool) -> None:
        """Let models change at frame lines, or not."""

    def project_place_of(self, vertex: StereoVertex) -> Triple | None:
        """Return `place_of`, in the project."""

    def ground_pixel(self) -> tuple[float, float]:
        """Return what a rectified pixel is at the mark, ground units: across, and as x-parallax in height."""

    def go_to_vertex(self, vertex: StereoVertex) -> None:
        """Set the plates to what was measured."""

    def transfer_to_right(self) -> Any:
        """Return where the right image is expected to show what the left plate is at."""


class Near(NamedTuple):
    """A vertex that was measured, or an adjusted point; and what it is called."""

    shown: str
    vertex: StereoVertex | None


class StereoDrawing:
    """What lies over the photos.

    Parameters
    ----------
    processor : StereoView
    file : StereoFile
    """

    def __init__(self, processor: StereoView, file: StereoFile) -> None:
        self._processor, self._file = processor, file
        self._names = tuple(processor.points)
        self._points = processor.local(np.array(list(processor.points.values())).reshape(-1, 3))
        self._places: dict[StereoVertex, Triple | None] = {}

    def serial(self) -> list[int]:
        """Return what is another one whenever features have changed."""
        features = self._file.features
        return [len(features), len(features[-1].vertices) if features else 0]

    def drawn(self, model: int) -> Document:
        """Return the features and points that a model's photos show: columns and rows in the left and right one."""
        pair, names = self._processor.rectified(model), self._names
        sides = [pair.places(side, self._points) for side in (0, 1)]
        shown = np.flatnonzero(np.all([self._inside(pair, side, sides[side]) for side in (0, 1)], axis=0))[
            :_MOST_POINTS
        ]
        return {
            "model": model,
            "serial": self.serial(),
            "features": list(self._features(pair)),
            "points": [[names[row], *(side[row].round(2).tolist() for side in sides)] for row in shown.tolist()],
        }

    def _features(self, pair: Any) -> Iterator[Document]:
        count = 0
        for feature in reversed(self._file.features):
            count += len(feature.vertices)
            if count > _MOST_VERTICES:
                return
            found = [place for vertex in feature.vertices if (place := self._place(vertex)) is not None]
            if not found:
                continue
            sides = [pair.places(side, np.array(found)) for side in (0, 1)]
            if any(self._inside(pair, 0, sides[0])):
                yield _drawn_feature(feature, sides)

    def _place(self, vertex: StereoVertex) -> Triple | None:
        if vertex not in self._places:
            self._places[vertex] = self._processor.place_of(vertex)
        return self._places[vertex]

    def nearest(self, reading: Any, within: float) -> Near | None:
        """Return the vertex or adjusted point that is seen nearest to the mark in both photos, within so many pixels.

        The last vertex that was recorded is none: it is where the mark comes from.
        """
        pair, vertices = self._processor.rectified(reading.model), list(self._vertices())
        near: list[tuple[float, int, Near]] = []
        places = np.array([place for _, place in vertices]).reshape(-1, 3)
        for found, shown in ((places, [one for one, _ in vertices]), (self._points, self._names)):
            off = [np.linalg.norm(pair.places(side, found) - reading.places[side], axis=1) for side in (0, 1)]
            apart = np.max(off, axis=0)
            for row in np.flatnonzero(apart <= within).tolist():
                one = shown[row]
                near.append((float(apart[row]), len(near), one if isinstance(one, Near) else Near(one, None)))
        return min(near)[2] if near else None

    def _vertices(self) -> Iterator[tuple[Near, Triple]]:
        features = self._file.features
        for feature in features:
            last = len(feature.vertices) - (feature is features[-1] and feature.kind != "POINT")
            for number, vertex in enumerate(feature.vertices[:last], start=1):
                if (place := self._place(vertex)) is not None:
                    yield Near(f"{feature.kind} {feature.code} {feature.name}, vertex {number}", vertex), place

    @staticmethod
    def _inside(pair: Any, side: int, places: FloatArray) -> Any:
        with np.errstate(invalid="ignore"):
            return ((places >= 0.0) & (places <= [pair.columns[side], pair.rows])).all(axis=1)


def _drawn_feature(feature: StereoFeature, sides: list[FloatArray]) -> Document:
    left, right = (np.where(np.isfinite(side), side, -1e6).round(2).tolist() for side in sides)
    return {"kind": feature.kind, "code": feature.code, "name": feature.name, "left": left, "right": right}
