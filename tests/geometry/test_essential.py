"""Essential matrices: known truth, all solutions found by brute force, the constraints themselves, special samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from support.prelim_references import five_points as essential_module
from support.prelim_references.five_points import essential_matrices, two_photos_of

EPSILON = np.finfo(float).eps
SUMMED = 100.0
"""Rounding errors of some thousand products that make the ten equations, in units of the last digit."""


def cross_of(base):
    return np.cross(np.eye(3), base).T


def two_views(seed, count, *, points=None, base=None, rotation=None):
    """Image vectors of points 3 away, seen from two places one apart."""
    generator = np.random.default_rng(seed)
    points = generator.uniform([-1.0, -1.0, -4.0], [1.0, 1.0, -2.0], (count, 3)) if points is None else points
    base = generator.normal(size=3) if base is None else np.array(base, dtype=float)
    rotation = Rotation.from_rotvec(0.3 * generator.normal(size=3)).as_matrix() if rotation is None else rotation
    base /= np.linalg.norm(base)
    essential = cross_of(base) @ rotation
    return points, (points - base) @ rotation, essential / np.linalg.norm(essential)


def off(found, essential):
    """Distance of the nearest of several matrices from one, whatever their signs."""
    return min(
        (min(np.abs(matrix - essential).max(), np.abs(matrix + essential).max()) for matrix in found), default=np.inf
    )


def constraint(found):
    """Largest element of det E and 2 E E^T E - tr(E E^T) E."""
    square = found @ np.swapaxes(found, 1, 2)
    cubic = 2.0 * square @ found - np.trace(square, axis1=1, axis2=2)[:, None, None] * found
    return np.maximum(np.abs(np.linalg.det(found)), np.abs(cubic).max(axis=(1, 2)))


def condition_of_solution(left, right, essential):
    """Return how much larger the error of a solution is than those of the directions of the image vectors.

    From the smallest singular value of the five equations by the five unknowns of an essential matrix, which are two
    small rotations, one of each photo; of their six components one combination, the turn about the base, changes
    nothing.
    """
    left, right = (vectors / np.linalg.norm(vectors, axis=1, keepdims=True) for vectors in (left, right))
    turns = [cross_of(axis) for axis in np.eye(3)]
    changes = np.array([*(turn @ essential for turn in turns), *(essential @ turn for turn in turns)]).reshape(6, 9)
    unknowns = np.linalg.svd(changes)[2][:5]
    equations = np.einsum("pi,pj->pij", left, right).reshape(5, 9)
    return 1.0 / np.linalg.svd(equations @ unknowns.T, compute_uv=False)[-1]


def condition_of_elimination(left, right):
    """Return the condition of the system that takes the cubic monomials out of the ten equations.

    It is large where one of the other nine solutions has hardly a share of the matrix whose factor is 1.
    """
    unit = (vectors / np.linalg.norm(vectors, axis=1, keepdims=True) for vectors in (left, right))
    null_space = essential_module._null_space(*(vectors[None] for vectors in unit))
    return np.linalg.cond(essential_module._cubic_equations(null_space)[0, :, :10])


@pytest.mark.parametrize("seed", range(30))
def test_truth_is_among_the_solutions(seed):
    left, right, essential = two_views(seed, 5)
    # rounding is magnified first by the elimination and then by the solution itself: 1e7 and 1e4 in sample 8
    condition = condition_of_elimination(left, right) * condition_of_solution(left, right, essential)
    assert off(essential_matrices(left[None], right[None]), essential) < SUMMED * EPSILON * condition


def test_truth_is_nearly_always_met_to_the_last_digits():
    """The limits above are those of the worst case; what kernels make of most samples is far within."""
    errors = []
    for seed in range(300):
        left, right, essential = two_views(seed, 5)
        errors.append(off(essential_matrices(left[None], right[None]), essential))
    assert np.median(errors) < 1e-13
    assert np.quantile(errors, 0.99) < 1e-10


def test_solutions_of_many_samples_are_those_of_each():
    views = [two_views(seed, 5) for seed in range(4)]
    together = essential_matrices(np.stack([view[0] for view in views]), np.stack([view[1] for view in views]))
    alone = np.concatenate([essential_matrices(left[None], right[None]) for left, right, _ in views])
    assert len(together) == len(alone)
    assert max(off(together, matrix) for matrix in alone) < 1e-9


def test_solutions_fulfil_the_constraints_and_contain_the_points():
    left, right, _ = (np.stack(vectors) for vectors in zip(*(two_views(seed, 5) for seed in range(40)), strict=True))
    found = [essential_matrices(left[i : i + 1], right[i : i + 1]) for i in range(40)]
    determinants = np.concatenate([np.einsum("pi,mij,pj->mp", left[i], found[i], right[i]) for i in range(40)])
    assert np.abs(determinants).max() < 1e-13
    violations = np.sort(np.concatenate([constraint(matrix) for matrix in found]))
    # what remains are real parts of complex pairs, of which there are few
    assert violations[int(0.9 * len(violations))] < 1e-10
    assert np.allclose(np.linalg.norm(np.concatenate(found), axis=(1, 2)), 1.0, atol=1e-14)


@pytest.mark.slow
def test_all_real_solutions_are_found():
    left, right, _ = two_views(5, 5)
    left, right = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (left, right))

    def essential_of(x):
        base = np.array([np.cos(x[0]) * np.cos(x[1]), np.sin(x[0]) * np.cos(x[1]), np.sin(x[1])])
        return cross_of(base) @ Rotation.from_rotvec(x[2:]).as_matrix()

    generator = np.random.default_rng(7)
    brute: list[np.ndarray] = []
    for _ in range(25):
        start = generator.uniform(-np.pi, np.pi, 5)
        end = least_squares(
            lambda x: ((left @ essential_of(x)) * right).sum(axis=1), start, xtol=1e-13, ftol=1e-15, gtol=1e-15
        )
        found = essential_of(end.x) / np.sqrt(2.0)
        if np.abs(end.fun).max() < 1e-12 and off(brute, found) > 1e-4:
            brute.append(found)
    solutions = essential_matrices(left[None], right[None])
    solutions = solutions[constraint(solutions) < 1e-10]
    assert len(brute) >= 2
    assert max(off(solutions, matrix) for matrix in brute) < 1e-6
    assert len(solutions) == len(brute)


@pytest.mark.parametrize(
    ("base", "vector"),
    [((1, 0, 0), (0, 0, 0)), ((0, 0, -1), (0, 0, 0)), ((0, 1, 0), (0, 0, np.pi)), ((1, 0, 1), (0, -np.pi / 2, 0))],
    ids=["normal case", "forward", "upside down", "at right angles"],
)
def test_special_arrangements(base, vector):
    left, right, essential = two_views(1, 5, base=base, rotation=Rotation.from_rotvec(vector).as_matrix())
    assert off(essential_matrices(left[None], right[None]), essential) < 1e-8


def test_points_of_a_plane():
    points = np.array([[-1, -1, -3], [1, -1, -3], [1, 1, -3], [-1, 1, -3], [0.3, 0.1, -3]], dtype=float)
    left, right, essential = two_views(3, 5, points=points)
    assert off(essential_matrices(left[None], right[None]), essential) < 1e-8


def test_samples_that_determine_nothing_break_nothing():
    left, right, _ = two_views(4, 5)
    twice = [0, 0, 1, 2, 3]
    for a, b in ((left[twice], right[twice]), (left, left), (left[:1].repeat(5, 0), right[:1].repeat(5, 0))):
        assert np.isfinite(essential_matrices(a[None], b[None])).all()
    assert essential_matrices(np.empty((0, 5, 3)), np.empty((0, 5, 3))).shape == (0, 3, 3)


def test_five_points_of_nearly_double_solutions_survive_errors_of_measuring():
    # a plane across the view: its two solutions are near to each other, and 1e-5 makes of them a complex pair
    generator = np.random.default_rng(11)
    worst = 0.0
    for seed in range(40):
        points = generator.uniform([-1, -1, -3], [1, 1, -2.999], (5, 3))
        left, right, essential = two_views(seed, 5, points=points, base=(1, 0, 0))
        noise = 1e-5 * generator.normal(size=(2, 5, 3))
        worst = max(worst, off(essential_matrices((left + noise[0])[None], (right + noise[1])[None]), essential))
    assert worst < 0.3


@pytest.mark.parametrize("seed", range(5))
def test_four_pairs_of_base_and_rotation(seed):
    *_, essential = two_views(seed, 5)
    photos = two_photos_of(essential)
    assert photos.base.shape == (4, 3)
    assert photos.rotation.shape == (4, 3, 3)
    assert np.allclose(np.linalg.det(photos.rotation), 1.0, atol=1e-14)
    assert np.allclose(photos.rotation @ np.swapaxes(photos.rotation, 1, 2), np.eye(3), atol=1e-14)
    again = np.stack([cross_of(b) @ r for b, r in zip(*photos, strict=True)]) / np.sqrt(2.0)
    assert all(off([matrix], essential) < 1e-14 for matrix in again)
    # two rotations, half a turn about the base apart, with both signs of the base
    turn = Rotation.from_matrix(photos.rotation[0] @ photos.rotation[2].T).as_rotvec()
    assert np.allclose(np.abs(turn @ photos.base[0]), np.pi, atol=1e-7)
    assert np.allclose(photos.base[0], -photos.base[1])


def test_pairs_of_many_matrices():
    found = np.stack([two_views(seed, 5)[2] for seed in range(6)]).reshape(2, 3, 3, 3)
    photos = two_photos_of(found)
    assert photos.base.shape == (2, 3, 4, 3)
    assert np.allclose(photos.rotation[1, 2], two_photos_of(found[1, 2]).rotation)
