"""OpenCV, loaded where it is used."""

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
