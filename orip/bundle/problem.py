"""A block as a problem that can be adjusted: all kinds of observation under one order of unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import Equations, Layout
from orip.bundle.control_point import constant_coordinates
from orip.bundle.kinds import KINDS
from orip.bundle.observation import Observations
from orip.bundle.state import State, rotation_limit
from orip.bundle.unknowns import CONSTANT, Unknowns, number_unknowns
from orip.geometry.rotation import rotation_from_angles
from orip.model.block import Block

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BlockProblem:
    """The observation equations of a block.

    Parameters
    ----------
    unknowns : Unknowns
    observations : tuple of Observations
        One of each kind; their rows follow one another.
    pattern : tuple (indices, indptr, kept)
        Of the sparse design matrix; `kept` marks the partials that belong to unknowns.
    """

    unknowns: Unknowns
    observations: tuple[Observations, ...]
    pattern: tuple[NDArray[np.int64], NDArray[np.int64], tuple[NDArray[np.bool_], ...]]

    @property
    def layout(self) -> Layout:
        """Return the order of the unknowns."""
        return self.unknowns.layout

    def linearise(self, state: State) -> Equations:
        """Return all observation equations at a state, divided by their a-priori errors."""
        indices, indptr, kept = self.pattern
        data, residual, active = [], [], []
        for observations, keep in zip(self.observations, kept, strict=True):
            values = observations.linearise_with_partials(state)
            error = observations.rows.error
            data.append((values.partials / error[:, None])[keep])
            residual.append(values.residual / error)
            active.append(observations.rows.used & values.computable)
        design = csr_array((np.concatenate(data), indices, indptr), shape=(len(indptr) - 1, self.layout.size))
        return Equations(design, np.concatenate(residual), np.concatenate(active))

    def update(self, state: State, correction: FloatArray) -> State:
        """Return the state after a correction."""
        return state.moved(correction, self.unknowns)

    def step_factor(self, correction: FloatArray) -> float:
        """Return the factor that keeps every photo's turn small enough to linearise."""
        return rotation_limit(correction, self.unknowns)


def pose_problem(block: Block) -> BlockProblem:
    """Return the problem of a block."""
    tied = frozenset[int]().union(*(kind.tied_points(block) for kind in KINDS))
    unknowns = number_unknowns(block, constant_coordinates(block), tied)
    observations = tuple(kind.observe(block, unknowns) for kind in KINDS)
    kept = tuple(each.rows.columns != CONSTANT for each in observations)
    pairs = list(zip(observations, kept, strict=True))
    indices = np.concatenate([each.rows.columns[keep] for each, keep in pairs])
    counts = np.concatenate([keep.sum(axis=1) for keep in kept])
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return BlockProblem(unknowns, observations, (indices, indptr, kept))


def starting_state(block: Block) -> State:
    """Return the state that the block's preliminary values give."""
    return State(
        cameras=np.array([camera.parameters for camera in block.cameras], dtype=np.float64).reshape(-1, 11),
        centres=block.photo_orientation[:, :3].copy(),
        rotations=rotation_from_angles(block.photo_orientation[:, 3:]),
        points=block.point_start.copy(),
        turned_by_angles=np.array(
            [any(kind in photo.constant for kind in ("OMEGA", "PHI", "KAPPA")) for photo in block.photos], dtype=bool
        ),
    )
