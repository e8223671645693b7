"""Bridging: the models of a row, one after the other, become a strip in the system of its first model."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

from msgspec import Struct

from orip.prelim.similarity.joining import Joined, Names, join
from orip.prelim.similarity.partial_blocks import assembled
from orip.records.results.preliminary import NotOriented, PartialBlock, SimilarityStep
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
    names : Names

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
