"""Heights from terrain models: points that lie on the ground, wherever on it they are."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows, refuse_too_precise
from orip.bundle.state import BlockState
from orip.bundle.unknowns import Unknowns
from orip.errors import ProjectWarning
from orip.geometry.height_grid import surface_at
from orip.records.block import Block
from orip.records.ground import GroundSystem, TerrainHeight, TerrainModel
from orip.records.observation_kinds import TERRAIN
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


COMPONENT = "Z"


class TerrainHeightObservations(Observations, frozen=True):
    """n heights of points above terrain models; `terrain` and `point` (n,) say above which, and of what."""

    rows: Rows
    terrain: IntArray
    point: IntArray
    models: tuple[TerrainModel, ...]
    ground: GroundSystem

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return heights above the terrain (ground unit) and their partials by the points.

        A point that moves along a slope changes its height above it.
        """
        found = self.ground.project_with_partials(state.points[self.point])
        residual, by_project = np.zeros(len(self.point)), np.tile([0.0, 0.0, 1.0], (len(self.point), 1))
        known: BoolArray = np.asarray(np.isfinite(np.hstack([found.value, found.by_local.reshape(-1, 9)])).all(axis=1))
        for number, model in enumerate(self.models):
            mine = np.flatnonzero((self.terrain == number) & known)
            surface = surface_at(model.grid, found.value[mine, :2])
            residual[mine] = found.value[mine, 2] - surface.height
            by_project[mine, :2] = -surface.slope
            known[mine] = surface.known
        partials = np.einsum("ni,nij->nj", by_project, np.where(known[:, None, None], found.by_local, 0.0))
        return Linearisation(np.where(known, residual, 0.0), partials, known)


def observe_terrain_heights(block: Block, unknowns: Unknowns) -> TerrainHeightObservations:
    """Return the heights of points above the terrain models; those of a free network have no influence."""
    heights, place = block.terrain_heights, block.point_index()
    number = {model.terrain.name: row for row, model in enumerate(block.terrains)}
    point = np.array([place[one.point] for one in heights], dtype=np.int64)
    error = np.array([one.error for one in heights], dtype=np.float64)
    rows = Rows(
        kind=TERRAIN,
        photo=tuple(one.terrain for one in heights),
        point=tuple(one.point for one in heights),
        component=(COMPONENT,) * len(heights),
        observed=np.zeros(len(heights)),
        error=np.abs(error),
        used=(error > 0.0) & (not block.is_free_network),
        columns=unknowns.points[point],
    )
    terrain = np.array([number[one.terrain] for one in heights], dtype=np.int64)
    return TerrainHeightObservations(rows, terrain, point, block.terrains, block.ground)


def refuse_too_precise_heights(block: Block) -> None:
    """Refuse terrain models that are too precise; see `refuse_too_precise`."""
    refuse_too_precise(block, [(f"terrain {one.terrain}", one.error) for one in block.terrain_heights])


KINDS = (KindEquations(TERRAIN, observe_terrain_heights, refuse=refuse_too_precise_heights),)
