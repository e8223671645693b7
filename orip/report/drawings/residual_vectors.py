"""Residual vectors of photo points, photo by photo, and their means by camera, which show systematic errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from markupsafe import Markup
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.interior.mounting import frame_corners
from orip.records.camera import Sensor
from orip.records.names import record_key
from orip.report.drawings.svg import drawing, element, number, numbers, round_step, text
from orip.report.report_input import PhotoVectors, ReportInput
from orip.report.table import counted, probability

MOST_PHOTOS = 12
"""Most photos that stand out and are drawn by themselves."""
FEWEST_PHOTOS = 3
"""Photos with the largest residuals that are drawn although none stands out."""
MOST_VECTORS = 250
CELLS = 6
"""Cells along the longer side of the frame in which the mean residual is taken."""

_PHOTOS_AT_ONCE = 32
_FEWEST = 3
_LENGTH = 0.10
"""Length of a large residual in the drawing, as a part of the longer side of the frame."""

_PIXELS, _MEAN_PIXELS, _MARGIN = 216.0, 400.0, 10.0
_ALPHA = 0.01
_LOST = 0.1
"""Share of a photo's points that have lost weight, above that of the median photo, from which it stands out."""
_MOST_TOGETHER = 1500
_NO_PICTURES: Mapping[str, str] = {}


class CellMeans(Struct, frozen=True):
    """Mean residuals of a camera's photo points in the cells of a grid over its frame.

    Parameters
    ----------
    centre, mean : arrays (k, 2), mm
    count : array (k,)
    p : float
        Probability of means so large, or larger, by chance if residuals are independent.
    """

    centre: FloatArray
    mean: FloatArray
    count: IntArray
    p: float


class VectorSheet(Struct, frozen=True):
    """Drawings of one camera: all its photos together, their mean, the photos that stand out, and what was left out."""

    camera: str
    together: Markup
    mean: Markup
    finding: str
    photos: tuple[tuple[str, Markup], ...]
    note: str


def photo_anchors(sheets: Sequence[VectorSheet]) -> dict[str, str]:
    """Return the ids of the figures of photos, by the photos' names."""
    names = [name for sheet in sheets for name, _ in sheet.photos]
    return {name: f"residuals-{number}" for number, name in enumerate(names, start=1)}


def measured_reach(given: ReportInput, camera: str) -> float:
    """Return the largest distance (mm) of a camera's photo points from the fiducial centre; 0 without any."""
    return given.reaches.get(record_key(camera), 0.0)


def cell_means(vectors: Sequence[PhotoVectors], low: FloatArray, high: FloatArray) -> CellMeans | None:
    """Return the mean residuals in square cells between two corners of the frame; None where points are too few."""
    from scipy.special import gammaincc

    points = sum(int(np.count_nonzero(photo.sound)) for photo in vectors)
    if points <= _FEWEST:
        return None
    shape = np.maximum(np.round((high - low) / (np.max(high - low) / CELLS)).astype(np.int64), 1)
    count, total, squares = np.zeros(shape.prod(), dtype=np.int64), np.zeros((shape.prod(), 2)), 0.0
    for some in (vectors[first : first + _PHOTOS_AT_ONCE] for first in range(0, len(vectors), _PHOTOS_AT_ONCE)):
        xy = np.concatenate([photo.sound_xy for photo in some])
        residual = np.concatenate([photo.sound_residual for photo in some])
        cell = np.clip(((xy - low) / (high - low) * shape).astype(np.int64), 0, shape - 1)
        place = cell[:, 0] * shape[1] + cell[:, 1]
        count += np.bincount(place, minlength=len(count))
        total += np.stack([np.bincount(place, residual[:, axis], len(count)) for axis in (0, 1)], axis=1)
        squares += float(np.vdot(residual, residual))
    full = np.flatnonzero(count >= _FEWEST)
    variance = squares / (2 * points)
    if not full.size or variance <= 0.0:
        return None
    mean = total[full] / count[full, None]
    statistic = float(np.sum(count[full, None] * mean**2) / variance)
    corner = np.stack(np.divmod(full, shape[1]), axis=1)
    centre = low + (corner + 0.5) / shape * (high - low)
    return CellMeans(centre, mean, count[full], float(gammaincc(full.size, statistic / 2.0)))


def vector_sheets(
    given: ReportInput, *, single: bool = True, thumbnails: Mapping[str, str] = _NO_PICTURES
) -> tuple[VectorSheet, ...]:
    """Return the drawings of each camera that has photo points.

    Parameters
    ----------
    single : bool
        Also of photos by themselves, those that stand out and those that have a thumbnail.
    thumbnails : mapping of str to str
        Addresses of pictures of photos, by the photos' names; residuals are drawn upon them.
    """
    sheets = (_sheet(given, name, thumbnails, single=single) for name in given.solution.cameras.names)
    return tuple(sheet for sheet in sheets if sheet is not None)


def _sheet(given: ReportInput, camera: str, thumbnails: Mapping[str, str], *, single: bool) -> VectorSheet | None:
    vectors = _of_camera(given, camera)
    if not vectors:
        return None
    low, high = frame_extent(given, camera, vectors)
    large = large_residual(vectors)
    alone = {photo.photo for photo in outstanding(vectors)} | set(thumbnails) if single else set()
    shown = [photo for photo in vectors if photo.photo in alone]
    frame = _Frame(low, high, _PIXELS, large)
    means = cell_means(vectors, low, high)
    notes = []
    if len(shown) < len(vectors):
        notes.append(
            f"{counted(len(shown), 'photo')} of {len(vectors)} drawn: those whose residuals stand out, and at least "
            f"the {FEWEST_PHOTOS} with the largest."
        )
    if any(len(photo.xy) > MOST_VECTORS for photo in shown):
        notes.append(
            f"At most {MOST_VECTORS} vectors a photo are drawn: a regular sample, and all that are down-weighted."
        )
    record = given.cameras.get(record_key(camera))
    sensor = None if record is None else record.sensor
    grounds = {} if sensor is None else {name: frame.picture(address, sensor) for name, address in thumbnails.items()}
    motions = {one.photo: f", motion {one.pixels:.1f} px" for one in given.solution.motions}
    drawn = tuple(
        (one.photo, _photo_drawing(one, frame, ground=grounds.get(one.photo, ""), motion=motions.get(one.photo, "")))
        for one in shown
    )
    together = _photo_drawing(_together(vectors), _Frame(low, high, _MEAN_PIXELS, large), "all photos")
    mean = _mean_drawing(camera, means, low, high) if means is not None else Markup("")
    return VectorSheet(camera, together, mean, _finding(means) if means is not None else "", drawn, " ".join(notes))


def outstanding(vectors: Sequence[PhotoVectors]) -> list[PhotoVectors]:
    """Return the photos whose residuals are larger than those of the others by more than chance, in their order.

    With 2 n components of one standard deviation, 2 n rms² / variance is chi-square distributed on about 2 n degrees of
    freedom; the variance is that of the median photo. A photo in which points have lost weight stands out by a share of
    them above that of the others.
    """
    from scipy.special import gammaincc

    rms = np.array([photo.rms for photo in vectors])
    points = np.array([max(np.count_nonzero(photo.sound), 1) for photo in vectors])
    lost = np.array([1.0 - np.count_nonzero(photo.sound) / max(len(photo.sound), 1) for photo in vectors])
    variance = float(np.median(rms[rms > 0.0])) ** 2 if (rms > 0.0).any() else 1.0
    p = gammaincc(points, points * rms**2 / variance)
    stands_out = (p < _ALPHA / len(vectors)) | (lost > np.median(lost) + _LOST)
    score = np.where(stands_out, 1e3, 0.0) * (1.0 + lost) + rms / np.sqrt(variance)
    most = min(max(int(stands_out.sum()), FEWEST_PHOTOS), MOST_PHOTOS)
    return [vectors[row] for row in np.sort(np.argsort(-score, kind="stable")[:most]).tolist()]


def _together(vectors: Sequence[PhotoVectors]) -> PhotoVectors:
    """Return the residuals of all photos in one frame, of very many a regular sample."""
    every = -(-sum(len(photo.xy) for photo in vectors) // _MOST_TOGETHER)
    xy, residual, sound = (
        np.concatenate([getattr(photo, name) for photo in vectors])[::every] for name in ("xy", "residual", "sound")
    )
    return PhotoVectors("", xy, residual, sound)


def _finding(means: CellMeans) -> str:
    what = f"The means of {counted(int(means.count.sum()), 'photo point')} in {counted(len(means.count), 'cell')}"
    p = probability(means.p)
    if means.p < _ALPHA:
        pattern = "there is a systematic pattern that the camera model does not describe"
        return f"{what} are larger than expected by chance (p {p}): {pattern}."
    return f"{what} are as expected by chance (p {p}): no systematic pattern."


def _of_camera(given: ReportInput, camera: str) -> list[PhotoVectors]:
    found = given.photo_vectors
    mine = {key for key, photo in given.photos.items() if record_key(photo.camera) == record_key(camera)}
    return [found[name] for name in given.solution.photos.names if record_key(name) in mine and name in found]


def frame_extent(given: ReportInput, camera: str, vectors: Sequence[PhotoVectors]) -> tuple[FloatArray, FloatArray]:
    """Return the corners of what is drawn: the frame, and all that was measured."""
    low = np.array([min(photo.xy[:, axis].min() for photo in vectors) for axis in (0, 1)])
    high = np.array([max(photo.xy[:, axis].max() for photo in vectors) for axis in (0, 1)])
    record = given.cameras.get(record_key(camera))
    corners = frame_corners(record) if record is not None else None
    if corners is not None:
        low, high = np.minimum(low, corners[0]), np.maximum(high, corners[1])
    flat = np.maximum(1e-9, 0.05 * np.max(high - low)) * (high - low <= 0.0)
    return low - flat, high + flat


def large_residual(vectors: Sequence[PhotoVectors]) -> float:
    """Return a large residual (mm) of the sound points: 95 of 100 are smaller."""
    sound = [photo.sound_residual for photo in vectors]
    squares = np.concatenate([np.einsum("ij,ij->i", residual, residual) for residual in sound])
    return float(np.sqrt(np.quantile(squares, 0.95))) if squares.size else 0.0


class _Frame(Struct, frozen=True):
    """A photo's frame in a drawing: corners (mm), pixels of its longer side, the residual drawn at `_LENGTH`."""

    low: FloatArray
    high: FloatArray
    pixels: float
    large: float

    @property
    def scale(self) -> float:
        return self.pixels / float(np.max(self.high - self.low))

    @property
    def size(self) -> tuple[float, float]:
        width, height = ((self.high - self.low) * self.scale).tolist()
        return width, height

    @property
    def enlargement(self) -> float:
        """Return how many times larger residuals are drawn than the frame, a round number."""
        if self.large <= 0.0:
            return 1.0
        return round_step(_LENGTH * self.pixels / self.scale / self.large, 1) / 2.0

    def place(self, xy: FloatArray) -> FloatArray:
        """Return pixels (n, 2); y points up in a photo."""
        x = _MARGIN + (xy[:, 0] - self.low[0]) * self.scale
        y = _MARGIN + (self.high[1] - xy[:, 1]) * self.scale
        return np.stack([x, y], axis=1)

    def vectors(self, xy: FloatArray, residual: FloatArray) -> str:
        """Return the path of residual vectors."""
        start = self.place(xy)
        shift = residual * self.scale * self.enlargement * (1.0, -1.0)
        length = np.hypot(*shift.T)[:, None]
        most = 0.5 * self.pixels
        shift = np.where(length > most, shift * most / np.maximum(length, 1e-12), shift)
        found = iter(numbers(np.concatenate([start, shift], axis=1).ravel().tolist()))
        return "".join([f"M{x} {y}l{dx} {dy}" for x, y, dx, dy in zip(found, found, found, found, strict=True)])

    def picture(self, address: str, sensor: Sensor) -> str:
        """Return the picture of a photo, as large as its sensor."""
        half = np.array([sensor.width, sensor.height]) / 2.0
        (left, top), (right, bottom) = self.place(np.array([half * (-1.0, 1.0), half * (1.0, -1.0)])).tolist()
        return element(
            "image", href=address, x=left, y=top, width=right - left, height=bottom - top, preserveAspectRatio="none"
        )  # fmt: skip

    def border(self) -> str:
        width, height = self.size
        return element("rect", x=_MARGIN, y=_MARGIN, width=width, height=height, class_="frame")

    def scale_bar(self, y: float) -> Iterator[str]:
        """Return a scale bar for residuals, of a round number of micrometres."""
        micrometres = round_step(0.25 * self.pixels / self.scale / self.enlargement * 1e3, 1) / 2.0
        length = micrometres * 1e-3 * self.scale * self.enlargement
        yield element("path", d=f"M{number(_MARGIN)} {number(y)}h{number(length)}", class_="bar")
        yield text(_MARGIN + length + 5.0, y + 4.0, f"{micrometres:g} µm")


def _photo_drawing(vectors: PhotoVectors, frame: _Frame, name: str = "", ground: str = "", motion: str = "") -> Markup:
    width, height = frame.size
    chosen = np.ones(len(vectors.xy), dtype=bool) if name else _thinned(vectors)
    name = name or f"photo {vectors.photo}"
    sound, doubtful = chosen & vectors.sound, chosen & ~vectors.sound
    base = height + 2 * _MARGIN + 10.0
    rms = f"RMS {1e3 * vectors.rms:.1f} µm"
    parts = [
        ground,
        frame.border(),
        element("path", d=_dots(frame.place(vectors.xy[chosen])), class_="feet"),
        *(
            element("path", d=frame.vectors(vectors.xy[part], vectors.residual[part]), class_=style)
            for part, style in ((sound, "vector"), (doubtful, "vector bad"))
            if part.any()
        ),
        *frame.scale_bar(base),
        text(width + _MARGIN, base + 4.0, rms, text_anchor="end"),
        text(_MARGIN, base + 20.0, f"{name}, {counted(len(vectors.xy), 'point')}{motion}", class_="label"),
    ]
    label = f"Residual vectors of {name}, {rms}{motion}"
    return drawing(width + 2 * _MARGIN, base + 28.0, label, parts, "vectors on-picture" if ground else "vectors")


def _mean_drawing(camera: str, means: CellMeans, low: FloatArray, high: FloatArray) -> Markup:
    large = float(np.hypot(*means.mean.T).max(initial=0.0))
    frame = _Frame(low, high, _MEAN_PIXELS, large)
    width, height = frame.size
    places = frame.place(means.centre).tolist()
    parts: list[str] = [
        frame.border(),
        element("path", d=_dots(frame.place(means.centre)), class_="feet"),
        element("path", d=frame.vectors(means.centre, means.mean), class_="vector mean"),
        # the number is on the side opposite to the vector
        *(text(x, y + (14.0 if up >= 0.0 else -6.0), str(count), text_anchor="middle", class_="faint")
          for (x, y), up, count in zip(places, means.mean[:, 1].tolist(), means.count.tolist(), strict=True)),
        *frame.scale_bar(height + 2 * _MARGIN + 8.0),
    ]  # fmt: skip
    label = f"Mean residuals of camera {camera} in parts of its frame, with the number of photo points"
    return drawing(width + 2 * _MARGIN, height + 2 * _MARGIN + 22.0, label, parts, "vectors")


def _thinned(vectors: PhotoVectors) -> NDArray[np.bool_]:
    count = len(vectors.xy)
    every = -(-count // MOST_VECTORS)
    return np.asarray((np.arange(count) % every == 0) | ~vectors.sound)


def _dots(places: FloatArray) -> str:
    found = iter(numbers(places.ravel().tolist()))
    return "".join([f"M{x} {y}h0" for x, y in zip(found, found, strict=True)])
