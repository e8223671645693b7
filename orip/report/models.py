"""The stereo models of a bundle in their rows and columns, as the plate processor drives through them."""

from __future__ import annotations

from orip.records.project import BundleDefinition, StereoModel

Cell = StereoModel | None


def model_grid(bundle: BundleDefinition) -> tuple[tuple[int, ...], tuple[tuple[int, tuple[Cell, ...]], ...]]:
    """Return the columns' numbers, and for each row its number and the model in each column, None where there is none.

    Rows and columns without any model are left out.
    """
    columns = tuple(sorted({each.column for each in bundle.models}))
    rows = tuple(sorted({each.row for each in bundle.models}))
    at = {(each.row, each.column): each for each in bundle.models}
    return columns, tuple((row, tuple(at.get((row, column)) for column in columns)) for row in rows)
