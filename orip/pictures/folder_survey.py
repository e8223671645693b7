"""Which images of a folder are photos for a project, of which cameras, and which are left out and why."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.errors import InputError
from orip.files.exif import DAMAGED, Exposure, ImageTags, exposure_of, image_tags
from orip.files.image_cameras import ImageCamera, camera_of
from orip.files.text.regular_file import file_digest, natural_key
from orip.images.image_files import IMAGE_ENDINGS, Grey, ImageHeader, read_grey, read_header
from orip.progress import stage
from orip.structs import replace
from orip.wording import first_names

_SCREENS = frozenset({
    (1024, 768), (1280, 720), (1280, 800), (1280, 1024), (1366, 768), (1440, 900), (1600, 900), (1680, 1050),
    (1920, 1080), (1920, 1200), (2560, 1440), (2560, 1600), (2880, 1800), (3840, 2160), (1136, 640), (1334, 750),
    (1792, 828), (2160, 1080), (2340, 1080), (2400, 1080), (2436, 1125), (2532, 1170), (2778, 1284),
})  # fmt: skip
"""Pixels of usual screens, the longer side first."""

_BLURRED = 0.15
"""Sharpness over the median of its camera, below which a photo is blurred."""
_FEWEST_COMPARED = 4
_SAME_GREY, _SAME_SHARE = 2.0, 0.1
"""Mean difference of grey values, and its share of their standard deviation, of a picture that was compressed again."""
_COMPARED_SIDE = 32
_LONGEST = 3.0
"""Longer over shorter side: frames of cameras have up to 2.7."""
_EXAMINED_WIDTH = 2000
"""Columns, about, of the reduced image in which sharpness is looked at."""
_BETWEEN_FLIGHTS_S = 1800.0


class SurveyedPhoto(Struct, frozen=True):
    """An image that is a photo, or why it is left out (`fault`, empty else)."""

    path: Path
    camera: ImageCamera
    exposure: Exposure
    orientation: int
    sharpness: float
    digest: str
    small: NDArray[np.float32]
    fault: str = ""


class Survey(Struct, frozen=True):
    """What is in a folder.

    Parameters
    ----------
    photos : tuple of SurveyedPhoto
        In natural order of their names.
    left_out : tuple of (Path, str)
        Images that are not used, and why.
    notes : tuple of str
        What there is to know of the photos that are used.
    """

    photos: tuple[SurveyedPhoto, ...]
    left_out: tuple[tuple[Path, str], ...]
    notes: tuple[str, ...]


_ENDINGS_OF_OTHERS = frozenset({
    ".heic", ".heif", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf", ".webp", ".avif", ".jp2", ".bmp",
})  # fmt: skip
_OF_OTHERS = f"not one of the images that orip reads ({', '.join(IMAGE_ENDINGS)}); export it as one of them"


def _instead(found: Sequence[Path]) -> str:
    """Say which images of other kinds, and which folders with images, are there instead."""
    others = sorted({path.suffix for path in _of_others(found)})
    folders = [path for path in found if path.is_dir() and any(_is_image(one) for one in path.iterdir())]
    text = f"; export {' and '.join(others)} as one of them" if others else ""
    return text + (
        f"; name one of the folders in it: {first_names([one.name for one in folders], 3)}" if folders else ""
    )


def _of_others(found: Sequence[Path]) -> list[Path]:
    return [path for path in found if path.suffix.lower() in _ENDINGS_OF_OTHERS and not path.name.startswith(".")]


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in IMAGE_ENDINGS and not path.name.startswith(".")


def survey_folder(folder: Path, sensor_width: float | None = None) -> Survey:
    """Examine the images of a folder.

    Raises
    ------
    InputError
        If it is no folder, or no image in it can be used.
    """
    try:
        found = sorted(folder.iterdir(), key=lambda path: natural_key(path.name))
    except OSError as error:
        message = f"the folder cannot be read ({error.strerror}); name the folder of the photographs"
        raise InputError.single(message, str(folder)) from None
    paths = list(filter(_is_image, found))
    if not paths:
        message = f"there is no image in this folder; orip reads {', '.join(IMAGE_ENDINGS)}{_instead(found)}"
        raise InputError.single(message, str(folder))
    photos, left_out = [], []
    with stage("photos", len(paths)) as advance:
        for count, path in enumerate(paths, 1):
            try:
                photos.append(_examined(path, sensor_width))
            except InputError as error:
                left_out.append((path, error.complaints[0].message))
            advance(count)
    judged = list(_judged(photos))
    left_out += [(photo.path, photo.fault) for photo in judged if photo.fault]
    used = tuple(photo for photo in judged if not photo.fault)
    if not used:
        reasons = "; ".join(f"{path.name}: {fault}" for path, fault in left_out[:3])
        message = f"none of {len(paths)} images can be used ({reasons})"
        raise InputError.single(message, str(folder))
    known = {path.stem.lower() for path in paths}  # cameras write raw images beside their JPEG
    left_out += [(path, _OF_OTHERS) for path in _of_others(found) if path.stem.lower() not in known]
    order = {path: number for number, path in enumerate(found)}
    left_out.sort(key=lambda one: order[one[0]])
    return Survey(used, tuple(left_out), tuple(_notes(used)))


def _examined(path: Path, sensor_width: float | None) -> SurveyedPhoto:
    header = read_header(path, path.name)
    tags, exposure = _tags(path)
    reduction = next((n for n in (1, 2, 4) if header.columns // n <= _EXAMINED_WIDTH), 8)
    grey = read_grey(path, None, reduction, path.name)
    camera = camera_of(tags, header.columns, header.rows, sensor_width)
    return SurveyedPhoto(
        path, camera, exposure, header.orientation, _sharpness(grey), file_digest(path), _small(grey),
        _no_exposure(header, camera),
    )  # fmt: skip


def _small(grey: Grey) -> NDArray[np.float32]:
    """Return mean grey values of squares, some 32 along the shorter side: as good as free of compression."""
    side = max(1, min(grey.shape) // _COMPARED_SIDE)
    rows, columns = (length // side for length in grey.shape)
    squares = grey[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return np.asarray(squares.mean(axis=(1, 3)) * (1.0 if grey.dtype == np.uint8 else 1.0 / 256.0), dtype=np.float32)


def _tags(path: Path) -> tuple[ImageTags, Exposure]:
    """Return the tags of an image; none where they are damaged, which does not keep it from being measured."""
    try:
        tags = image_tags(path)
        return tags, exposure_of(tags)
    except DAMAGED:
        nothing = ImageTags({}, {})
        return nothing, exposure_of(nothing)


def _no_exposure(header: ImageHeader, camera: ImageCamera) -> str:
    """Say why an image is none that a camera took at once; empty if nothing speaks against it."""
    size = (max(header.columns, header.rows), min(header.columns, header.rows))
    if size[0] > _LONGEST * size[1]:
        return f"it has {header.columns} x {header.rows} pixels: a panorama or strip, which is no central projection"
    if camera.model or camera.lens or size not in _SCREENS:
        return ""
    return f"it has no camera in EXIF and the size of a screen, {size[0]} x {size[1]}: probably a screenshot"


def _sharpness(grey: Grey) -> float:
    """Return the variance of the Laplacian over that of the grey values, which does not depend on the contrast."""
    values = grey.astype(np.float32)
    laplacian = 4.0 * values[1:-1, 1:-1]
    for beside in (values[:-2, 1:-1], values[2:, 1:-1], values[1:-1, :-2], values[1:-1, 2:]):
        laplacian -= beside
    return float(laplacian.var() / max(float(values.var()), 1e-6))


def _judged(photos: Sequence[SurveyedPhoto]) -> Iterator[SurveyedPhoto]:
    """Yield photos with what is wrong when they are compared: duplicates, and blurred ones."""
    of_camera: dict[tuple[str, int, int], list[float]] = defaultdict(list)
    for photo in photos:
        of_camera[_body(photo)].append(photo.sharpness)
    firsts: list[SurveyedPhoto] = []
    for photo in photos:
        fault = photo.fault
        twin = None if fault else next((first for first in firsts if _is_same(first, photo)), None)
        others = of_camera[_body(photo)]
        if twin is not None:
            fault = f"it is the same picture as {twin.path.name}"
        elif not fault and len(others) >= _FEWEST_COMPARED and photo.sharpness < _BLURRED * float(np.median(others)):
            percent = 100.0 * photo.sharpness / float(np.median(others))
            fault = f"it is blurred: its sharpness is {percent:.0f} % of the median of the photos of its camera"
        if not fault:
            firsts.append(photo)
        yield replace(photo, fault=fault) if fault else photo


def _body(photo: SurveyedPhoto) -> tuple[str, int, int]:
    return photo.camera.model, photo.camera.columns, photo.camera.rows


def _is_same(one: SurveyedPhoto, other: SurveyedPhoto) -> bool:
    """Tell whether two files are one picture: of the same bytes, or of the same content and not of two moments."""
    if one.digest == other.digest:
        return True
    times = one.exposure.time, other.exposure.time
    if (all(map(math.isfinite, times)) and times[0] != times[1]) or one.small.shape != other.small.shape:
        return False
    difference = float(np.mean(np.abs(one.small - other.small)))
    return difference < min(_SAME_GREY, _SAME_SHARE * float(one.small.std()))


def _notes(photos: Sequence[SurveyedPhoto]) -> Iterator[str]:
    bare = [photo for photo in photos if not (photo.camera.model or photo.camera.lens)]
    if bare:
        yield f"{_named(bare)}: no camera in EXIF; they have a camera record of their own"
    turned = [photo for photo in photos if photo.orientation != 1]
    if turned:
        yield f"{_named(turned)}: shown turned by EXIF's orientation; what is measured are pixels as they are stored"
    sizes = {_body(photo) for photo in photos}
    upright = [photo for photo in photos if photo.camera.columns < photo.camera.rows]
    swapped = [photo for photo in upright if (photo.camera.model, photo.camera.rows, photo.camera.columns) in sizes]
    if swapped:
        yield f"{_named(swapped)}: their pixels were turned by a program; they have a camera record of their own"
    sessions = sorted(set(sessions_of(photos).values()))
    if len(sessions) > 1:
        yield f"{len(sessions)} flights or sessions by their times, with half an hour and more between them"


def _named(photos: Sequence[SurveyedPhoto], most: int = 3) -> str:
    names = ", ".join(photo.path.name for photo in photos[:most])
    return f"{names} and {len(photos) - most} more" if len(photos) > most else names


def sessions_of(photos: Iterable[SurveyedPhoto]) -> dict[Path, int]:
    """Return the number of the session (1 ...) of each photo by its path; none where its time is not known."""
    timed = sorted((photo.exposure.time, photo.path) for photo in photos if math.isfinite(photo.exposure.time))
    found: dict[Path, int] = {}
    number, last = 0, math.nan
    for time, path in timed:
        number += not time - last <= _BETWEEN_FLIGHTS_S
        found[path], last = number, time
    return found
