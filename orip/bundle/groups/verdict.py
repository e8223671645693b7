"""The verdict on groups of observations: which of them contradict all the others, and in what.

Thousands of photo points hide a few hundred observations of other kinds in sigma0. Here each group is tested by itself:
the square sum of its residuals, and their mean. The mean's test is the most powerful one against an error common to the
whole group. Where stations and control points contradict each other, the means of both show it alike; the check points
decide which of them is shifted, and where they cannot, both are named.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.residual_sums import ResidualSums
from orip.arrays import FloatArray
from orip.bundle.groups.figures import (
    GroundGroups,
    GroupFigures,
    JudgedGroup,
    TestName,
    ground_tests,
    held_tests,
    photo_test,
    scatter_test,
)
from orip.bundle.groups.hypotheses import Cause, number_of_shifts
from orip.bundle.groups.observation_groups import ObservationGroup, observation_groups
from orip.bundle.groups.shifts import CommonShift, common_shifts
from orip.bundle.solve import SolvedBlock
from orip.records.results.tests import CommonCause, Contradiction, ContradictionKind, GroupTest
from orip.structs import replace

FAMILY = 0.01
"""Probability that any group of a block is doubted although all a-priori errors are right."""

_OF_SHIFTS = 0.9
"""Part of it that errors in common share. They are as small as they can be and still matter; a-priori errors that are
wrong by a factor, or single observations, make square sums far less probable than chance does."""

_PHOTO_SIGMA0 = 1.5
_PHOTO_MEAN = 0.5
"""Photo points are so many that immaterial effects are significant: sigma0 and standard mean from which they count."""

_APART = 1.2
"""A camera's photo points scatter more than others if their sigma0 is so many times that of the block."""

_SEVERAL = 2

_KIND_OF_TEST: Mapping[TestName, ContradictionKind] = {
    "mean": "shift",
    "scatter": "scatter",
    "point": "point",
    "down-weighted": "down-weighted",
}


class GroupVerdict(Struct, frozen=True):
    """All groups, and what contradicts the others: the gravest first."""

    groups: tuple[GroupTest, ...]
    contradictions: tuple[Contradiction, ...]


class _Candidate(NamedTuple):
    """What may be doubted: the logarithm of its probability, what it is, the group by its number, and a shift.

    `together` are all groups of a kind of observation, the first of which is the group, and their test as one.
    """

    log_p: float
    what: ContradictionKind
    group: int
    shift: CommonShift | None = None
    together: tuple[tuple[int, ...], GroupTest] | None = None

    @property
    def doubted(self) -> tuple[int, ...]:
        """Return all groups that it concerns."""
        if self.together is not None:
            return self.together[0]
        return (self.group,) if self.shift is None else self.shift.doubted

    @property
    def order(self) -> tuple[float, str, int]:
        """Return what sorts the gravest first."""
        return self.log_p, self.what, self.group

    @property
    def is_of_all_stations(self) -> bool:
        """Return whether it moves the whole block."""
        return self.shift is not None and self.shift.cause.extent in ("all", "lever arm")


def group_verdict(solved: SolvedBlock, errors: FloatArray, check_points: Collection[str]) -> GroupVerdict:
    """Test all groups of observations of an adjusted block.

    Whatever group is doubted, there is a contradiction that says why.

    Parameters
    ----------
    errors : array (n,)
        A-priori errors of all observations.
    check_points : collection of str
        Names of the points whose given coordinates are compared. Those of a free network are not tested: its
        coordinates are arbitrary by a movement of the whole block.
    """
    groups = observation_groups(solved, () if solved.problem.datum is not None else check_points)
    figures = GroupFigures.of(solved, errors)
    of_photos = [photo_test(group, figures) for group in groups if group.kind == "photo"]
    ground = GroundGroups.of(solved, [group for group in groups if group.kind != "photo"], figures)
    tested = [*of_photos, *ground_tests(ground, figures)]
    with_checks = ground.sums_with_checks()
    of_control = _control_as_one(ground, figures)
    every = tested if of_control is None else [*tested, of_control]
    limits = limits_of_tests(every, number_of_shifts(ground, with_checks))
    sigma0 = solved.variance.sigma0
    shifts = _shifts(ground, with_checks, limits.shift, len(of_photos))
    others = list(_others(tested, limits, sigma0, with_means=not shifts))
    if of_control is not None and of_control.log_p.get("scatter", 0.0) < limits.other:
        numbers = tuple(place for place, group in enumerate(tested) if group.test.kind == "control")
        others.append(
            _Candidate(of_control.log_p["scatter"], "scatter", numbers[0], together=(numbers, of_control.test))
        )
    found = _without_consequences([*shifts, *others], tested)
    named = {place for candidate in found for place in candidate.doubted}
    results = [
        replace(group.test, doubted=place in named or bool(_doubts(group, limits, sigma0)))
        for place, group in enumerate(tested)
    ]
    held = [replace(test, doubted=True) for test in held_tests(ground)]
    contradictions = tuple(_contradiction(candidate, [*results, *held], len(of_photos)) for candidate in found)
    accused = [test for place, test in enumerate(held, len(results)) if place in named]
    return GroupVerdict((*results, *accused), contradictions)


def _control_as_one(ground: GroundGroups, figures: GroupFigures) -> JudgedGroup | None:
    """Return the coordinates of all control points with the test of their scatter; None where they are one group.

    Control that is less precise than is said often shows in X, Y and Z together alone.
    """
    mine = [number for number, group in enumerate(ground.groups) if group.kind == "control"]
    if len(mine) < _SEVERAL:
        return None
    rows, places = (
        np.concatenate(parts) for parts in zip(*((ground.groups[n].rows, ground.places[n]) for n in mine), strict=True)
    )
    names = tuple(name for number in mine for name in ground.groups[number].names)
    tested = scatter_test(ObservationGroup("control", "", "", rows, names), ground, places, figures)
    return tested._replace(log_p={name: log_p for name, log_p in tested.log_p.items() if name == "scatter"})


class Limits(NamedTuple):
    """Logarithms of the probabilities below which an error in common is found, and any other test fails."""

    shift: float
    other: float


def limits_of_tests(tested: Sequence[JudgedGroup], shifts: float) -> Limits:
    """Return the limits with which all tests of a block together err with the probability `FAMILY` (Bonferroni).

    Parameters
    ----------
    tested : sequence of JudgedGroup
        All groups. The means of those on the ground are among the errors in common.
    shifts : float
        Number of errors in common that are tested.
    """
    others = sum(name != "mean" or group.test.kind == "photo" for group in tested for name in group.log_p)
    of_shifts, of_others = FAMILY * _OF_SHIFTS, FAMILY * (1.0 - _OF_SHIFTS)
    return Limits(float(np.log(of_shifts / max(shifts, 1.0))), float(np.log(of_others / max(others, 1))))


def _shifts(ground: GroundGroups, with_checks: ResidualSums, limit: float, first: int) -> list[_Candidate]:
    """Return the errors common to groups; where the check points hide what shows without them, that."""
    less_precise = False
    for sums in (with_checks, ground.sums):
        shifts, less_precise = common_shifts(ground, sums, limit, is_control_less_precise=less_precise)
        if shifts:
            return [_Candidate(one.log_p, "shift", first + one.cause.group, _numbered(one, first)) for one in shifts]
    return []


def _numbered(shift: CommonShift, first: int) -> CommonShift:
    """Return a shift with its groups numbered among all, those of photo points included."""
    return shift._replace(doubted=tuple(first + place for place in shift.doubted))


def _contradiction(candidate: _Candidate, groups: Sequence[GroupTest], first: int) -> Contradiction:
    shift, p = candidate.shift, float(np.exp(candidate.log_p))
    if candidate.together is not None:
        return Contradiction(candidate.what, (candidate.together[1],), p)
    if shift is None:
        group = groups[candidate.group]
        return Contradiction(candidate.what, (group,), p, group.shift, group.shift_sd)
    causes = [_cause(cause, groups, first) for cause in (shift.cause, *shift.alternatives)]
    return Contradiction(
        candidate.what,
        tuple(cause.group for cause in causes),
        p,
        shift.shift,
        shift.shift_sd,
        shift.common,
        shift.cause.extent,
        tuple(causes[1:]),
    )


def _cause(cause: Cause, groups: Sequence[GroupTest], first: int) -> CommonCause:
    group = groups[first + cause.group]
    if cause.extent == "one":
        group = replace(group, number=1, worst=cause.name)
    return CommonCause(group, cause.extent, cause.components)


def _doubts(group: JudgedGroup, limits: Limits, sigma0: float) -> list[TestName]:
    """Return the tests that a group fails by more than an immaterial amount."""
    test = group.test
    # the mean of a group on the ground is one of the errors in common
    of_mean = limits.other if test.kind == "photo" else limits.shift
    failed = [name for name, log_p in group.log_p.items() if log_p < (of_mean if name == "mean" else limits.other)]
    if test.kind != "photo":
        return failed
    apart = test.sigma0 > max(_PHOTO_SIGMA0, _APART * sigma0)
    material = {"scatter": apart, "mean": abs(test.mean) > _PHOTO_MEAN * group.typical_error}
    return [name for name in failed if material[name]]


def _others(tested: Sequence[JudgedGroup], limits: Limits, sigma0: float, *, with_means: bool) -> Iterator[_Candidate]:
    """Yield all other failed tests; the means on the ground are among the common shifts, if there are any."""
    for place, group in enumerate(tested):
        for name in _doubts(group, limits, sigma0):
            if name != "mean" or with_means or group.test.kind == "photo":
                yield _Candidate(group.log_p[name], _KIND_OF_TEST[name], place)


def _without_consequences(candidates: Sequence[_Candidate], tested: Sequence[JudgedGroup]) -> list[_Candidate]:
    """Return the gravest contradiction, and of the others those that it does not explain.

    A shift makes groups scatter, and one wrong check point moves the mean of all; but further shifts were found after
    the first had been allowed for. An error of all stations moves the whole block: what else is wrong shows once it
    is modelled. Of several failed tests of a kind of observation the gravest is enough.
    """
    ordered = sorted(candidates, key=lambda candidate: candidate.order)
    if ordered and ordered[0].is_of_all_stations:
        return ordered[:1]
    if not ordered or ordered[0].what == "shift":
        return [candidate for candidate in ordered if candidate.what == "shift"]
    kinds = set()
    found = []
    for candidate in ordered:
        kind = tested[candidate.group].test.kind if candidate.group < len(tested) else "camera"
        if candidate.what != "shift" and kind not in kinds:
            found.append(candidate)
        kinds.add(kind)
    return found
