"""The pictures of the page: which photos and which places in them are shown, as far as there is room for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec import Struct, field

from orip.arrays import FloatArray, IntArray
from orip.bundle.results.compared_points import ComparedKind
from orip.interior.image_coordinates import sensor_transformation
from orip.records.camera import Sensor
from orip.records.coded_names import coded
from orip.records.observation_kinds import PHOTO_POINT
from orip.report.report_input import CHIP_PIXELS, AskedImage, GivenImage, ReportInput, camera_of_photo
from orip.structs import replace
from orip.wording import first_names

MOST_THUMBNAILS = 60
"""Of more photos those with the largest residuals are shown."""
MOST_CHIPS = 120
"""Of more rays of control and check points the worst of each point, as many of each."""
WORST = 10
"""Observations with the largest normalised residuals whose chips are shown."""


class Chip(Struct, frozen=True):
    """A detail of a photo around a measured place.

    Parameters
    ----------
    w : float
        The larger normalised residual of x and y; NaN if nothing checks them.
    measured, adjusted : arrays (2,)
        Pixels from the upper left corner of the chip.
    address : str
        Of its picture.
    """

    photo: str
    point: str
    w: float
    measured: FloatArray
    adjusted: FloatArray
    address: str = ""


class ReportPictures(Struct, frozen=True):
    """Thumbnails by photo, chips of control and check points and of the worst observations, and what is not shown."""

    thumbnails: Mapping[str, str] = field(default_factory=dict)
    of_control: tuple[Chip, ...] = ()
    of_worst: tuple[Chip, ...] = ()
    note: str = ""


_NAMED = 3
_GIVEN: tuple[ComparedKind, ...] = ("control", "check")

_Cut = tuple[Chip, IntArray]
"""A chip without its picture, and its first column and row."""


def report_pictures(given: ReportInput) -> ReportPictures:
    """Return the pictures of the photos whose images are known; nothing where the report has no source of pictures."""
    if given.pictures is None:
        return ReportPictures()
    shown = _photos(given)
    control, worst = _cuts(given, _rows_of_control(given)), _cuts(given, _worst_rows(given))
    corners: dict[str, list[IntArray]] = {}
    for chip, corner in (*control, *worst):
        corners.setdefault(chip.photo, []).append(corner)
    asked = [
        AskedImage(photo, photo in shown, np.array(corners.get(photo, []), dtype=np.int64).reshape(-1, 2))
        for photo in given.solution.photos.names
        if photo in shown or photo in corners
    ]
    found = dict(zip((one.photo for one in asked), given.pictures(asked), strict=True))
    left = {photo: iter(one.chips) for photo, one in found.items()}
    of_control, of_worst = (
        tuple(replace(chip, address=address) for chip, _ in cuts if (address := next(left[chip.photo], "")))
        for cuts in (control, worst)
    )
    thumbnails = {photo: one.thumbnail for photo, one in found.items() if one.thumbnail}
    return ReportPictures(thumbnails, of_control, of_worst, _note(given, found))


def _photos(given: ReportInput) -> set[str]:
    """Return the photos that get a thumbnail, those with the largest residuals first."""
    known = [name for name in given.photo_vectors if _sensor(given, name) is not None]
    return set(sorted(known, key=lambda name: -given.photo_vectors[name].rms)[:MOST_THUMBNAILS])


def _sensor(given: ReportInput, photo: str) -> Sensor | None:
    camera = camera_of_photo(given, photo)
    return None if camera is None else camera.sensor


def _photo_rows(given: ReportInput) -> tuple[IntArray, FloatArray]:
    """Return the rows of the residuals x of photo points, and the larger w of x and y, NaN where neither is tested."""
    residuals = given.solution.residuals
    rows = np.flatnonzero(coded(residuals.kind).where(PHOTO_POINT.name.__eq__))[::2]
    return rows, np.fmax(residuals.w[rows], residuals.w[rows + 1])  # x and y are in successive rows


def _worst_rows(given: ReportInput) -> list[int]:
    rows, w = _photo_rows(given)
    order = np.argsort(-np.nan_to_num(w, nan=-1.0), kind="stable")[:WORST]
    return [int(rows[at]) for at in order if np.isfinite(w[at])]


def _rows_of_control(given: ReportInput) -> list[int]:
    """Return the rows of control and check points, point by point, those with the largest w first."""
    names = [name for kind in _GIVEN for name in given.compared[kind].names]
    if not names:
        return []
    rows, w = _photo_rows(given)
    place = coded(given.solution.residuals.point)[rows].places({name: at for at, name in enumerate(names)})
    most = max(1, MOST_CHIPS // len(names))
    found: list[int] = []
    for at in range(min(len(names), MOST_CHIPS)):
        own = np.flatnonzero(place == at)
        order = np.argsort(-np.nan_to_num(w[own], nan=-1.0), kind="stable")[:most]
        found += rows[own[order]].tolist()
    return found


def _cuts(given: ReportInput, rows: Sequence[int]) -> list[_Cut]:
    """Return the chips of photo points, by the rows of their x, without their pictures."""
    residuals = given.solution.residuals
    found = []
    for row in rows:
        sensor = _sensor(given, residuals.photo[row])
        if sensor is None:
            continue
        to_pixels = sensor_transformation(sensor).inverse()
        measured = residuals.observed[row : row + 2]
        places = to_pixels.apply(np.array([measured, measured + residuals.residual[row : row + 2]]))
        most = np.maximum(np.array([sensor.columns, sensor.rows]) - CHIP_PIXELS, 0)
        corner = np.clip(np.floor(places[0]).astype(np.int64) - CHIP_PIXELS // 2, 0, most)
        w = float(np.fmax(residuals.w[row], residuals.w[row + 1]))
        found.append((Chip(residuals.photo[row], residuals.point[row], w, *(places - corner)), corner))
    return found


def _note(given: ReportInput, found: Mapping[str, GivenImage]) -> str:
    """Return what is not shown."""
    notes = []
    count = len(given.solution.photos.names)
    if len(found) < count and (shown := sum(bool(one.thumbnail) for one in found.values())):
        notes.append(f"The images of {shown} of {count} photos are shown: those with the largest residuals.")
    faults = {photo: one.fault for photo, one in found.items() if one.fault}
    if faults:
        names = first_names(list(faults), _NAMED)
        notes.append(f"No image is shown of {names}: {next(iter(faults.values()))}.")
    return " ".join(notes)
