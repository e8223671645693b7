"""Which unknowns are removed: as many as the null space of the design matrix has dimensions, by its singular values."""

from __future__ import annotations

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import equations_of, random_equations

from orip.adjustment.equations import Equations, Layout
from orip.adjustment.normals import solve_normals

MAX_LOST = 12.0
DESIGNS = 500

ZERO, CLEAR = 1e-9, 1e-5
"""Singular values of a design with columns of unit length: below, nothing but rounding; above, determined. Their
squares are the stiffnesses that are held against the limit of 12 digits."""


def random_design(seed: int) -> tuple[Equations, Layout]:
    """Return a design with dependent and nearly dependent reduced columns, and blocks with too few rows."""
    random = np.random.default_rng(seed)
    reduced = int(random.integers(4, 40))
    equations, layout = random_equations(seed, reduced=reduced, blocks=int(random.integers(0, 12)))
    design = equations.design.toarray()
    design[:, :reduced] /= np.linalg.norm(design[:, :reduced], axis=0)
    for _ in range(int(random.integers(0, 4))):
        one, other = random.choice(reduced, 2, replace=False)
        design[:, one] = design[:, other] + 10.0 ** random.uniform(-4.0, -0.5) * design[:, one]
    for _ in range(int(random.integers(0, 5))):
        chosen = random.choice(reduced, int(random.integers(2, min(reduced, 8) + 1)), replace=False)
        factors = 10.0 ** random.uniform(-3.0, 3.0, len(chosen) - 1) * random.choice([-1.0, 1.0], len(chosen) - 1)
        design[:, chosen[0]] = design[:, chosen[1:]] @ factors
    for block in range(int(random.integers(0, 3)) if layout.blocks > 4 else 0):
        touching = np.flatnonzero(design[:, reduced + 3 * block : reduced + 3 * block + 3].any(axis=1))
        design[touching[int(random.integers(0, 3)) :]] = 0.0
    design[:, :reduced] *= 10.0 ** random.uniform(-3.0, 3.0, reduced)
    return equations_of(design, equations.residual), layout


def unit_columns(design: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(design, axis=0)
    return design / np.where(lengths > 0.0, lengths, 1.0)


def null_space_dimension(design: np.ndarray) -> int | None:
    """Return the dimension of the null space; None where the singular values leave it open."""
    values = np.linalg.svd(unit_columns(design), compute_uv=False)
    values = np.append(values, np.zeros(max(design.shape[1] - len(values), 0)))
    if ((values > ZERO) & (values < CLEAR)).any():
        return None
    return int(np.count_nonzero(values <= ZERO))


def test_as_many_unknowns_are_removed_as_the_null_space_has_dimensions():
    judged = wrong = 0
    for seed in range(DESIGNS):
        equations, layout = random_design(seed)
        design = equations.design.toarray()
        dimension = null_space_dimension(design)
        if dimension is None:
            continue
        judged += 1
        found = solve_normals(equations, np.ones(len(design)), layout, MAX_LOST)
        left = unit_columns(design[:, ~found.removed])
        determined = not left.size or np.linalg.svd(left, compute_uv=False)[-1] > ZERO
        wrong += int(found.removed.sum() != dimension or not determined)
    assert judged > 0.8 * DESIGNS
    assert wrong == 0


@pytest.mark.parametrize("seed", range(20))
def test_the_same_unknowns_are_removed_whatever_the_weights_are(seed):
    equations, layout = random_design(seed)
    ones = np.ones(len(equations.residual))
    if null_space_dimension(equations.design.toarray()) is None:
        return
    weights = np.random.default_rng(seed).uniform(0.9, 1.1, len(ones))
    one = solve_normals(equations, ones, layout, MAX_LOST).removed
    other = solve_normals(equations, weights, layout, MAX_LOST).removed
    assert np.array_equal(one[: layout.reduced], other[: layout.reduced])
