"""What was measured in a picture: named marks, and what was rejected; OpenCV, loaded where it is used."""

from __future__ import annotations

from typing import Any

from msgspec import Struct

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


class Mark(Struct, frozen=True):
    """A named point in a picture.

    Parameters
    ----------
    name : str
    column, row : float
        Pixels.
    deviation : tuple of 2 float
        Standard deviations in column and row, pixels.
    """

    name: str
    column: float
    row: float
    deviation: tuple[float, float]


class Rejected(Struct, frozen=True):
    """What looks like a target at first and is none, or a target that cannot be measured.

    Parameters
    ----------
    column, row : float
        Pixels; of what was not found where it should be.
    reason : str
    name : str
        Of a target that is known by its place; else empty.
    """

    column: float
    row: float
    reason: str
    name: str = ""


class FoundTargets(Struct, frozen=True):
    """The targets of a picture.

    Parameters
    ----------
    marks : tuple of Mark
    rejected : tuple of Rejected
    fault : str
        Why nothing was found; empty: there are marks.
    """

    marks: tuple[Mark, ...]
    rejected: tuple[Rejected, ...]
    fault: str = ""
