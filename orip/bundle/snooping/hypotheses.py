"""What may be wrong together, and which hypotheses fail their test after an adjustment.

Observations whose errors are correlated with those of others are tested each by what its own error would do.

An error of one observation acts on the decorrelated equations of its whole group, along a column of the whitening
matrix. Leaving the observation out is the same as estimating that error (the mean shift model), so that these
directions take the place of its rows: with directions D, orthonormal for each point, residuals D^T v, and cofactors
I - D^T (I - H) D, all formulas for independent observations hold.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.outlier_tests import OutlierTest
from orip.adjustment.residual_sums import TESTABLE, JointEffects, joint_effects
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.correlated_rows import CorrelatedRows
from orip.bundle.kinds.control_point import ControlPointObservations
from orip.bundle.kinds.direction import DirectionObservations
from orip.bundle.kinds.element import ElementObservations
from orip.bundle.kinds.figure import LineObservations
from orip.bundle.kinds.given_direction import GivenDirectionObservations
from orip.bundle.kinds.observation import Observations
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.kinds.station_attitude import AttitudeObservations
from orip.bundle.kinds.station_difference import DifferenceObservations
from orip.bundle.kinds.station_position import PositionObservations
from orip.bundle.kinds.weighted_unknown import AdditionalParameterObservations, AntennaParameterObservations
from orip.bundle.solve import SolvedBlock
from orip.structs import replace


def correlated_groups(observations: Sequence[Observations]) -> list[CorrelatedRows]:
    """Return the groups of correlated observations of a block, their rows among all of it."""
    return list(_among_all(observations))


def _among_all(observations: Sequence[Observations]) -> Iterator[CorrelatedRows]:
    first = 0
    for kind in observations:
        for group in kind.correlations():
            yield replace(group, rows=first + group.rows)
        first += len(kind.rows.error)


def with_their_groups(groups: Sequence[CorrelatedRows], rows: IntArray) -> IntArray:
    """Return rows (k,) in ascending order, with all of the groups that they belong to."""
    touched = [group.rows for group in groups if np.isin(group.rows, rows).any()]
    return np.unique(np.concatenate([rows, *touched])) if touched else rows


def in_directions(
    groups: Sequence[CorrelatedRows], every: IntArray, effects: JointEffects, places: Sequence[IntArray], rows: IntArray
) -> JointEffects:
    """Return the effects of rows (k,) from those of all rows of their groups, each along the error of its observation.

    Parameters
    ----------
    every : array (c,) of int
        Rows that the effects are of, as `with_their_groups` returns them.
    places : sequence of arrays of int
        Those among `rows` of what is left out together.
    rows : array (k,) of int
    """
    directions = np.zeros((len(every), len(rows)))
    directions[np.searchsorted(every, rows), np.arange(len(rows))] = 1.0
    for group in groups:
        at = np.searchsorted(every, group.rows) if np.isin(group.rows, rows).any() else np.zeros(0, dtype=np.int64)
        if not len(at):
            continue
        used = effects.in_use[at]
        for own in places:
            if np.isin(rows[own], group.rows).all() and effects.in_use[np.searchsorted(every, rows[own])].all():
                shift = group.whitening[:, np.searchsorted(group.rows, rows[own])] * used[:, None]
                directions[:, own] = 0.0
                directions[np.ix_(at, own)] = np.linalg.qr(shift)[0]
    gram = directions.T @ directions
    return JointEffects(
        directions.T @ effects.residual,
        directions.T @ effects.cofactor @ directions - (gram - np.eye(len(rows))),
        effects.in_use[np.searchsorted(every, rows)],
    )


def size_of_errors(
    group: CorrelatedRows, rows: IntArray, residual: FloatArray, cofactor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the estimated errors (k,) of observations left out, and their deviations, both over the a-priori errors.

    Parameters
    ----------
    group : CorrelatedRows
        With these observations after the others.
    rows : array (k,) of int
        All of the group that are left out.
    residual, cofactor : arrays (k,) and (k, k)
        Of the equations.
    """
    own = np.searchsorted(group.rows, rows)
    factor = np.linalg.inv(group.whitening[np.ix_(own, own)])
    covariance = factor @ (np.eye(len(own)) + cofactor) @ factor.T
    return -factor @ residual, np.sqrt(np.diag(covariance))


def are_correlated(groups: Sequence[CorrelatedRows], hypotheses: Sequence[Sequence[int]], count: int) -> BoolArray:
    """Return which hypotheses (u,) are of observations correlated with others beside them."""
    number, size = np.full(count, -1), np.array([len(group.rows) for group in groups], dtype=np.int64)
    for place, group in enumerate(groups):
        number[group.rows] = place
    return np.array([number[rows[0]] >= 0 and size[number[rows[0]]] > len(rows) for rows in hypotheses], dtype=bool)


# - a photo point: x and y;
# - a control point: its weighted coordinates;
# - a control element; and together those of one projection centre, rotation or point;
# - a direction or a zenith angle; both to one target; and all of a theodolite set;
# - the position of an exposure station; its attitude;
# - the two distances of a point from a line, and the two angles of a given direction;
# - a distance, and an observation of any other kind, by itself.
#
# Constants are no observations, and neither the zeros that additional parameters are observed to be nor the a-priori
# values of an antenna are measurements that would be left out.


class Hypotheses(Struct, frozen=True):
    """Groups of observations that may be wrong; one observation may be in several.

    Parameters
    ----------
    rows : tuple of tuples of int
        Observations of each group, among all of the block.
    by_component : array of bool
        Photo points: tested by the larger w of x and y. All others are tested as a whole.
    in_one_place : array of bool
        The rows depend on the unknowns of one photo or one point.
    correlated : array of bool
        Their errors are correlated with those of others: what an error of theirs does is tested, not their rows.
    """

    rows: tuple[tuple[int, ...], ...]
    by_component: BoolArray
    in_one_place: BoolArray
    correlated: BoolArray

    def __len__(self) -> int:
        return len(self.rows)


def hypotheses_of(observations: Sequence[Observations]) -> Hypotheses:
    """Return what may be wrong in all observations of a block that are used."""
    rows: list[tuple[int, ...]] = []
    of_kind: list[tuple[int, Observations]] = []
    first = 0
    for kind in observations:
        found = _used(_groups(kind), kind.rows.used, first)
        rows += found
        of_kind.append((len(found), kind))
        first += len(kind.rows.photo)
    counts = [count for count, _ in of_kind]
    photo_points = [isinstance(kind, PhotoPointObservations) for _, kind in of_kind]
    local = [isinstance(kind, (ControlPointObservations, ElementObservations)) for _, kind in of_kind]
    correlated = are_correlated(correlated_groups(observations), rows, first)
    in_one_place = np.repeat(np.array(local), counts) & ~correlated
    return Hypotheses(tuple(rows), np.repeat(np.array(photo_points), counts), in_one_place, correlated)


def _used(groups: Iterable[tuple[int, ...]], used: BoolArray, first: int) -> list[tuple[int, ...]]:
    """Return the groups without observations that are not used, each once, in numbers among all of the block."""
    if used.all():
        found = [tuple(first + row for row in group) for group in groups]
    else:
        found = [tuple(first + row for row in group if used[row]) for group in groups]
    return list(dict.fromkeys(group for group in found if group))


def _groups(kind: Observations) -> Iterable[tuple[int, ...]]:
    """Return the groups of rows of a kind; a group follows the single rows that it consists of."""
    if kind.exact or isinstance(kind, (AdditionalParameterObservations, AntennaParameterObservations)):
        return ()
    if isinstance(kind, PhotoPointObservations):
        return ((row, row + 1) for row in range(0, len(kind.rows.photo), 2))
    if isinstance(kind, ControlPointObservations):
        return _together(range(len(kind.point)), kind.point)
    if isinstance(kind, ElementObservations):
        return _element_groups(kind)
    if isinstance(kind, (PositionObservations, AttitudeObservations)):
        return _together(range(len(kind.station)), kind.station)
    if isinstance(kind, DifferenceObservations):
        return _together(range(len(kind.pair)), kind.pair)
    if isinstance(kind, DirectionObservations):
        return _direction_groups(kind)
    if isinstance(kind, (LineObservations, GivenDirectionObservations)):
        return _together(range(len(kind.component)), kind.groups())
    return ((row,) for row in range(len(kind.rows.photo)))


def _element_groups(kind: ElementObservations) -> Iterator[tuple[int, ...]]:
    yield from ((row,) for row in range(len(kind.row)))
    for quantity in ("centre", "rotation", "point"):
        rows = np.flatnonzero(kind.quantity == quantity).tolist()
        yield from (group for group in _together(rows, kind.row) if len(group) > 1)


def _direction_groups(kind: DirectionObservations) -> Iterator[tuple[int, ...]]:
    rows = range(len(kind.set))
    yield from ((row,) for row in rows)
    for line_of_sight in _together(rows, np.unique(np.stack([kind.set, kind.target]), axis=1, return_inverse=True)[1]):
        if len(line_of_sight) > 1:
            yield line_of_sight
    yield from (whole for whole in _together(rows, kind.set) if len(whole) > 1)


def _together(rows: Iterable[int], belongs_to: IntArray) -> Iterator[tuple[int, ...]]:
    """Return the rows that belong to the same thing."""
    ordered = sorted(rows, key=lambda row: (int(belongs_to[row]), row))
    for _, members in groupby(ordered, key=lambda row: int(belongs_to[row])):
        yield tuple(members)


class Failing(NamedTuple):
    """Hypotheses that fail (u,), and the ratios (u,) of statistic to limit, the largest first."""

    numbers: IntArray
    ratio: FloatArray


class Screening:
    """The hypotheses of a block, arranged so that many photo points are tested at once."""

    def __init__(self, hypotheses: Hypotheses, observations: int) -> None:
        self.hypotheses = hypotheses
        sizes = np.array([len(rows) for rows in hypotheses.rows], dtype=np.int64)
        self._by_rows = hypotheses.by_component | ((sizes == 1) & ~hypotheses.correlated)
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
            *_effects_of_groups(solved, [index for index in groups if index not in set(here)], self.hypotheses),
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
    design = solved.ground_design(np.concatenate(rows))
    first = 0
    for index, own in zip(groups, rows, strict=True):
        part = design[first : first + len(own)]
        first += len(own)
        columns = np.unique(part.indices)
        partials = part[:, columns].toarray()
        cofactor = partials @ solved.cofactors_of(columns) @ partials.T
        yield index, JointEffects(solved.equations.residual[own], cofactor, np.ones(len(own), dtype=bool))


def _effects_of_groups(
    solved: SolvedBlock, groups: Iterable[int], hypotheses: Hypotheses
) -> Iterator[tuple[int, JointEffects]]:
    rows = [np.array(hypotheses.rows[index]) for index in groups]
    if not rows:
        return
    every = np.unique(np.concatenate(rows))
    effects = effects_of(solved, every, [np.searchsorted(every, own) for own in rows])
    for index, own in zip(groups, rows, strict=True):
        at = np.searchsorted(every, own)
        yield index, JointEffects(effects.residual[at], effects.cofactor[np.ix_(at, at)], effects.in_use[at])


def effects_of(solved: SolvedBlock, rows: IntArray, places: Sequence[IntArray]) -> JointEffects:
    """Return how observations (k,) act on each other; `places` are those of what is left out together."""
    groups = correlated_groups(solved.problem.observations)
    every = with_their_groups(groups, rows) if groups else rows
    effects = joint_effects(solved.equations, solved.normals, solved.problem.layout, every)
    return in_directions(groups, every, effects, places, rows) if len(every) > len(rows) or groups else effects
