"""Blocks of three, eliminated all at once, against dense inverses."""

from __future__ import annotations

import numpy as np
import pytest

from orip.adjustment.factorisation.elimination import factorise_blocks
from orip.adjustment.factorisation.null_space import LOST_ALL

MAX_LOST = 12.0


def blocks_of(count, seed, rows=5):
    design = np.random.default_rng(seed).normal(size=(count, rows, 3)) * [1.0, 1e3, 1e-3]
    return np.swapaxes(design, 1, 2) @ design


def factors_of(blocks, fixed=None):
    none = np.zeros(blocks.shape[:2], dtype=bool)
    full = np.einsum("bii->bi", blocks)
    return factorise_blocks(blocks, full, none if fixed is None else fixed, MAX_LOST)


def inverse_of(factors):
    return np.swapaxes(factors.half, 1, 2) @ factors.half


def test_halves_give_the_inverse_of_each_block():
    blocks = blocks_of(50, 1)
    found = factors_of(blocks)
    assert not found.removed.any()
    scale = np.sqrt(np.einsum("bii->bi", blocks))
    unit = blocks / (scale[:, :, None] * scale[:, None, :])
    assert np.allclose((inverse_of(found) * scale[:, :, None] * scale[:, None, :]) @ unit, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("held", [[0], [1], [2], [0, 2], [0, 1, 2]])
def test_fixed_coordinates_are_zero_and_the_others_inverted(held):
    blocks = blocks_of(4, 2)
    fixed = np.zeros((4, 3), dtype=bool)
    fixed[:, held] = True
    found = factors_of(blocks, fixed)
    free = [place for place in range(3) if place not in held]
    inverse = inverse_of(found)
    assert not found.removed.any()
    assert not inverse[:, held].any()
    for block, result in zip(blocks, inverse, strict=True):
        if free:
            wanted = np.linalg.inv(block[np.ix_(free, free)])
            assert np.allclose(result[np.ix_(free, free)], wanted, rtol=1e-9, atol=0.0)


def test_one_ray_leaves_one_coordinate_undetermined():
    # two equations: the direction that they miss is mostly along the third axis
    design = np.array([[1.0, 0.0, 0.1], [0.0, 1.0, 0.2]])
    found = factors_of((design.T @ design)[None])
    assert found.removed.tolist() == [[False, False, True]]
    assert found.lost_digits[0, 2] > MAX_LOST
    inverse = inverse_of(found)[0]
    assert not inverse[2].any()
    assert np.allclose(inverse[:2, :2], np.eye(2))


def test_a_coordinate_without_observations_has_lost_all():
    blocks = blocks_of(2, 3)
    blocks[1, 1, :] = blocks[1, :, 1] = 0.0
    found = factors_of(blocks)
    assert found.removed.tolist() == [[False] * 3, [False, True, False]]
    assert found.lost_digits[1, 1] == LOST_ALL
    assert np.allclose(inverse_of(found)[0], np.linalg.inv(blocks[0]), rtol=1e-9, atol=0.0)


def test_a_block_without_observations_is_removed_as_a_whole():
    found = factors_of(np.zeros((1, 3, 3)))
    assert found.removed.all()
    assert not found.half.any()


def test_digits_lost_do_not_depend_on_units():
    blocks = blocks_of(10, 4, rows=3)
    other = blocks * np.outer([1e-4, 1.0, 1e5], [1e-4, 1.0, 1e5])
    # which coordinate is the first is a matter of rounding, as all have a one on the diagonal; together they lose
    # the determinant
    assert np.allclose(factors_of(blocks).lost_digits.sum(axis=1), factors_of(other).lost_digits.sum(axis=1), atol=1e-8)


def test_no_blocks():
    assert factors_of(np.zeros((0, 3, 3))).half.shape == (0, 3, 3)


def test_a_coordinate_that_rounding_alone_moves_is_removed():
    # a point on the base of two photos: both rays are along the first axis, up to rounding
    design = np.array([[1e-16, 1.0, 0.0], [2e-16, 0.0, 1.0], [-1e-16, 1.0, 0.0], [1e-16, 0.0, 1.0]])
    blocks = (design.T @ design)[None]
    full = np.full((1, 3), np.trace(blocks[0]))
    found = factorise_blocks(blocks, full, np.zeros((1, 3), dtype=bool), MAX_LOST)
    assert found.removed.tolist() == [[True, False, False]]
