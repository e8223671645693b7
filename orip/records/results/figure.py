"""Figures of a result by name, as two results are compared."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from msgspec import Struct

Quantity = Literal["ground", "angle", "photo", "other", "text"]
"""Ground coordinate; angle in degrees; C, DX or DY in mm; any other number; a word."""


class Figure(Struct, frozen=True):
    """One figure.

    Parameters
    ----------
    value : float, str or None
        None where the result has null.
    quantity : Quantity
    sd : float or None
        Its standard deviation, None where it has none.
    adjusted : bool
        It is the value of an unknown or constant, not a measure of quality.
    effect : float
        Effect of one unit of it on a photo coordinate 10 mm from the principal point, mm; 1 unless it is a coefficient.
    """

    value: float | str | None
    quantity: Quantity
    sd: float | None = None
    adjusted: bool = False
    effect: float = 1.0


class FigureGroup(Struct, frozen=True):
    """Figures that belong to one thing, by name.

    Parameters
    ----------
    name : str
        As it is shown, e.g. ``photo st1``; empty for figures of the whole adjustment.
    figures : mapping of str to Figure
    """

    name: str
    figures: Mapping[str, Figure]


ResultFigures = Mapping[tuple[str, str], FigureGroup]
"""The figures of a result by kind of thing and name; names of cameras and photos by `record_key`."""
