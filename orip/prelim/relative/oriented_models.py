"""Oriented models with their places in the rows, and the same as listings show them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import overload

from msgspec import Struct

from orip.prelim.rays import ImageRays
from orip.prelim.relative.orientation import OrientedPair, listed
from orip.records.results.preliminary import RelativeOrientation


class OrientedModel(Struct, frozen=True):
    """A model that is oriented relatively.

    Parameters
    ----------
    pair : OrientedPair
    row, column : int or None
        Place of the model; None for a pair of photos that the chain chose itself.
    """

    pair: OrientedPair
    row: int | None = None
    column: int | None = None


class ListedModels(Sequence[RelativeOrientation]):
    """Models as listings show them; they are made when the first of them is read, as preliminary values need none."""

    def __init__(self, rays: ImageRays, models: Sequence[OrientedModel]) -> None:
        self._rays, self._models = rays, models

    @cached_property
    def _listed(self) -> tuple[RelativeOrientation, ...]:
        return tuple(listed(self._rays, model.pair, model.row, model.column) for model in self._models)

    def __len__(self) -> int:
        """Return the number of models."""
        return len(self._models)

    @overload
    def __getitem__(self, place: int) -> RelativeOrientation: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[RelativeOrientation]: ...
    def __getitem__(self, place: int | slice) -> RelativeOrientation | Sequence[RelativeOrientation]:
        """Return one model, or several."""
        return self._listed[place]
