"""The search: test all hypotheses, leave out the likeliest, adjust again; in the end take back what fits after all.

Within one linearisation many blunders are left out one after the other, each judged without those before
(`orip.adjustment.residual_sums`); an adjustment follows, which starts at the last solution. When nothing fails any
more, photo points left out are compared with the other rays of their points once more: other blunders disturbed the
choice while they were in use.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.adjustment.iteration_state import IterationRecord, IterationSettings
from orip.adjustment.outlier_tests import LEAST_SIGMA0, OutlierTest
from orip.adjustment.residual_sums import JointEffects, factored_rows, joint_effects
from orip.adjustment.sparse_rows import SparseRows
from orip.arrays import IntArray
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.snooping.findings import Finding, blunders_of
from orip.bundle.snooping.hypotheses import (
    Screening,
    correlated_groups,
    effects_of,
    hypotheses_of,
    in_directions,
    with_their_groups,
)
from orip.bundle.snooping.selection import (
    NOTHING_FREED,
    Candidates,
    Choice,
    FreedUnknowns,
    freed_unknowns,
    judged_again,
    to_leave_out,
    to_take_back,
)
from orip.bundle.solve import SolvedBlock, iteration_settings, solve_problem, without_observations
from orip.bundle.starting_state import starting_state
from orip.bundle.state import BlockState
from orip.progress import stage
from orip.records.block import Block
from orip.records.results.solution import Blunder
from orip.structs import replace

FAMILY_ALPHA = 0.05
"""Error probability of all tests of a block together, where that of one test is not given."""

LARGEST_ALPHA = 0.001
"""Error probability of one test in a block of few observations."""

_NEAR_THE_WORST = 0.1
"""Statistics below this part of the largest are judged after the next adjustment: those of large blunders change the
linearisation."""

_MOST_AT_ONCE = 300
"""Most hypotheses that are judged together, the worst ones; their cofactors are a full matrix."""

_FEW_RAYS = 6
"""Rays of a point up to which an error in one of them may look like an error in another one: with more, no two of them
have residuals that are correlated by much more than a quarter."""

_REVIEWED_AT_ONCE = 20
"""Photo points whose neighbours are judged together: those of other points hardly depend on each other."""


class SnoopingSettings(Struct, frozen=True):
    """Settings of data snooping.

    Parameters
    ----------
    sigma0 : {"apriori", "posteriori"}
        Known to be 1, or estimated from the same adjustment.
    alpha : float or None
        Error probability of one test. None: it follows from the number of tests, so that with a probability of 0.95 no
        correct observation of a block is left out; at most 0.001.
    """

    sigma0: Literal["apriori", "posteriori"] = "apriori"
    alpha: float | None = None


class Snooped(Struct, frozen=True):
    """The adjustment without its blunders, and the findings in the order in which they were made."""

    solved: SolvedBlock
    findings: tuple[Finding, ...]

    @property
    def blunders(self) -> tuple[Blunder, ...]:
        """Return the observations left out, with the sizes of their errors."""
        return blunders_of(self.solved, self.findings)


def snoop(
    block: Block,
    settings: SnoopingSettings,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
    pose: Callable[[Block], BlockProblem] = pose_problem,
) -> Snooped:
    """Adjust a block and leave out its blunders.

    Parameters
    ----------
    on_iteration, stop_asked : callables
        See `orip.bundle.solve.solve_block`; weights are not reduced while snooping.
    pose : callable
        Returns the problem of a block, as a whole or divided.
    """
    with stage("searching for blunders"):
        search = _Search(pose(block), settings, on_iteration, stop_asked)
        while search.goes_on and (search.leave_out() or search.take_back() or search.review()):
            search.adjust_again()
        findings = search.findings()
    return Snooped(search.solved, findings)


class _Search:
    """A search: what is left out so far, and the last adjustment."""

    def __init__(
        self,
        problem: BlockProblem,
        settings: SnoopingSettings,
        on_iteration: Callable[[IterationRecord], None],
        stop_asked: Callable[[], bool],
    ) -> None:
        block = problem.block
        self.sigma0 = settings.sigma0
        self.on_iteration, self.stop_asked = on_iteration, stop_asked
        self.iterations = replace(iteration_settings(block.definition), start_down_weight=None)
        self.hypotheses = hypotheses_of(problem.observations)
        tests = max(len(self.hypotheses), 1)
        self.alpha = min(FAMILY_ALPHA / tests, LARGEST_ALPHA) if settings.alpha is None else settings.alpha
        self.found: dict[int, Finding] = {}
        self.out: set[int] = set()
        self.kept: set[int] = set()
        self.returned: set[int] = set()
        self.reviewed: set[int] = set()
        self.solved = self._solved(problem, starting_state(block), self.iterations)
        self.screening = Screening(self.hypotheses, len(self.solved.equations.residual))
        if not self.solved.converged and not stop_asked():
            robust = replace(self.iterations, start_down_weight=2)
            self.solved = self._solved(problem, starting_state(block), robust)
            self._leave_out_down_weighted()

    @property
    def goes_on(self) -> bool:
        """Return whether there is a solution to test."""
        return self.solved.converged and not self.stop_asked()

    def adjust_again(self) -> None:
        """Adjust without what is left out, from the last solution."""
        excluded = np.zeros(len(self.solved.equations.residual), dtype=bool)
        for index in self.out:
            excluded[list(self.hypotheses.rows[index])] = True
        problem = without_observations(self.solved.problem, excluded)
        self.solved = self._solved(problem, self.solved.state, self.iterations)

    def _solved(self, problem: BlockProblem, start: BlockState, iterations: IterationSettings) -> SolvedBlock:
        return solve_problem(problem, start, iterations, self.on_iteration, self.stop_asked)

    def _with_stored_design(self) -> SolvedBlock:
        """Return the last adjustment with its design matrix, of which rows are asked for again and again."""
        equations = self.solved.equations
        if not isinstance(equations.rows, SparseRows):
            self.solved = replace(self.solved, equations=replace(equations, rows=SparseRows(equations.design)))
        return self.solved

    def leave_out(self) -> bool:
        """Leave out what fails; return whether there was something."""
        test = self._test()
        failing = self.screening.failing(self.solved, test)
        if not len(failing.numbers):
            return False
        rest = float(failing.ratio[_MOST_AT_ONCE]) if len(failing.numbers) > _MOST_AT_ONCE else 0.0
        # what is kept though it is wrong must not make others fail: they are judged without it
        kept = list(self.kept)
        numbers = kept + [index for index in failing.numbers[:_MOST_AT_ONCE].tolist() if index not in self.kept]
        rows, candidates = self._candidates(numbers)
        solved = self._with_stored_design()
        groups = correlated_groups(solved.problem.observations)
        every, equations = with_their_groups(groups, rows), solved.equations
        factored = factored_rows(equations, solved.weight_factors, solved.normals, solved.problem.layout, every)
        effects = JointEffects(equations.residual[every], factored.cofactor(), equations.active[every])
        if groups:
            effects = in_directions(groups, every, effects, candidates.places, rows)
            factored = factored.of(np.searchsorted(every, rows))
        for place in range(len(kept)):
            effects = effects.changed(candidates.places[place])
        out: list[int] = []
        for choice, now in to_leave_out(effects, candidates, test, lambda ratio: max(_NEAR_THE_WORST * ratio, rest)):
            own, freed = candidates.places[choice.candidate], NOTHING_FREED
            if now.unchecked(own):
                freed = freed_unknowns(solved, rows, factored, np.array(out, dtype=np.int64), own)
            if freed.are_own:
                out += own.tolist()
            self._note(choice, numbers, freed)
        return bool(out)

    def _note(self, choice: Choice, numbers: Sequence[int], freed: FreedUnknowns) -> None:
        """Note that a hypothesis is left out, or kept since more than its own points would be undetermined."""
        index = numbers[choice.candidate]
        (self.out if freed.are_own else self.kept).add(index)
        self.found[index] = Finding(
            self.hypotheses.rows[index],
            choice.statistic,
            choice.limit,
            alternatives=tuple(self.hypotheses.rows[numbers[other]] for other in choice.alternatives),
            undetermined=freed.names,
            kept=not freed.are_own,
        )

    def take_back(self) -> bool:
        """Use again what fits, each hypothesis at most once; return whether there was something."""
        left_out = [index for index in self.found if index in self.out and index not in self.returned]
        waiting = self.screening.may_fit(self.solved, self._test(), left_out)
        if not waiting:
            return False
        rows, candidates = self._candidates(waiting)
        solved = self._with_stored_design()
        effects = effects_of(solved, rows, candidates.places)
        back = [waiting[choice.candidate] for choice in to_take_back(effects, candidates, self._test())]
        self.returned.update(back)
        self.out.difference_update(back)
        return bool(back)

    def review(self) -> bool:
        """Judge each photo point left out again, among the rays of its point; return whether another one is wrong."""
        left_out = [index for index in self.found if index in self.out and index not in self.reviewed]
        left_out = [index for index in left_out if self._has_few_rays(index)][:_MOST_AT_ONCE]
        self.reviewed.update(left_out)
        exchanged = False
        for first in range(0, len(left_out), _REVIEWED_AT_ONCE):
            exchanged |= self._review(left_out[first : first + _REVIEWED_AT_ONCE])
        return exchanged

    def _has_few_rays(self, index: int) -> bool:
        """Return whether a hypothesis is a photo point that few others of its ground point check."""
        if not self.hypotheses.by_component[index]:
            return False
        point = self.solved.block.photo_points.point
        return bool(np.count_nonzero(point == point[self.hypotheses.rows[index][0] // 2]) <= _FEW_RAYS)

    def _review(self, left_out: Sequence[int]) -> bool:
        photo_points = self.solved.block.photo_points.point
        mine = {int(photo_points[self.hypotheses.rows[index][0] // 2]) for index in left_out}
        rays = np.flatnonzero(np.isin(photo_points, list(mine)))
        numbers = [index for index in np.unique(self.screening.of_row[2 * rays]).tolist() if index >= 0]
        rows, candidates = self._candidates(numbers)
        solved = self._with_stored_design()
        effects = joint_effects(solved.equations, solved.normals, solved.problem.layout, rows)
        exchanged = False
        for index in left_out:
            place = numbers.index(index)
            choice = judged_again(effects, candidates, self._test(), place)
            if choice is None:
                continue
            other = numbers[choice.candidate]
            finding = self.found[index]
            alternatives = tuple(self.hypotheses.rows[numbers[rival]] for rival in choice.alternatives)
            if other == index:
                both = dict.fromkeys((*alternatives, *finding.alternatives))
                self.found[index] = replace(finding, alternatives=tuple(both))
            elif not finding.undetermined and other not in self.returned and other not in self.found:
                self.out.remove(index)
                self.out.add(other)
                self.returned.add(index)
                self.reviewed.add(other)
                own = self.hypotheses.rows[other]
                self.found[other] = Finding(own, choice.statistic, choice.limit, alternatives)
                effects = effects.changed(candidates.places[place]).changed(candidates.places[choice.candidate])
                exchanged = True
        return exchanged

    def findings(self) -> tuple[Finding, ...]:
        """Return what is left out, or kept though it fails, in the order in which it was found."""
        if self.found:
            self._with_stored_design()
        return tuple(finding for index, finding in self.found.items() if index in self.out or index in self.kept)

    def _leave_out_down_weighted(self) -> None:
        """Leave out what the Danish method down-weights: blunders too large for the iterations to converge."""
        down = self.solved.weight_factors < 1.0
        for index in np.unique(self.screening.of_row[down & self.solved.equations.active]).tolist():
            if index >= 0:
                self.out.add(index)
                self.found[index] = Finding(self.hypotheses.rows[index], np.nan, np.nan)
        self.adjust_again()
        # without these something is no longer determined: they cannot be judged, and are used again
        removed = self.solved.normals.removed
        design = self._with_stored_design().equations.design
        needed = {index for index in self.out if removed[design[list(self.hypotheses.rows[index])].indices].any()}
        if needed and self.goes_on:
            self.out -= needed
            self.adjust_again()

    def _candidates(self, numbers: Sequence[int]) -> tuple[IntArray, Candidates]:
        """Return the rows of hypotheses, and these as candidates among the rows."""
        groups = [np.array(self.hypotheses.rows[index]) for index in numbers]
        rows = np.unique(np.concatenate(groups))
        places = [np.searchsorted(rows, group) for group in groups]
        return rows, Candidates(places, self.hypotheses.by_component[list(numbers)])

    def _test(self) -> OutlierTest:
        variance = self.solved.variance
        if self.sigma0 == "apriori" or not np.isfinite(variance.sigma0_all):
            return OutlierTest(self.alpha, 1.0, None)
        return OutlierTest(self.alpha, max(variance.sigma0_all, LEAST_SIGMA0), variance.redundancy)
