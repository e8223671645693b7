"""Which points of a block have a height on its terrain models, and with what a-priori error."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.errors import ProjectWarning
from orip.geometry.height_grid import surface_at
from orip.records.block import Block
from orip.records.ground import TerrainHeight, TerrainModel
from orip.structs import replace
from orip.wording import first_names

_NAMED = 6
"""Points that a warning names."""

_NOWHERE = 1e30
"""Coordinate of a point without any: outside of every raster."""


def with_terrain_heights(block: Block) -> tuple[Block, list[ProjectWarning]]:
    """Return a block whose points have starting coordinates with the heights of those on its terrain models.

    The slope of the a-priori errors is that at the starting coordinates. Points outside a model, or at a hole in it,
    have none there; a warning names them.
    """
    if not block.terrains:
        return block, []
    places = block.ground.to_project(block.point_start)
    found, warnings = list[TerrainHeight](), list[ProjectWarning]()
    for model in block.terrains:
        chosen = np.array([row for row, name in enumerate(block.point_names) if model.terrain.has(name)], dtype=int)
        surface = surface_at(model.grid, np.nan_to_num(places[chosen, :2], nan=_NOWHERE))
        error = np.hypot(model.terrain.error, model.terrain.plan_error * np.linalg.norm(surface.slope, axis=1))
        names = [block.point_names[row] for row in chosen.tolist()]
        found += [
            TerrainHeight(model.terrain.name, name, -one if model.terrain.disregards(name) else one)
            for name, one, known in zip(names, error.tolist(), surface.known.tolist(), strict=True)
            if known
        ]
        warnings += _left_out(model, names, places[chosen], surface.known)
    return replace(block, terrain_heights=tuple(found)), warnings


def _left_out(model: TerrainModel, names: list[str], places: FloatArray, known: BoolArray) -> list[ProjectWarning]:
    """Return a warning of the points that a terrain model says nothing of, if there are any."""
    where, name = f"terrain {model.terrain.name}", model.terrain.file
    if not names:
        text = "has none of the points of this bundle; correct points in its [[terrain]]"
        return [ProjectWarning("terrain", where, text)]
    missing = [one for one, is_known in zip(names, known.tolist(), strict=True) if not is_known]
    if not missing:
        return []
    x, y, _ = places[int(np.flatnonzero(~known)[0])].tolist()
    of = "none" if len(missing) == len(names) else f"{len(names) - len(missing)} of {len(names)}"
    text = (
        f"{of} of the points that should lie on it have a height: {name} has none at {first_names(missing, _NAMED)} "
        f"(the first at {x:.1f}, {y:.1f}); give a raster without holes that reaches two pixels beyond the points, or "
        "name in points those that lie on it"
    )
    return [ProjectWarning("terrain", where, text)]
