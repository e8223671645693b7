"""The points of a block at its solution, each one computed when it is looked up."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from orip.arrays import FloatArray
from orip.online.sequential.sequential_block import SequentialBlock


class PlacesAtSolution(Mapping[str, FloatArray]):
    """Coordinates (3,) of points by name: their values with their corrections, as long as the block does not change.

    Parameters
    ----------
    values : mapping of array (3,)
        Those that the equations have been linearised at.
    tied : mapping of array (3,)
        The points among them that are known already: their corrections are reduced unknowns.
    reduced : array (n,)
        Corrections of the reduced unknowns.
    """

    def __init__(
        self,
        values: Mapping[str, FloatArray],
        tied: Mapping[str, FloatArray],
        equations: SequentialBlock[Any],
        reduced: FloatArray,
    ) -> None:
        self._values, self._tied, self._equations, self._reduced = values, tied, equations, reduced

    def __getitem__(self, name: str) -> FloatArray:
        """Return the coordinates (3,) of a point; raise `KeyError` if it has no values."""
        tied = self._tied.get(name)
        return self._values[name] + self._equations.point_correction(name, self._reduced) if tied is None else tied

    def __contains__(self, name: object) -> bool:
        """Return whether a point has values."""
        return name in self._values

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._values)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._values)
