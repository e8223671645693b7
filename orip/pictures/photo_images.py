"""Which image belongs to which photo of a project, and its grey values as stored."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from orip.errors import Complaint, UsageError
from orip.files.text.regular_file import open_regular
from orip.records.names import record_key

if TYPE_CHECKING:
    from PIL.Image import Image

ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
MOST_PIXELS = 200_000_000
_MODES = frozenset({"1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "YCbCr", "I;16", "I;16B", "I;16L"})


def require_packages() -> None:
    """Say what to install where packages for images are missing.

    Raises
    ------
    UsageError
    """
    try:
        import cv2  # noqa: F401
        import PIL  # noqa: F401
        import pycolmap  # noqa: F401
    except ImportError as error:
        message = f"matching needs the package {error.name}, which is not installed: pip install 'orip[images]'"
        raise UsageError(message) from error


def images_by_photo(folder: Path, photos: Iterable[str]) -> tuple[dict[str, Path], list[Complaint]]:
    """Return the image files of a folder that are named as photos are, and what is wrong.

    Parameters
    ----------
    folder : Path
    photos : iterable of str
        Names; case does not count.
    """
    try:
        with os.scandir(folder) as entries:
            names = sorted(entry.name for entry in entries)
    except OSError as error:
        return {}, [Complaint(f"the folder cannot be read ({error.strerror})", str(folder))]
    files: dict[str, list[str]] = {}
    for name in names:
        path = Path(name)
        if path.suffix.lower() in ENDINGS:
            files.setdefault(record_key(path.stem), []).append(name)
    found, complaints = {}, []
    for photo in photos:
        own = files.get(record_key(photo), [])
        if len(own) > 1:
            complaints.append(Complaint(f"photo '{photo}' has {len(own)} images: {', '.join(own)}", str(folder)))
        elif own:
            found[photo] = folder / own[0]
    return found, complaints


def image_fault(path: Path, size: tuple[int, int] | None) -> tuple[tuple[int, int] | None, str | None]:
    """Return columns and rows of an image by its head, without decoding it, or what is wrong with it.

    Parameters
    ----------
    path : Path
    size : tuple of 2 int or None
        Columns and rows of the photo's sensor, if it has one.
    """
    try:
        with _opened(path) as image:
            if image.width * image.height > MOST_PIXELS:
                return (
                    None,
                    f"it has {image.width} x {image.height} pixels; allowed are {MOST_PIXELS // 1_000_000} million",
                )
            if image.mode not in _MODES:
                return None, f"its pixels are of the kind {image.mode}; save it with 8 or 16 bits a channel"
            if getattr(image, "n_frames", 1) > 1 and image.format != "MPO":
                return (
                    None,
                    f"it holds {getattr(image, 'n_frames', 1)} pictures; save the one that was measured by itself",
                )
            if size is not None and (image.width, image.height) != size:
                return None, (
                    f"it has {image.width} x {image.height} pixels, the sensor of its camera {size[0]} x {size[1]}; "
                    "give the image as the camera has stored it, or correct the sensor"
                )
            return (image.width, image.height), None
    except _DAMAGED as error:
        return None, _reason(error)


def read_grey(path: Path) -> NDArray[np.uint8]:
    """Return the grey values of an image as stored, (rows, columns), of 8 bits.

    What its EXIF says of turning it is disregarded: measured are the pixels as stored. Of 16 bits the range between
    the darkest and the brightest one in a thousand becomes 8.

    Raises
    ------
    OSError
        If it cannot be read or is damaged.
    """
    try:
        with _opened(path) as image:
            if image.mode.startswith("I;16"):
                return _of_16_bits(np.asarray(image))
            image.draft("L", image.size)
            return np.ascontiguousarray(np.asarray(image.convert("L"), dtype=np.uint8))
    except _DAMAGED as error:
        raise OSError(_reason(error)) from error


def _of_16_bits(values: NDArray[Any]) -> NDArray[np.uint8]:
    low, high = np.percentile(values[::4, ::4], [0.1, 99.9])
    scaled = (values.astype(np.float32) - low) * (255.0 / max(float(high - low), 1.0))
    found: NDArray[np.uint8] = np.clip(np.rint(scaled), 0, 255).astype(np.uint8)
    return found


_DAMAGED = (OSError, ValueError, SyntaxError, TypeError, KeyError, IndexError, EOFError, MemoryError, RuntimeError)
"""What Pillow raises for damaged files; its error of a bomb is a RuntimeError by way of `_opened`."""


@contextmanager
def _opened(path: Path) -> Iterator[Image]:
    from PIL import Image as Images

    with open_regular(path) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            image = Images.open(file)
        except Images.DecompressionBombError as error:
            raise ValueError(error) from error
        with image:
            yield image


def _reason(error: Exception) -> str:
    from PIL import UnidentifiedImageError

    if isinstance(error, UnidentifiedImageError):
        return "it is no image that can be read: JPEG, PNG or TIFF"
    if isinstance(error, OSError) and error.strerror:
        return f"it cannot be read ({error.strerror})"
    text = str(error).partition("\n")[0] or type(error).__name__
    return f"the image is damaged, or too large ({text})"


def paths_of_photos(
    photos: Mapping[str, str | None], folder: Path, images: Path | None
) -> tuple[dict[str, Path], list[Complaint]]:
    """Return the images of photos: those that the project names, else those of a folder that are named as they are.

    Parameters
    ----------
    photos : mapping of str to (str or None)
        What the project names, relative to its folder.
    folder : Path
        Of the project.
    images : Path or None
        Folder of the images; None: that of the project.
    """
    named = {photo: folder / image for photo, image in photos.items() if image is not None}
    others = [photo for photo in photos if photo not in named]
    found, complaints = images_by_photo(images or folder, others) if others else ({}, [])
    return {photo: path for photo in photos if (path := {**found, **named}.get(photo)) is not None}, complaints
