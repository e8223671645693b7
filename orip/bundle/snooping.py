"""Data snooping: blunders are found one after another, each by the largest test statistic of a residual or group.

A photo point is left out as a whole, x and y; a control point is tested and left out as a three-dimensional group, so
that one that contradicts the photos is found even where every photo agrees with every other. After each round the block
is adjusted again; at the end, units that fit nevertheless are used again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal, NamedTuple

import numpy as np

from orip.adjustment.iteration import IterationRecord
from orip.adjustment.outlier_tests import OutlierTest
from orip.arrays import FloatArray
from orip.bundle.kinds.control_point import ControlPointObservations
from orip.bundle.kinds.observation import Observations
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.problem import pose_problem, starting_state
from orip.bundle.solve import SolvedBlock, iteration_settings, solve_problem
from orip.progress import stage
from orip.records.block import Block
from orip.records.control import ControlPoint
from orip.records.observation_kinds import CONTROL_POINT, PHOTO_POINT
from orip.records.solution import Blunder, Diagnosis

_NEAR_THE_WORST = 0.5
"""In one round only candidates whose statistic is at least this part of the largest are left out: smaller ones may be
its effects."""

_TESTABLE = 1e-4
"""Redundancy number below which a residual does not show the error of its observation."""

_LEAST_SIGMA0 = 1e-6
"""A sigma0 below it comes from observations without errors: their residuals are rounding, not blunders."""

_COMPONENTS_OF_A_PHOTO_POINT = 2


@dataclass(frozen=True, slots=True)
class SnoopingSettings:
    """Settings of data snooping.

    Parameters
    ----------
    sigma0 : {"apriori", "posteriori"}
        Known to be 1, or estimated from the same adjustment.
    alpha : float
        Error probability of the test of one photo point (x and y each have half of it) or control point.
    """

    sigma0: Literal["apriori", "posteriori"] = "apriori"
    alpha: float = 0.001


class _Unit(NamedTuple):
    """Observations left out together: their kind, rows among all observations, photo (-1: none) and point."""

    kind: str
    rows: tuple[int, ...]
    photo: int
    point: int


@dataclass(frozen=True, slots=True)
class _Finding:
    """A unit left out, with the statistic and limit that it failed by."""

    unit: int
    statistic: float
    limit: float


@dataclass(frozen=True, slots=True)
class Snooped:
    """The adjustment without its blunders, and the blunders in the order they were found."""

    solved: SolvedBlock
    blunders: tuple[Blunder, ...]


def snoop(
    block: Block,
    settings: SnoopingSettings,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
) -> Snooped:
    """Adjust a block and leave out its blunders.

    Parameters
    ----------
    block : Block
    settings : SnoopingSettings
    on_iteration, stop_asked : callables
        See `orip.bundle.solve.solve_block`; weights are not reduced while snooping.

    Returns
    -------
    Snooped
    """
    with stage("searching for blunders"):
        search = _Search(block, settings, on_iteration, stop_asked)
        search.leave_out()
        search.take_back()
    return Snooped(search.solved, tuple(search.blunders()))


def without_blunders(block: Block, blunders: Sequence[Blunder]) -> Block:
    """Return the block in which the blunders are disregarded: their residuals are listed, without influence."""
    photos = [photo.name for photo in block.photos]
    place = block.point_index()
    wrong = {
        (photos.index(blunder.photo), place[blunder.point]) for blunder in blunders if blunder.kind == PHOTO_POINT.name
    }
    points = block.photo_points
    keep = [(int(photo), int(point)) not in wrong for photo, point in zip(points.photo, points.point, strict=True)]
    used = points.used & np.array(keep, dtype=bool)[:, None]
    contradicting = {blunder.point for blunder in blunders if blunder.kind == CONTROL_POINT.name}
    control = tuple(_disregarded(point) if point.name in contradicting else point for point in block.control_points)
    return replace(block, photo_points=replace(points, used=used), control_points=control)


def blunder_diagnosis(blunders: Sequence[Blunder], ground_unit: str) -> Iterator[Diagnosis]:
    """Return a diagnosis for each blunder, in the order they were found."""
    for _, members in groupby(blunders, key=lambda row: row.order):
        found = list(members)
        sizes = ", ".join(f"{row.component} {row.size:+.4g} ± {row.sd:.2g}" for row in found)
        if found[0].kind == CONTROL_POINT.name:
            where = f"control point {found[0].point}"
            text = f"{where} contradicts the photos; its coordinates are off by {sizes} {ground_unit}"
            remedy = "check the coordinates, and whether the feature measured in the photos is the one surveyed"
        else:
            where = f"photo {found[0].photo} point {found[0].point}"
            text = f"{where} is measured wrongly; it is off by {sizes} mm"
            remedy = "measure it again, or disregard it; check its name"
        yield Diagnosis("blunder", where, text, remedy)


def _disregarded(point: ControlPoint) -> ControlPoint:
    x, y, z = (None if error is None else -abs(error) for error in point.errors)
    return replace(point, errors=(x, y, z))


class _Search:
    """A search: the units, those left out so far, and the last adjustment."""

    def __init__(
        self,
        block: Block,
        settings: SnoopingSettings,
        on_iteration: Callable[[IterationRecord], None],
        stop_asked: Callable[[], bool],
    ) -> None:
        self.settings = settings
        self.stop_asked = stop_asked
        self.on_iteration = on_iteration
        robust = replace(iteration_settings(block.definition), start_down_weight=2)
        block = _without_weights(block)
        self.iterations = iteration_settings(block.definition)
        problem = pose_problem(block)
        self.units = _units(problem.observations)
        self.left_out: dict[int, _Finding] = {}
        self.solved = solve_problem(problem, starting_state(block), self.iterations, on_iteration, stop_asked)
        if not self._converged and not stop_asked():
            self.solved = solve_problem(problem, starting_state(block), robust, on_iteration, stop_asked)
            self._leave_out_down_weighted()

    @property
    def _converged(self) -> bool:
        return self.solved.converged

    def _leave_out_down_weighted(self) -> None:
        """Leave out what the Danish method down-weights: blunders too large for the iterations to converge."""
        weight = self.solved.weight_factors
        for index in self._in_use():
            if (weight[list(self.units[index].rows)] < 1.0).any():
                self.left_out[index] = self._score(index, left_out=True)
        self._adjust_again()

    def leave_out(self) -> None:
        """Leave out the worst units, round by round, until none fails its test or the iterations do not converge."""
        while self._converged and not self.stop_asked() and (found := self._worst()):
            self.left_out.update({finding.unit: finding for finding in found})
            self._adjust_again()

    def take_back(self) -> None:
        """Use units again that fit the final adjustment, the best first, each at most once."""
        found = dict(self.left_out)
        returned: set[int] = set()
        while self._converged and not self.stop_asked():
            scores = {unit: self._score(unit, left_out=True) for unit in self.left_out if unit not in returned}
            fitting = {unit: score for unit, score in scores.items() if score.statistic <= score.limit}
            if not fitting:
                return
            best = min(fitting, key=lambda unit: fitting[unit].statistic / fitting[unit].limit)
            returned.add(best)
            del self.left_out[best]
            self._adjust_again()
            if self._fails(best):
                # at its former place: blunders are listed in the order they were found
                self.left_out = {
                    unit: finding for unit, finding in found.items() if unit in self.left_out or unit == best
                }
                self._adjust_again()

    def blunders(self) -> Iterator[Blunder]:
        """Return what was left out, with the size of each error and its standard deviation."""
        problem = self.solved.problem
        rows = [kind.rows for kind in problem.observations]
        photo = [name for part in rows for name in part.photo]
        point = [name for part in rows for name in part.point]
        component = [name for part in rows for name in part.component]
        error = np.concatenate([part.error for part in rows])
        residual = self.solved.equations.residual
        for order, finding in enumerate(self.left_out.values(), start=1):
            unit = self.units[finding.unit]
            shown = (
                unit.rows if unit.kind == CONTROL_POINT.name else (max(unit.rows, key=lambda row: abs(residual[row])),)
            )
            for row in shown:
                yield Blunder(
                    order, unit.kind, photo[row], point[row], component[row],
                    # the residual of an unused observation has its own error and that of its prediction
                    size=float(-residual[row] * error[row]),
                    sd=float(self._test().sigma0 * error[row] * np.sqrt(1.0 + self._leverage()[row])),
                    statistic=finding.statistic,
                    limit=finding.limit,
                )  # fmt: skip

    def _adjust_again(self) -> None:
        excluded = np.zeros(len(self._residual()), dtype=bool)
        for unit in self.left_out:
            excluded[list(self.units[unit].rows)] = True
        before = self.solved
        self.solved = solve_problem(
            replace(before.problem, excluded=excluded),
            before.state,
            self.iterations,
            self.on_iteration,
            self.stop_asked,
        )

    def _residual(self) -> FloatArray:
        return self.solved.equations.residual

    def _leverage(self) -> FloatArray:
        return self.solved.cofactors.leverage

    def _test(self) -> OutlierTest:
        variance = self.solved.variance
        if self.settings.sigma0 == "apriori" or not np.isfinite(variance.sigma0_all):
            return OutlierTest(self.settings.alpha, 1.0, None)
        return OutlierTest(self.settings.alpha, max(variance.sigma0_all, _LEAST_SIGMA0), variance.redundancy)

    def _fails(self, unit: int) -> bool:
        score = self._score(unit, left_out=False)
        return score.statistic > score.limit

    def _score(self, unit: int, *, left_out: bool) -> _Finding:
        """Return the statistic of a unit in the last adjustment; NaN where it cannot be tested."""
        test, rows = self._test(), list(self.units[unit].rows)
        residual, leverage = self._residual()[rows], self._leverage()[rows]
        sign = 1.0 if left_out else -1.0
        if self.units[unit].kind == CONTROL_POINT.name:
            cofactor = np.eye(len(rows)) + sign * self._cofactor_of_control(unit)
            if left_out:
                quantity = float(residual @ np.linalg.solve(cofactor, residual)) / test.sigma0**2
                size = 1 if test.redundancy is None else len(rows)
                return _Finding(unit, float(np.sqrt(quantity / size)), test.group_limit(len(rows)))
            return _Finding(unit, test.group_statistic(residual, cofactor), test.group_limit(len(rows)))
        variance = 1.0 + sign * leverage
        testable = variance > _TESTABLE
        if not testable.any():
            return _Finding(unit, float("nan"), test.limit(_COMPONENTS_OF_A_PHOTO_POINT))
        w = np.abs(residual[testable]) / (test.sigma0 * np.sqrt(variance[testable]))
        return _Finding(unit, float(w.max()), test.limit(_COMPONENTS_OF_A_PHOTO_POINT))

    def _cofactor_of_control(self, unit: int) -> FloatArray:
        """Return the cofactor (k, k) of the adjusted coordinates of a control point, in units of their errors."""
        # the rows of the design matrix have the partials by the point's coordinates, divided by the errors
        design = self.solved.equations.design[list(self.units[unit].rows)]
        columns = np.unique(design.indices)
        partials = design[:, columns].toarray()
        return np.asarray(partials @ self.solved.cofactors_of(columns) @ partials.T)

    def _worst(self) -> list[_Finding]:
        """Return the units to leave out next: the worst one, and others that it hardly affects."""
        scores = [self._score(unit, left_out=False) for unit in self._in_use()]
        failing = [score for score in scores if score.statistic > score.limit]
        if not failing:
            return []
        failing.sort(key=lambda score: score.statistic / score.limit, reverse=True)
        worst = failing[0]
        if self.units[worst.unit].kind == CONTROL_POINT.name:
            return [worst]
        chosen: list[_Finding] = []
        photos: set[int] = set()
        points: set[int] = set()
        for score in failing:
            unit = self.units[score.unit]
            near = score.statistic / score.limit >= _NEAR_THE_WORST * worst.statistic / worst.limit
            if near and unit.kind == PHOTO_POINT.name and unit.photo not in photos and unit.point not in points:
                chosen.append(score)
            # only the worst of a photo or point is a candidate, whether it was chosen or not
            photos.add(unit.photo)
            points.add(unit.point)
        return chosen

    def _in_use(self) -> list[int]:
        active = self.solved.equations.active
        return [
            index
            for index, unit in enumerate(self.units)
            if index not in self.left_out and active[list(unit.rows)].any()
        ]


def _without_weights(block: Block) -> Block:
    """Return the block with down-weighting off: reduced weights would hide blunders from the tests."""
    definition = replace(block.definition, start_down_weight=block.definition.max_iterations)
    return replace(block, definition=definition)


def _units(observations: tuple[Observations, ...]) -> list[_Unit]:
    """Return what may be left out: photo points, and control points with their weighted coordinates."""
    units: list[_Unit] = []
    start = 0
    for kind in observations:
        rows = kind.rows
        if isinstance(kind, PhotoPointObservations):
            for index in range(len(kind.photo)):
                pair = [2 * index + place for place in range(2) if rows.used[2 * index + place]]
                if pair:
                    place = tuple(start + row for row in pair)
                    units.append(_Unit(PHOTO_POINT.name, place, int(kind.photo[index]), int(kind.point[index])))
        elif isinstance(kind, ControlPointObservations):
            for point in np.unique(kind.point[rows.used]):
                mine = np.flatnonzero((kind.point == point) & rows.used)
                units.append(_Unit(CONTROL_POINT.name, tuple(start + int(row) for row in mine), -1, int(point)))
        start += len(rows.photo)
    return units
