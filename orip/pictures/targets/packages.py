"""OpenCV and Pillow, loaded where they are used."""

from __future__ import annotations

from typing import Any

from orip.errors import OripError


def opencv() -> Any:
    """Return the module cv2.

    Raises
    ------
    OripError
        If it is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        message = "detecting targets needs OpenCV, which is not installed: pip install 'orip[images]'"
        raise OripError(message) from error
    return cv2


def pillow() -> Any:
    """Return the module PIL.Image.

    Raises
    ------
    OripError
        If it is not installed.
    """
    try:
        from PIL import Image
    except ImportError as error:
        message = "reading pictures needs Pillow, which is not installed: pip install 'orip[images]'"
        raise OripError(message) from error
    return Image
