"""Observation equations made up of random numbers, and problems that are solved by them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.adjustment.convergence import TerminationReason
from orip.adjustment.equations import Equations, Layout, OtherPlace
from orip.adjustment.factorisation.elimination import BlockFactors
from orip.adjustment.iteration import Adjustment, adjust
from orip.adjustment.iteration_state import IterationSettings
from orip.adjustment.sparse_rows import SparseRows
from orip.structs import replace

OFF = None
"""An iteration at which nobody starts to reduce weights."""


MAX_LOST = 12.0

SHAPES = {
    "blocks": {},
    "fixed coordinates": {"fixed": (9, 13, 14, 21, 22, 23)},
    "more than a panel": {"reduced": 70, "blocks": 60},
    "no blocks": {"blocks": 0},
    "no reduced unknowns left": {"reduced": 4, "fixed": (0, 1, 2, 3)},
}


def random_equations(
    seed: int, *, reduced: int = 9, blocks: int = 12, per_block: int = 6, fixed: tuple[int, ...] = ()
) -> tuple[Equations, Layout]:
    """Return equations that touch four reduced unknowns and a block, or one or four reduced unknowns alone."""
    random = np.random.default_rng(seed)
    size = reduced + 3 * blocks
    held = np.zeros(size, dtype=bool)
    held[list(fixed)] = True
    rows = []
    for block in range(blocks):
        for _ in range(per_block):
            row = np.zeros(size)
            row[random.choice(reduced, 4, replace=False)] = random.normal(size=4)
            row[reduced + 3 * block : reduced + 3 * block + 3] = random.normal(size=3)
            rows.append(row)
    for column in range(reduced):
        row = np.zeros(size)
        row[column] = random.uniform(0.5, 2.0)
        rows.append(row)
    for _ in range(reduced):
        row = np.zeros(size)
        row[random.choice(reduced, 4, replace=False)] = random.normal(size=4)
        rows.append(row)
    design = np.array(rows)
    design[:, held] = 0.0
    # the unknowns have units of their own: millimetres beside radians; the coordinates of a point have the same
    design[:, :reduced] *= 10.0 ** random.uniform(-3.0, 3.0, reduced)
    design[:, reduced:] *= np.repeat(10.0 ** random.uniform(-3.0, 3.0, blocks), 3)
    return equations_of(design, random.normal(size=len(design))), Layout(reduced, blocks, held)


def equations_of(design: np.ndarray, residual: np.ndarray) -> Equations:
    count = len(design)
    return Equations(SparseRows(csr_array(design)), residual, np.ones(count, dtype=bool), np.zeros(count, dtype=bool))


def random_weights(seed: int, count: int) -> np.ndarray:
    return np.where(np.arange(count) % 3 == 0, np.random.default_rng(seed).uniform(0.01, 1.0, count), 1.0)


def dense_normals(equations: Equations, weights: np.ndarray) -> np.ndarray:
    design = equations.design.toarray()
    taking_part = np.where(equations.active, weights, 0.0)
    return design.T @ (taking_part[:, None] * design)


def pseudo_inverse(normals: np.ndarray, removed: np.ndarray | None = None) -> np.ndarray:
    """Return the inverse of the unknowns that are observed and not removed, zero elsewhere.

    The matrix is scaled to a unit diagonal first, as units differ.
    """
    used = np.diag(normals) > 0.0
    if removed is not None:
        used &= ~removed
    scale = np.sqrt(np.diag(normals)[used])
    result = np.zeros_like(normals)
    inverse = np.linalg.pinv(normals[np.ix_(used, used)] / np.outer(scale, scale), rcond=1e-13, hermitian=True)
    result[np.ix_(used, used)] = inverse / np.outer(scale, scale)
    return result


class CurvedProblem(Struct, frozen=True):
    """A problem of unknowns that are all reduced: its computed observations are any function of them."""

    computed: Callable[[np.ndarray], np.ndarray]
    partials: Callable[[np.ndarray], np.ndarray]
    observed: np.ndarray
    exact: np.ndarray | None = None
    unknowns: int = 1

    @property
    def layout(self) -> Layout:
        return Layout(self.unknowns, 0, np.zeros(self.unknowns, dtype=bool))

    def linearise(self, state: np.ndarray) -> Equations:
        equations = equations_of(self.partials(state), self.computed(state) - self.observed)
        return equations if self.exact is None else replace(equations, exact=self.exact)

    def update(self, state: np.ndarray, correction: np.ndarray) -> np.ndarray:
        return state + correction

    def with_blocks_recomputed(self, state: np.ndarray) -> np.ndarray:
        return state

    def with_blocks_moved(self, state: np.ndarray, correction: np.ndarray) -> np.ndarray:
        del correction
        return state

    def without_undetermined_blocks(self, state: np.ndarray, factors: BlockFactors, scale: float) -> None:
        del state, factors, scale

    def without_contradictory_blocks(self, state: np.ndarray, factors: BlockFactors, scale: float) -> None:
        del state, factors, scale

    def with_all_blocks(self, state: np.ndarray) -> np.ndarray:
        return state

    def with_doubtful_blocks_placed(self, state: np.ndarray, equations: Equations, limit: float) -> np.ndarray:
        del equations, limit
        return state

    def other_places(self, *_: object) -> list[OtherPlace]:
        return []

    def rival_places(self, *_: object) -> list[OtherPlace]:
        return []

    def improve_consensus(self, state: np.ndarray, equations: Equations, limit: float) -> None:
        del state, equations, limit

    def step_factor(self, correction: np.ndarray) -> float:
        del correction
        return 1.0


def linear_problem(design: np.ndarray, observed: np.ndarray, exact: np.ndarray | None = None) -> CurvedProblem:
    return CurvedProblem(lambda x: design @ x, lambda _: design, observed, exact, design.shape[1])


def settings(
    *, enp_stop: float = 4.0, max_iterations: int = 50, limit: float = 5.0, start: int | None = OFF
) -> IterationSettings:
    return IterationSettings(enp_stop, max_iterations, limit, start, 12.0)


def adjusted(problem: CurvedProblem, start: np.ndarray, chosen: IterationSettings) -> Adjustment:
    return adjust(problem, np.asarray(start, dtype=float), chosen, lambda _: None, lambda: False)


def converged(found: Adjustment) -> bool:
    return found.reason is TerminationReason.CONVERGED


def singular_equations(seed):
    """Return equations in which unknowns 3 and 8 are the same, and two equations are left of the first block."""
    equations, layout = random_equations(seed)
    design = equations.design.toarray()
    design[:, 8] = 2.0 * design[:, 3]
    design[np.flatnonzero(design[:, 9:12].any(axis=1))[2:]] = 0.0
    return equations_of(design, equations.residual), layout
