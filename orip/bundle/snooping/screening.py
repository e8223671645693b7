"""Which hypotheses fail their test after an adjustment, from the redundancy numbers of all observations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from orip.adjustment.joint_effects import TESTABLE, JointEffects, joint_effects
from orip.adjustment.outlier_tests import OutlierTest
from orip.arrays import FloatArray, IntArray
from orip.bundle.snooping.hypotheses import Hypotheses
from orip.bundle.solve import SolvedBlock
from orip.structs import replace


class Failing(NamedTuple):
    """Hypotheses that fail (u,), and the ratios (u,) of statistic to limit, the largest first."""

    numbers: IntArray
    ratio: FloatArray


class Screening:
    """The hypotheses of a block, arranged so that many photo points are tested at once."""

    def __init__(self, hypotheses: Hypotheses, observations: int) -> None:
        self.hypotheses = hypotheses
        sizes = np.array([len(rows) for rows in hypotheses.rows], dtype=np.int64)
        self._by_rows = hypotheses.by_component | (sizes == 1)
        self._groups = np.flatnonzero(~self._by_rows).tolist()
        of_rows = np.flatnonzero(self._by_rows)
        members = [row for index in of_rows.tolist() for row in hypotheses.rows[index]]
        self.of_row = np.full(observations, -1)
        self.of_row[members] = np.repeat(of_rows, sizes[of_rows])
        self._among = np.where(hypotheses.by_component, sizes, 1)

    def failing(self, solved: SolvedBlock, test: OutlierTest) -> Failing:
        """Return what fails in an adjustment in which all observations have full weight or none."""
        found: dict[int, float] = {}
        for index, ratio in (*self._failing_rows(solved, test), *self._failing_groups(solved, test)):
            found[index] = max(ratio, found.get(index, 0.0))
        worst = sorted(found, key=lambda index: -found[index])
        return Failing(np.array(worst, dtype=np.int64), np.array([found[index] for index in worst]))

    def may_fit(self, solved: SolvedBlock, test: OutlierTest, left_out: Iterable[int]) -> list[int]:
        """Return those of the hypotheses left out that may be taken back: photo points that fit, and all others."""
        deviation = test.sigma0 * np.sqrt(1.0 + solved.cofactors.leverage)
        w = np.abs(solved.equations.residual) / deviation
        limit = test.limit_of_left_out(2)
        by_component, rows = self.hypotheses.by_component, self.hypotheses.rows
        return [index for index in left_out if not by_component[index] or (w[list(rows[index])] <= limit).all()]

    def _failing_rows(self, solved: SolvedBlock, test: OutlierTest) -> Iterator[tuple[int, float]]:
        redundancy = 1.0 - solved.cofactors.leverage
        tested = solved.equations.active & (self.of_row >= 0) & (redundancy > TESTABLE)
        limits = np.array([test.limit(int(among)) for among in range(1, int(self._among.max(initial=1)) + 1)])
        limit = limits[self._among[self.of_row] - 1] if len(self._among) else np.ones(len(redundancy))
        w = np.abs(solved.equations.residual) / (test.sigma0 * np.sqrt(np.where(tested, redundancy, 1.0)))
        for row in np.flatnonzero(tested & (w > limit)).tolist():
            yield int(self.of_row[row]), float(w[row] / limit[row])

    def _failing_groups(self, solved: SolvedBlock, test: OutlierTest) -> Iterator[tuple[int, float]]:
        active = solved.equations.active
        groups = [index for index in self._groups if active[list(self.hypotheses.rows[index])].all()]
        if not groups:
            return
        here = [index for index in groups if self.hypotheses.in_one_place[index]]
        for index, effects in (
            *_effects_in_one_place(solved, here, self.hypotheses),
            *_effects_of_directions(solved, [index for index in groups if index not in set(here)], self.hypotheses),
        ):
            (change,), (freedom,) = effects.square_sum_changes(np.arange(len(effects.residual))[None])
            if freedom and (ratio := np.sqrt(change) / (test.sigma0 * test.group_limit(int(freedom)))) > 1.0:
                yield index, float(ratio)


def _effects_in_one_place(
    solved: SolvedBlock, groups: Iterable[int], hypotheses: Hypotheses
) -> Iterator[tuple[int, JointEffects]]:
    """Return the effects within groups that depend on the unknowns of one photo or point: their cofactors are known."""
    rows = [list(hypotheses.rows[index]) for index in groups]
    if not rows:
        return
    design = _rows_on_the_ground(solved, np.concatenate(rows))
    first = 0
    for index, own in zip(groups, rows, strict=True):
        part = design[first : first + len(own)]
        first += len(own)
        columns = np.unique(part.indices)
        partials = part[:, columns].toarray()
        cofactor = partials @ solved.cofactors_of(columns) @ partials.T
        yield index, JointEffects(solved.equations.residual[own], cofactor, np.ones(len(own), dtype=bool))


def _rows_on_the_ground(solved: SolvedBlock, rows: IntArray) -> csr_array:
    """Return rows of the design matrix that are not of photo points, which come first."""
    photo_points, *others = solved.problem.observations
    problem = replace(solved.problem, observations=tuple(others), streamed=None, excluded=None)
    return problem.design(solved.state)[rows - len(photo_points.rows.photo)]


def _effects_of_directions(
    solved: SolvedBlock, groups: Iterable[int], hypotheses: Hypotheses
) -> Iterator[tuple[int, JointEffects]]:
    rows = [np.array(hypotheses.rows[index]) for index in groups]
    if not rows:
        return
    every = np.unique(np.concatenate(rows))
    effects = joint_effects(solved.equations, solved.normals, solved.problem.layout, every)
    for index, own in zip(groups, rows, strict=True):
        at = np.searchsorted(every, own)
        yield index, JointEffects(effects.residual[at], effects.cofactor[np.ix_(at, at)], effects.in_use[at])
