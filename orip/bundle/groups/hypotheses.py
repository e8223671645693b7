"""The errors in common that are tested: of groups, of stations by strips, of control, of distances, of held cameras."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.residual_sums import ResidualSums
from orip.bundle.groups.figures import GroundGroups, is_testable
from orip.records.observation_kinds import ANGULAR_UNKNOWNS
from orip.records.results.tests import CommonExtent

SINGLE_CONTROL = 0.1
"""Part of an error probability that a single control point has: that it does not fit is found by the test of every
observation, and here it explains what groups and cameras misfit by."""


class Cause(NamedTuple):
    """What may be wrong.

    Parameters
    ----------
    group : int
        The group that it is named by; of held parameters, numbers follow those of the groups.
    extent : CommonExtent
        What has the error in common.
    name : str
        Of a single observation; else empty.
    """

    group: int
    extent: CommonExtent
    components: tuple[str, ...]
    name: str


class Together(Struct, frozen=True):
    """Sums that are tested together: one hypothesis.

    Parameters
    ----------
    components : tuple of (str, bool)
        Of each column: what it is called, and whether it is a drift; shifts come first.
    groups : tuple of int
        Those that it concerns.
    span : tuple of str
        What is wrong, whatever the component: of two with the same span one is a part of the other.
    name : str
        Of a single observation.
    """

    columns: tuple[int, ...]
    components: tuple[tuple[str, bool], ...]
    groups: tuple[int, ...]
    span: tuple[str, ...]
    extent: CommonExtent = "strip"
    name: str = ""

    @property
    def cause(self) -> Cause:
        """Return what it says is wrong."""
        return Cause(
            self.groups[0], self.extent, tuple(name for name, drift in self.components if not drift), self.name
        )

    @property
    def is_single_control(self) -> bool:
        """Return whether it is a coordinate of one control point, or all of them."""
        return self.extent == "one" and self.span[0] == "control"

    @property
    def has_drift(self) -> bool:
        """Return whether it is a shift with a drift."""
        return any(drift for _, drift in self.components)


def hypotheses(ground: GroundGroups) -> list[Together]:
    """Return all errors that are tested: of each group by itself, of stations by strips and all together, of control.

    Strips are tested as a shift and, where times are known, as a shift with a drift; then distances one by one, and the
    held parameters of cameras.
    """
    groups, width = ground.groups, ground.errors.shape[1]
    tests = [
        Together((number,), ((group.component, False),), (number,), _span(ground, number))
        for number, group in enumerate(groups)
    ]
    tests += _whole(ground)
    first = len(groups)
    for strip in ground.strips:
        names, span = [groups[number].component for number in strip.groups], _span(ground, strip.groups[0])
        shifts = tuple((name, False) for name in names)
        if len(strip.groups) > 1:
            tests.append(Together(strip.groups, shifts, strip.groups, span))
        if strip.has_drift:
            columns = (*strip.groups, *range(first, first + len(names)))
            tests.append(Together(columns, (*shifts, *((name, True) for name in names)), strip.groups, span))
            first += len(names)
    for every in ground.together:
        components, span = tuple((name, False) for name in every.components), (groups[every.groups[0]].kind, "all")
        columns = tuple(range(first, first + len(components)))
        tests.append(Together(columns, components, every.groups, span, every.extent))
        if every.extent == "all":
            for column, component in zip(columns, components, strict=True):
                mine = tuple(number for number in every.groups if groups[number].component == component[0])
                tests.append(Together((column,), (component,), mine, span, "all"))
        first += len(components)
    tests += _single(ground, first)
    for place, held in enumerate(ground.held.groups if ground.held is not None else ()):
        column = width - len(ground.held.groups) + place if ground.held is not None else 0
        span = ("camera", held.names[0], held.component)
        tests.append(Together((column,), ((held.component, False),), (len(groups) + place,), span, "held"))
    return tests


def _single(ground: GroundGroups, first: int) -> Iterator[Together]:
    """Yield distances and control coordinates one by one, and all coordinates of a control point."""
    members: dict[tuple[str, ...], list[Together]] = {}
    for column, (number, name) in enumerate(ground.singles, first):
        group = ground.groups[number]
        span: tuple[str, ...] = (group.kind, name)
        test = Together((column,), ((group.component, False),), (number,), span, "one", name)
        members.setdefault(span, []).append(test)
        yield test
    for span, mine in members.items():
        if len(mine) > 1:
            columns, components, groups = (
                tuple(part[0] for part in parts)
                for parts in zip(*((test.columns, test.components, test.groups) for test in mine), strict=True)
            )
            yield Together(columns, components, groups, span, "one", span[1])


def number_of_shifts(ground: GroundGroups, sums: ResidualSums) -> float:
    """Return how many errors in common share the error probability; single control points have a part of a share each.

    Those of strips are counted by component, together and with a drift, though these are correlated. What the unknowns
    absorb cannot be doubted, and takes nothing.
    """
    shown = is_testable(sums, np.diag(sums.covariance()))
    return sum(
        SINGLE_CONTROL if test.is_single_control else 1.0
        for test in hypotheses(ground)
        if shown[list(test.columns)].any()
    )


def _span(ground: GroundGroups, number: int) -> tuple[str, ...]:
    group = ground.groups[number]
    if group.kind in ("station", "attitude"):
        only = len({other.of for other in ground.groups if other.kind == group.kind}) == 1
        return (group.kind, "all") if only else (group.kind, "strip", group.of)
    if group.kind in ("control", "check", "distance"):
        return (group.kind,)
    if group.kind == "element" and group.of == "PHOTO":
        return (group.kind, "angles" if group.component in ANGULAR_UNKNOWNS else "positions")
    return (group.kind, group.of, group.component)


def _whole(ground: GroundGroups) -> Iterator[Together]:
    """Yield the coordinates of control, and of stations that were observed as elements, all together."""
    for kind, of, names in (("control", "", "X Y Z"), ("element", "PHOTO", "X0 Y0 Z0"), ("check", "", "X Y Z")):
        mine = {
            group.component: number
            for number, group in enumerate(ground.groups)
            if (group.kind, group.of) == (kind, of) and group.component in names.split()
        }
        if len(mine) > 1:
            components = tuple((name, False) for name in mine)
            numbers = tuple(mine.values())
            yield Together(numbers, components, numbers, _span(ground, numbers[0]), "whole")
