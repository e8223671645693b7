"""Strip connection: strips become a block in the system of the first one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.prelim.similarity.bridging import JoinedSystems
from orip.prelim.similarity.joining import POINTS_WITHOUT_PHOTO, Joined, Names, join
from orip.prelim.similarity.partial_blocks import assembled
from orip.records.results.preliminary import NotOriented, PartialBlock, SimilarityStep


def connect(strip: PartialBlock, block: PartialBlock, names: Names) -> Joined | NotOriented:
    """Connect a strip to another one, or to a block of strips; see `join`."""
    return join(strip, block, names, "connect")


def connect_strips(strips: Sequence[PartialBlock], names: Names) -> JoinedSystems:
    """Connect strips to one block.

    Parameters
    ----------
    strips : sequence of PartialBlock
        In the order of their rows.
    names : Names

    Returns
    -------
    JoinedSystems
        Each strip is connected to all those connected so far. One that cannot be connected is tried again after the
        others, and finally begins a block of its own; the failures say why.
    """
    waiting = list(strips)
    systems: list[PartialBlock] = []
    steps: list[SimilarityStep] = []
    failures: list[NotOriented] = []
    while waiting:
        members = [waiting.pop(0)]
        failed = _connect_all(members, waiting, steps, names)
        systems.append(assembled(members))
        failures.extend(failed)
    return JoinedSystems(tuple(systems), tuple(steps), tuple(failures))


def _connect_all(
    members: list[PartialBlock], waiting: list[PartialBlock], steps: list[SimilarityStep], names: Names
) -> list[NotOriented]:
    """Move strips from the waiting ones to the members of a block; return why the first of the others does not connect.

    They are tried in turn, until all that wait have been tried with all of the block that they touch.
    """
    block, seen = members[0], _Seen(names)
    seen.add(block)
    tried: dict[str, _Tried] = {}
    turn = failures = 0
    while failures < len(waiting):
        turn %= len(waiting)
        strip = waiting[turn]
        before = tried.get(strip.name)
        is_due = seen.has_new(strip, before.members) if before else turn == 0 or seen.can_join(strip)
        found = connect(strip, block, names) if is_due else None
        if isinstance(found, Joined):
            members.append(found.block)
            block = assembled(members)
            seen.add(strip)
            steps.append(found.step)
            del waiting[turn]
            failures = 0
            continue
        if found is not None:
            tried[strip.name] = _Tried(len(members), found)
        turn, failures = turn + 1, failures + 1
    return [tried[waiting[0].name].reason] if waiting else []


class _Tried(NamedTuple):
    """Why a strip could not be connected to a block, and how many members that had."""

    members: int
    reason: NotOriented


class _Seen:
    """The points and photos of a block, by which most strips of a large one are known not to touch it.

    They are kept with the number of the last member that has them.
    """

    def __init__(self, names: Names) -> None:
        self._members = 0
        self._points = np.zeros(len(names.points), dtype=np.int64)
        self._photos = np.zeros(len(names.photos), dtype=np.int64)

    def add(self, strip: PartialBlock) -> None:
        self._members += 1
        self._points[strip.points] = self._photos[strip.photos] = self._members

    def can_join(self, strip: PartialBlock) -> bool:
        """Tell whether a strip has points or photos enough in common with the block."""
        points = int(np.count_nonzero(self._points[strip.points]))
        return points >= POINTS_WITHOUT_PHOTO or bool(self._photos[strip.photos].any())

    def has_new(self, strip: PartialBlock, members: int) -> bool:
        """Tell whether members after the first ones have points or photos of a strip: else it would be joined alike."""
        return bool((self._points[strip.points] > members).any() or (self._photos[strip.photos] > members).any())
