"""The verdict on groups of observations: which of them contradict all the others, and in what.

Thousands of photo points hide a few hundred observations of other kinds in sigma0. Here each group is tested by itself:
the square sum of its residuals, and their mean. The mean's test is the most powerful one against an error common to the
whole group. Where stations and control points contradict each other, the means of both show it alike; the check points
decide which of them is shifted, and where they cannot, both are named.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.groups.figures import (
    GroundGroups,
    GroupFigures,
    JudgedGroup,
    TestName,
    ground_tests,
    photo_test,
)
from orip.bundle.groups.observation_groups import observation_groups
from orip.bundle.groups.shifts import common_shifts
from orip.bundle.solve import SolvedBlock
from orip.records.results.group_test import CommonError, CommonExtent, Contradiction, ContradictionKind, GroupTest
from orip.structs import replace

FAMILY = 0.03
"""Probability that any group of a block is doubted although all a-priori errors are right."""

_PHOTO_SIGMA0 = 1.5
_PHOTO_MEAN = 0.5
"""Photo points are so many that immaterial effects are significant: sigma0 and standard mean from which they count."""

_APART = 1.2
"""A camera's photo points scatter more than others if their sigma0 is so many times that of the block."""

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
    """What may be doubted: the logarithm of its probability, what it is, the groups by their number, and a shift."""

    log_p: float
    what: ContradictionKind
    groups: tuple[int, ...]
    shift: float = math.nan
    shift_sd: float = math.nan
    doubted: tuple[int, ...] = ()
    common: tuple[CommonError, ...] = ()
    extent: CommonExtent = "strip"


def group_verdict(solved: SolvedBlock, errors: FloatArray, check_points: Collection[str]) -> GroupVerdict:
    """Test all groups of observations of an adjusted block.

    Parameters
    ----------
    solved : SolvedBlock
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
    number = sum(len(group.log_p) for group in tested) + len(ground.together)
    limit = float(np.log(FAMILY / max(number, 1)))
    sigma0 = solved.variance.sigma0
    shifts = [
        _Candidate(
            found.log_p,
            "shift",
            tuple(len(of_photos) + place for place in found.groups),
            found.shift,
            found.shift_sd,
            tuple(len(of_photos) + place for place in found.doubted),
            found.common,
            found.extent,
        )
        for found in common_shifts(ground, ground.sums_with_checks(), limit)
    ]
    found = _without_consequences([*shifts, *_others(tested, limit, sigma0)], tested)
    named = {place for candidate in found for place in (*candidate.groups, *candidate.doubted)}
    results = [
        replace(group.test, doubted=place in named or bool(_doubts(group, limit, sigma0)))
        for place, group in enumerate(tested)
    ]
    contradictions = tuple(
        Contradiction(
            candidate.what,
            tuple(results[place] for place in candidate.groups),
            float(np.exp(candidate.log_p)),
            candidate.shift,
            candidate.shift_sd,
            candidate.common,
            candidate.extent,
        )
        for candidate in found
    )
    return GroupVerdict(tuple(results), contradictions)


def _doubts(group: JudgedGroup, limit: float, sigma0: float) -> list[TestName]:
    """Return the tests that a group fails by more than an immaterial amount."""
    test = group.test
    failed = [name for name, log_p in group.log_p.items() if log_p < limit]
    if test.kind != "photo":
        return failed
    apart = test.sigma0 > max(_PHOTO_SIGMA0, _APART * sigma0)
    material = {"scatter": apart, "mean": abs(test.mean) > _PHOTO_MEAN * group.typical_error}
    return [name for name in failed if material[name]]


def _others(tested: Sequence[JudgedGroup], limit: float, sigma0: float) -> Iterator[_Candidate]:
    """Yield all other failed tests; the means on the ground are among the common shifts."""
    for place, group in enumerate(tested):
        for name in _doubts(group, limit, sigma0):
            if name != "mean" or group.test.kind == "photo":
                yield _Candidate(group.log_p[name], _KIND_OF_TEST[name], (place,))


def _without_consequences(candidates: Sequence[_Candidate], tested: Sequence[JudgedGroup]) -> list[_Candidate]:
    """Return the gravest contradiction, and of the others those that it does not explain.

    A shift makes groups scatter, and one wrong check point moves the mean of all; but further shifts were found after
    the first had been allowed for. An error of all stations moves the whole block: what else is wrong shows once it
    is modelled. Of several failed tests of a kind of observation the gravest is enough.
    """
    ordered = sorted(candidates)
    if ordered and ordered[0].extent != "strip":
        return ordered[:1]
    if not ordered or ordered[0].what == "shift":
        return [candidate for candidate in ordered if candidate.what == "shift"]
    kinds = set()
    found = []
    for candidate in ordered:
        kind = tested[candidate.groups[0]].test.kind
        if candidate.what != "shift" and kind not in kinds:
            found.append(candidate)
        kinds.add(kind)
    return found
