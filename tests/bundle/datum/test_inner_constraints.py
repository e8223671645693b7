"""Cofactors with inner constraints, from the loop over photo points and stored rows, against dense S Q S^T."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.test_photo_loop import constant_points, measured_twice, tied_points, two_cameras_with_sets
from support.conditioning import EPSILON, condition_of_normals
from support.synthetic_block import synthetic_block

from orip.adjustment.equations import Equations
from orip.adjustment.normals import solve_normals
from orip.adjustment.precision import Cofactors, cofactors
from orip.adjustment.sparse_rows import SparseRows
from orip.arrays import BoolArray, FloatArray
from orip.bundle.datum.movements import movements_of_block
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.starting_state import starting_state
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT
from orip.records.block import Block
from orip.structs import replace

MAX_LOST = 13.0
SUMMED = 10.0
"""As in the comparison of the loop with the stored rows."""


def some_constant() -> Block:
    """Return a block with one constant coordinate of a point, and two of another one."""
    block = synthetic_block("strip", "inner constraints", noise_mm=0.003, start_error=0.01).block
    constant = block.constant_points.copy()
    constant[1, 2] = constant[2, :2] = True
    return replace(block, constant_points=constant)


BLOCKS = {
    "sets": (two_cameras_with_sets, 7),
    "points in the reduced system, an exact distance": (tied_points, 5),
    "some constant coordinates": (some_constant, 4),
    "constant control": (constant_points, 0),
    "photo points measured again": (measured_twice, 7),
}
"""Blocks, and their free movements."""


def free(block: Block, every: int) -> Block:
    """Return the block as a free network whose datum each so-manyth point defines."""
    names = () if every == 1 else block.point_names[::every]
    return replace(block, control_points=(), definition=replace(block.definition, datum="free", datum_points=names))


def held_cofactors(equations: Equations, kept: BoolArray) -> FloatArray:
    """Return the cofactors (u, u) of the solution in which unknowns are held, with exact constraints bound."""
    design = equations.design.toarray()[equations.active][:, kept]
    scale = np.linalg.norm(design, axis=0)
    inverse = np.linalg.inv(np.linalg.qr(design / scale, mode="r")) / scale[:, None]
    spread = inverse @ (inverse.T @ design[equations.exact[equations.active]].T)
    cofactor = inverse @ inverse.T
    if spread.size:
        cofactor -= spread @ np.linalg.solve(design[equations.exact[equations.active]] @ spread, spread.T)
    found = np.zeros((len(kept), len(kept)))
    found[np.ix_(kept, kept)] = cofactor
    return found


def transformed(problem: BlockProblem, state: BlockState, cofactor: FloatArray) -> FloatArray:
    """Return S Q S^T, S = I - G (B^T G)^-1 B^T, with the movements G and B, their rows of the datum points."""
    if problem.datum is None:
        return cofactor
    generator = movements_of_block(state, problem.unknowns).combined(problem.datum.movements).dense()
    inner = np.zeros_like(generator)
    columns = problem.unknowns.points[problem.datum.points]
    columns = columns[columns != CONSTANT]
    inner[columns] = generator[columns]
    by_datum = np.eye(len(generator)) - generator @ np.linalg.solve(inner.T @ generator, inner.T)
    return np.asarray(by_datum @ cofactor @ by_datum.T)


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("name", BLOCKS)
def test_cofactors_are_those_of_the_dense_transformation(name: str, every: int) -> None:
    made, movements = BLOCKS[name]
    block = free(made(), every)
    problem, state = pose_problem(block), starting_state(block)
    assert problem.defect == movements
    streamed = problem.linearise(state)
    stored = replace(streamed, rows=SparseRows(problem.design(state)))
    weights, layout, used = np.ones(len(streamed.residual)), problem.layout, streamed.active & ~streamed.exact
    for equations in (streamed, stored):
        normals = solve_normals(equations, weights, layout, MAX_LOST).with_constraints(equations)
        kept = ~layout.fixed & ~normals.removed
        tolerance = SUMMED * EPSILON * condition_of_normals(stored, weights, kept)
        assert tolerance < 1e-4
        held, design = held_cofactors(stored, kept), stored.design.toarray()[used]
        some = np.flatnonzero(kept)[::5]  # of photos, cameras and points, bound by exact constraints if there are any
        size = np.sqrt(np.diag(held)[some])
        assert np.abs((normals.inverse_at(some) - held[np.ix_(some, some)]) / np.outer(size, size)).max() < tolerance
        found = cofactors(equations, normals, problem.inner_constraints(state))
        assert_close(found, transformed(problem, state, held), tolerance)
        leverage = np.einsum("ni,ni->n", design @ held, design)
        assert np.allclose(found.leverage[used], leverage, atol=tolerance)


def assert_close(found: Cofactors, wanted: FloatArray, tolerance: float) -> None:
    assert isinstance(found.reduced, np.ndarray)
    m, deviation = len(found.reduced), np.sqrt(np.diag(wanted))
    size = np.where(deviation > 0.0, deviation, 1.0)
    assert np.abs((found.reduced - wanted[:m, :m]) / np.outer(size[:m], size[:m])).max() < tolerance
    for block, cofactor in enumerate(found.blocks):
        place = slice(m + 3 * block, m + 3 * block + 3)
        assert np.abs((cofactor - wanted[place, place]) / np.outer(size[place], size[place])).max() < tolerance
