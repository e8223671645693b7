"""A block as a problem that can be adjusted: all kinds of observation under one order of unknowns."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import Equations, Layout
from orip.bundle.consensus import moves_to_consensus
from orip.bundle.datum import FreeDatum, free_datum
from orip.bundle.kinds import KINDS
from orip.bundle.observation import Observations
from orip.bundle.photo_point import PhotoPointObservations
from orip.bundle.state import State, rotation_limit
from orip.bundle.unknowns import CONSTANT, Unknowns, number_unknowns, set_names
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
    datum : FreeDatum or None
        That of a free network; None: control.
    excluded : array (n,) of bool or None
        Observations left out as blunders: their residuals are computed, but have no influence.
    """

    unknowns: Unknowns
    observations: tuple[Observations, ...]
    pattern: tuple[NDArray[np.int64], NDArray[np.int64], tuple[NDArray[np.bool_], ...]]
    datum: FreeDatum | None = None
    excluded: NDArray[np.bool_] | None = None

    @property
    def layout(self) -> Layout:
        """Return the order of the unknowns."""
        return self.unknowns.layout

    @property
    def defect(self) -> int:
        """Return how many movements of the whole block are free."""
        return 0 if self.datum is None else len(self.datum.held)

    def linearise(self, state: State) -> Equations:
        """Return all observation equations at a state, divided by their a-priori errors."""
        indices, indptr, kept = self.pattern
        data, residual, active, exact = [], [], [], []
        for observations, keep in zip(self.observations, kept, strict=True):
            values = observations.linearise_with_partials(state)
            error = observations.rows.error
            data.append((values.partials / error[:, None])[keep])
            residual.append((values.residual + state.memory.get(observations.rows.kind, 0.0)) / error)
            exact.append(np.full(len(error), observations.exact))
            active.append(observations.rows.used & values.computable)
        design = csr_array((np.concatenate(data), indices, indptr), shape=(len(indptr) - 1, self.layout.size))
        taking_part = np.concatenate(active)
        if self.excluded is not None:
            taking_part &= ~self.excluded
        return Equations(design, np.concatenate(residual), taking_part, np.concatenate(exact))

    def update(self, state: State, correction: FloatArray) -> State:
        """Return the state after a correction."""
        if self.datum is not None:
            correction = self.datum.transformed(correction, state, self.unknowns)
        moved = state.moved(correction, self.unknowns)
        memory = {each.rows.kind: kept for each in self.observations if (kept := each.remembered(moved)) is not None}
        return replace(moved, memory=memory)

    def reconsidered(self, state: State, equations: Equations, limit: float) -> State | None:
        """Return the state with points moved to where more of their rays fit; None if there are none."""
        first = 0
        correction = np.zeros(self.layout.size)
        for each in self.observations:
            if isinstance(each, PhotoPointObservations):
                correction += moves_to_consensus(each, first, self.unknowns.points, equations, limit)
            first += len(each.rows.photo)
        return state.moved(correction, self.unknowns) if correction.any() else None

    def step_factor(self, correction: FloatArray) -> float:
        """Return the factor that keeps every photo's turn small enough to linearise."""
        return rotation_limit(correction, self.unknowns)


def pose_problem(block: Block) -> BlockProblem:
    """Return the problem of a block."""
    tied = frozenset[int]().union(*(kind.tied_points(block) for kind in KINDS))
    unknowns = number_unknowns(block, tied)
    observations = tuple(kind.observe(block, unknowns) for kind in KINDS)
    kept = tuple(each.rows.columns != CONSTANT for each in observations)
    pairs = list(zip(observations, kept, strict=True))
    indices = np.concatenate([each.rows.columns[keep] for each, keep in pairs])
    counts = np.concatenate([keep.sum(axis=1) for keep in kept])
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    problem = BlockProblem(unknowns, observations, (indices, indptr, kept))
    return problem if block.definition.datum == "control" else _freed(problem, block)


def _freed(problem: BlockProblem, block: Block) -> BlockProblem:
    """Return the problem of a free network: as many unknowns are held while solving as it has free movements."""
    state, unknowns = starting_state(block), problem.unknowns
    on_the_ground = np.concatenate(
        [np.full(len(each.rows.photo), each.rows.kind != "photo") for each in problem.observations]
    )
    datum = free_datum(block, state, unknowns, problem.linearise(state), on_the_ground)
    fixed = unknowns.layout.fixed.copy()
    fixed[datum.held] = True
    return replace(problem, unknowns=replace(unknowns, layout=replace(unknowns.layout, fixed=fixed)), datum=datum)


def starting_state(block: Block) -> State:
    """Return the state that the block's preliminary values give."""
    return State(
        cameras=np.array([camera.parameters for camera in block.cameras], dtype=np.float64).reshape(-1, 11),
        additional=np.zeros((len(block.cameras), max(len(set_names(camera)) for camera in block.cameras))),
        centres=block.photo_orientation[:, :3].copy(),
        rotations=rotation_from_angles(block.photo_orientation[:, 3:]),
        points=block.point_start.copy(),
        theodolites=np.array([each.zero_direction for each in block.theodolites], dtype=np.float64),
        turned_by_angles=np.array(
            [any(kind in photo.constant for kind in ("OMEGA", "PHI", "KAPPA")) for photo in block.photos], dtype=bool
        ),
    )
