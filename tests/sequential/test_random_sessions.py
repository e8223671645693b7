"""Random sessions of measuring: the triangle is that of a factorisation of all equations, whatever came before."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_triangular

from orip.online.sequential.hyper_rows import ObservationRows
from orip.online.sequential.sequential_block import SequentialBlock
from orip.online.sequential.standings import LEAST_REDUNDANCY

# a condition of some 1e3 (random partials) leaves 1e-13; steps that are undone leave more
_TRIANGLE = 1e-10
_LEFTOVER = 1e-9
_RANK = 1e-9
"""Part of the largest singular value below which one is zero: those of random partials are above 1e-6."""

_MOST = 200
"""Observations of a session: with more, nearly all of the time goes into the singular values that they are held to."""


def _square_sum(design: np.ndarray, right: np.ndarray) -> float:
    """Return the square sum of the residuals of a least squares adjustment."""
    solution = np.linalg.lstsq(design, right, rcond=_RANK)[0]
    return float(np.sum((design @ solution - right) ** 2))


class _Session:
    """Random observations of photos and points, and the equations that are in, densely."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.block: SequentialBlock[int] = SequentialBlock()
        self.photos, self.points, self.next_key = 0, [], 0
        for _ in range(3):
            self.new_photo()
        for _ in range(4):
            self.new_point()

    def new_photo(self) -> None:
        self.block.append(6)
        self.photos += 1

    def new_point(self) -> None:
        self.points.append(f"p{len(self.points)}")

    def observation(self) -> ObservationRows:
        """Return a random observation: mostly a photo point, else control, an element of a photo, or two photos'."""
        random, kind = self.random, self.random.uniform()
        point = self.points[random.integers(len(self.points))]
        if kind < 0.75:
            # photos near the last one are measured most
            photo = max(0, self.photos - 1 - int(random.exponential(3.0)))
            columns = 6 * photo + np.arange(6)
            return self.rows(point, columns, 2)
        if kind < 0.85:
            return self.rows(point, np.zeros(0, dtype=np.int64), 3)
        count = 1 if kind < 0.95 else 12
        columns = np.sort(random.choice(6 * self.photos, size=count, replace=False))
        return self.rows(None, columns, 1)

    def rows(self, point: str | None, columns: np.ndarray, count: int) -> ObservationRows:
        random = self.random
        by_point = random.normal(size=(count, 3)) if point else np.zeros((count, 3))
        return ObservationRows(
            point, by_point, columns, random.normal(size=(count, len(columns))), random.normal(size=count)
        )

    def dense(self, observations: list[ObservationRows]) -> tuple[np.ndarray, np.ndarray]:
        """Return the design matrix, the points' columns first, and the right-hand side."""
        size, place = self.block.triangle.size, {name: 3 * row for row, name in enumerate(self.points)}
        rows = []
        for observation in observations:
            part = np.zeros((len(observation.right), 3 * len(self.points) + size))
            if observation.point:
                part[:, place[observation.point] : place[observation.point] + 3] = observation.by_point
            part[:, 3 * len(self.points) + observation.columns] = observation.by_reduced
            rows.append(part)
        return np.vstack(rows), np.concatenate([observation.right for observation in observations])

    def step(self) -> None:
        kind, keys = self.random.uniform(), list(self.block.included)
        if kind < 0.02 and self.photos < 16:
            self.new_photo()
        elif kind < 0.06 and len(self.points) < 40:
            self.new_point()
        elif (kind < 0.60 and len(keys) < _MOST) or len(keys) < 30:
            self.include()
        elif kind < 0.85:
            self.block.exclude(keys[self.random.integers(len(keys))])
        else:
            key = keys[self.random.integers(len(keys))]
            old = self.block.included[key]
            self.block.replace(key, self.rows(old.point, old.columns, len(old.right)))

    def include(self) -> None:
        rows, before = self.observation(), list(self.block.included.values())
        trial = self.block.trial(-1, rows)
        leftovers = self.block.include(self.next_key, rows)
        square, checked = trial.square()
        if checked == len(rows.right):
            least = float(np.linalg.eigvalsh(trial.cofactor).min())
            # a square is divided by the redundancy number, which has an error of 1e-15
            tolerance = _LEFTOVER * (1.0 + square) / min(1.0, 1e3 * least)
            assert square == pytest.approx(float(np.sum(leftovers**2)), abs=tolerance)
        self.check_leftovers(before, rows, leftovers)
        self.next_key += 1

    def check_leftovers(self, before: list[ObservationRows], rows: ObservationRows, leftovers: np.ndarray) -> None:
        """Compare with w of each equation as the last one, from a factorisation of all equations before it.

        With R^T p = a^T its residual is e r and w = e sqrt(r), where r = 1 / (1 + p^T p) and e = l - a x: this keeps
        its digits however small the redundancy number r is.
        """
        factor = np.linalg.qr(np.column_stack(self.dense(before)), mode="r") if before else np.zeros((0, 1))
        pivots = np.abs(np.diagonal(factor)[:-1])
        if (
            not before
            or len(pivots) < factor.shape[1] - 1
            or (pivots <= _RANK * np.linalg.norm(factor[:, :-1], axis=0)).any()
        ):
            self.check_leftovers_by_singular_values(before, rows, leftovers)
            return
        size = len(pivots)
        for left, row in zip(leftovers, rows.rows(), strict=True):
            design, right = self.dense([row])
            p = solve_triangular(factor[:size, :size], design[0], trans="T")
            w = abs(right[0] - p @ factor[:size, size]) / np.sqrt(1.0 + p @ p)
            assert abs(left) == pytest.approx(w, abs=_LEFTOVER * (1.0 + w))
            factor = np.linalg.qr(np.vstack([factor, np.append(design[0], right[0])]), mode="r")

    def check_leftovers_by_singular_values(
        self, before: list[ObservationRows], rows: ObservationRows, leftovers: np.ndarray
    ) -> None:
        """Do the same where some unknowns are not determined.

        There w of an equation that is not checked is a small number over a small number; its leftover is compared with
        the rise of the square sum, which it is the root of.
        """
        for row in range(len(rows.right)):
            design, right = self.dense([*before, *rows.rows()[: row + 1]])
            left, values, _ = np.linalg.svd(design, full_matrices=False)
            rank = int(np.count_nonzero(values > _RANK * values[0]))
            redundancy = 1.0 - float(np.sum(left[-1, :rank] ** 2))
            if redundancy > LEAST_REDUNDANCY:
                residual = float(left[-1, :rank] @ (left[:, :rank].T @ right)) - right[-1]
                w = abs(residual) / np.sqrt(redundancy)
                # 1 - r from orthonormal columns has an error of 1e-15, and w that of sqrt(r)
                assert abs(leftovers[row]) == pytest.approx(w, abs=_LEFTOVER * (1.0 + w) / max(redundancy, 1e-3))
            else:
                rise = _square_sum(design, right) - _square_sum(design[:-1], right[:-1])
                # as many digits are lost as the redundancy number has zeros
                tolerance = _LEFTOVER * (1.0 + abs(rise)) / float(np.clip(1e3 * redundancy, 1e-3, 1.0))
                assert leftovers[row] ** 2 == pytest.approx(rise, abs=tolerance)

    def check_triangle(self) -> None:
        design, right = self.dense(list(self.block.included.values()))
        points = 3 * len(self.points)
        own = design[:, :points]
        left, values, _ = np.linalg.svd(own, full_matrices=False)
        basis = left[:, values > _RANK * values[0]]
        free = np.column_stack([design[:, points:], right])
        free = free - basis @ (basis.T @ free)
        factor = np.linalg.qr(free, mode="r")
        triangle = self.block.triangle
        size = triangle.size
        if np.linalg.matrix_rank(free[:, :size]) < size:
            return
        expected = factor[:size] * np.sign(np.diagonal(factor))[:size, None]
        found = np.column_stack([triangle.factor, triangle.right]) * np.sign(np.diagonal(triangle.factor))[:, None]
        assert np.abs(found - expected).max() <= _TRIANGLE * np.abs(expected).max()
        assert self.block.square_sum == pytest.approx(float(factor[size, size] ** 2), rel=_TRIANGLE)


@pytest.mark.parametrize("seed", range(3))
def test_triangle_and_leftovers_of_a_random_session(seed: int) -> None:
    session = _Session(seed)
    for step in range(120):
        session.step()
        if step % 3 == 0:
            session.check_triangle()
    session.check_triangle()
    keys = list(session.block.included)
    for key, of_many in zip(keys, session.block.standings(keys), strict=True):
        # by substitution, where those of all at once come from the inverse
        alone = session.block.standing(key)
        assert of_many.residual == pytest.approx(alone.residual, abs=_LEFTOVER)
        assert of_many.cofactor == pytest.approx(alone.cofactor, abs=_LEFTOVER)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", [7, 8, 9, 10, 11])
def test_triangle_and_leftovers_of_ten_thousand_steps(seed: int) -> None:
    session = _Session(seed)
    for step in range(10_000):
        session.step()
        if step % 10 == 0:
            session.check_triangle()
