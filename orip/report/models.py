"""The stereo models of a bundle in their rows and columns, as the plate processor drives through them."""

from __future__ import annotations

from orip.records.project.definition import BundleDefinition, StereoModel

Cell = StereoModel | None


def model_grid(bundle: BundleDefinition) -> tuple[tuple[int, ...], tuple[tuple[int, tuple[Cell, ...]], ...]]:
    """Return the columns' numbers, and for each row its number and the model in each column, None where there is none.

    Rows and columns without any model are left out.
    """
    columns = tuple(sorted({model.column for model in bundle.models}))
    rows = tuple(sorted({model.row for model in bundle.models}))
    at = {(model.row, model.column): model for model in bundle.models}
    return columns, tuple((row, tuple(at.get((row, column)) for column in columns)) for row in rows)
