"""Bridging of the models of a row to a strip, and connection of strips to a block."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.prelim.similarity.joining import POINTS_WITHOUT_PHOTO, Joined, Names, join
from orip.prelim.similarity.partial_blocks import assembled
from orip.records.preliminary import NotOriented, PartialBlock, SimilarityStep
from orip.structs import replace

_BACK = -0.5
"""Cosine of 120 degrees: the base turns less from one model of a row to the next, even around a building."""


class JoinedSystems(Struct, frozen=True):
    """The result of joining several partial blocks.

    Parameters
    ----------
    systems : tuple of PartialBlock
        One if all could be joined.
    steps : tuple of SimilarityStep
        In the order in which they were made.
    failures : tuple of NotOriented
        Why a partial block stayed in a system of its own.
    """

    systems: tuple[PartialBlock, ...]
    steps: tuple[SimilarityStep, ...]
    failures: tuple[NotOriented, ...]


def bridge(
    model: PartialBlock, previous: PartialBlock, names: Names, strip: PartialBlock | None = None
) -> Joined | NotOriented:
    """Bridge a model to the one before it, or to the strip of models that ends with the one before it.

    See `join`. A remark names a model whose base runs back along that of the one before it.
    """
    found = join(model, previous if strip is None else strip, names, "bridge")
    if isinstance(found, NotOriented) or not _runs_back(found.block, previous):
        return found
    photos = " and ".join(f"photo {names.photos[k]}" for k in model.photos)
    remark = f"the base of {photos} runs back along that of model {previous.name}; are photos exchanged?"
    return replace(found, step=replace(found.step, remarks=(*found.step.remarks, remark)))


class _Strip:
    """The models of a strip, and which of them have each photo and each point."""

    def __init__(self, first: PartialBlock) -> None:
        self.models: list[PartialBlock] = []
        self._with: defaultdict[int, list[int]] = defaultdict(list)
        self.add(first)

    def add(self, model: PartialBlock) -> None:
        for one in _contents(model):
            self._with[one].append(len(self.models))
        self.models.append(model)

    def near(self, model: PartialBlock) -> PartialBlock:
        """Return the models that have photos or points of another one; the last if none has."""
        places = {place for one in _contents(model) if one in self._with for place in self._with[one]}
        whole = assembled([self.models[place] for place in sorted(places)] or self.models[-1:])
        return replace(whole, name=self.models[-1].name)


def _contents(block: PartialBlock) -> list[int]:
    """Return the points and, as negative numbers, the photos."""
    return [*block.points.tolist(), *(~block.photos).tolist()]


def _runs_back(model: PartialBlock, previous: PartialBlock) -> bool:
    base, before = (pair.centres[1] - pair.centres[0] for pair in (model, previous))
    return float(base @ before) < _BACK * math.sqrt(float(base @ base) * float(before @ before))


def bridge_row(models: Sequence[PartialBlock], names: Names) -> JoinedSystems:
    """Bridge the models of a row.

    Parameters
    ----------
    models : sequence of PartialBlock
        In the order of their columns.

    Returns
    -------
    JoinedSystems
        Strips. Each model is bridged to the whole strip so far; the step names it with the model before it. A model
        that cannot be bridged begins a new strip.
    """
    strips: list[_Strip] = []
    steps: list[SimilarityStep] = []
    failures: list[NotOriented] = []
    for model in models:
        if not strips:
            strips.append(_Strip(model))
            continue
        strip = strips[-1]
        found = bridge(model, strip.models[-1], names, strip.near(model))
        if isinstance(found, Joined):
            steps.append(found.step)
            strip.add(found.block)
        else:
            failures.append(found)
            strips.append(_Strip(model))
    return JoinedSystems(tuple(assembled(strip.models) for strip in strips), tuple(steps), tuple(failures))


def connect(strip: PartialBlock, block: PartialBlock, names: Names) -> Joined | NotOriented:
    """Connect a strip to another one, or to a block of strips; see `join`."""
    return join(strip, block, names, "connect")


def connect_strips(strips: Sequence[PartialBlock], names: Names) -> JoinedSystems:
    """Connect strips to one block.

    Parameters
    ----------
    strips : sequence of PartialBlock
        In the order of their rows.

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
