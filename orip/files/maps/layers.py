"""Layers of a drawing for GIS and CAD: points, lines and areas with columns of names and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from msgspec import Struct, field

from orip.arrays import FloatArray


class Layer(Struct, frozen=True):
    """A table of places: their names, and numbers (n, k) by columns, the first three of which are coordinates."""

    name: str
    columns: tuple[str, ...]
    names: tuple[str, ...]
    values: FloatArray


class Shapes(Struct, frozen=True):
    """Points, lines or closed areas.

    Parameters
    ----------
    name : str
        With the factor by which they are drawn larger, if they are.
    geometry : {"POINT", "LINESTRING", "POLYGON"}
    places : tuple of arrays (k, 2) or (k, 3)
        Of a point one place; the first of an area is also its last.
    texts : mapping of str to tuple of str
        Columns of names.
    numbers : mapping of str to array
    """

    name: str
    geometry: Literal["POINT", "LINESTRING", "POLYGON"]
    places: tuple[FloatArray, ...]
    texts: Mapping[str, tuple[str, ...]]
    numbers: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def has_height(self) -> bool:
        """Return whether places have three coordinates."""
        return bool(self.places) and self.places[0].shape[1] == 3
