"""Given directions from one point to another: the edge of a building, a plumb line."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.state import BlockState
from orip.bundle.unknowns import Unknowns
from orip.geometry.figures import axes_about
from orip.records.block import Block
from orip.records.ground import GroundSystem
from orip.records.observation_kinds import GIVEN_DIRECTION
from orip.units import DEGREES_PER_RADIAN

_COMPONENTS = ("side", "up")


class GivenDirectionObservations(Observations, frozen=True):
    """The two angles of n / 2 directions: to the side (horizontal) and up, at right angles to it.

    Parameters
    ----------
    start, end : arrays (n,) of int
    component : array (n,) of int
    axes : array (n, 3, 3)
        Columns to the side, up and along the given direction.
    """

    rows: Rows
    start: IntArray
    end: IntArray
    component: IntArray
    axes: FloatArray
    ground: GroundSystem

    def groups(self) -> IntArray:
        """Return the rows of the directions: their two angles lose weight together."""
        return np.arange(len(self.component), dtype=np.int64) // 2

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return angles (degrees) and their partials by the two points, the start first.

        They are the parts of the angle between the direction and the given one, along the way it is turned. Directions
        refer to the project's axes at the start; that these turn when it moves is neglected.
        """
        start, end = state.points[self.start], state.points[self.end]
        axes = np.swapaxes(self.axes, 1, 2) @ self.ground.axes_at(self.ground.to_project(start))
        offset = (axes @ (end - start)[:, :, None])[:, :, 0]
        length = np.linalg.norm(offset, axis=1)
        unit = offset / np.where(length > 0.0, length, 1.0)[:, None]
        sine, cosine = np.linalg.norm(unit[:, :2], axis=1), unit[:, 2]
        known = (length > 0.0) & ((sine > 0.0) | (cosine > 0.0))
        angle = np.arctan2(sine, cosine)
        bent = np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)
        turned = unit[:, :2] / np.where(sine > 0.0, sine, 1.0)[:, None]
        # by the unit vector: along the turn the angle changes, across it the turn itself
        along = np.einsum("ni,nj->nij", turned, turned)
        by_sine = along * cosine[:, None, None] + bent[:, None, None] * (np.eye(2) - along)
        by_unit = np.concatenate([by_sine, -(turned * sine[:, None])[:, :, None]], axis=2)
        by_offset = by_unit @ (np.eye(3) - unit[:, :, None] * unit[:, None])
        by_end = by_offset / np.where(length > 0.0, length, 1.0)[:, None, None] @ axes
        at = (np.arange(len(length)), self.component)
        residual, partials = (bent[:, None] * unit[:, :2])[at], by_end[at]
        found = np.hstack([-partials, partials]) * DEGREES_PER_RADIAN
        # not a number where the project's system does not reach
        return Linearisation(np.nan_to_num(residual * DEGREES_PER_RADIAN), np.nan_to_num(found), known)


def observe_given_directions(block: Block, unknowns: Unknowns) -> GivenDirectionObservations:
    """Return the angles of the given directions."""
    place, lines = block.point_index(), block.given_directions
    start, end = (
        np.repeat(np.array([place[name] for name in names], dtype=np.int64), 2)
        for names in ([line.start for line in lines], [line.end for line in lines])
    )
    error = np.repeat(np.array([line.error for line in lines], dtype=np.float64), 2)
    along = np.array([line.direction for line in lines], dtype=np.float64).reshape(-1, 3)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    axes = axes_about(along)
    axes[:, :, 0] *= np.sign((axes[:, :, 2] * along).sum(axis=1))[:, None]
    axes[:, :, 2] = along
    rows = Rows(
        kind=GIVEN_DIRECTION,
        photo=tuple(line.name for line in lines for _ in _COMPONENTS),
        point=tuple(f"{line.start}-{line.end}" for line in lines for _ in _COMPONENTS),
        component=_COMPONENTS * len(lines),
        observed=np.zeros(len(error)),
        error=np.abs(error),
        used=error > 0.0,
        columns=np.hstack([unknowns.points[start], unknowns.points[end]]),
    )
    component = np.tile(np.arange(2), len(lines))
    return GivenDirectionObservations(rows, start, end, component, np.repeat(axes, 2, axis=0), block.ground)


def tied_by_given_directions(block: Block) -> frozenset[int]:
    """Return the points that given directions tie to each other."""
    place = block.point_index()
    return frozenset(place[name] for line in block.given_directions for name in (line.start, line.end))


KINDS = (KindEquations(GIVEN_DIRECTION, observe_given_directions, tied_by_given_directions),)
