"""Bridging: the models of a row, one after the other, become a strip in the system of its first model."""

from __future__ import annotations

import math
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


def _contents(block: PartialBlock) -> tuple[set[int], set[int]]:
    return set(block.photos.tolist()), set(block.points.tolist())


def _have_in_common(one: tuple[set[int], set[int]], other: tuple[set[int], set[int]]) -> bool:
    return not (one[0].isdisjoint(other[0]) and one[1].isdisjoint(other[1]))


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
    strips: list[list[PartialBlock]] = []
    steps: list[SimilarityStep] = []
    failures: list[NotOriented] = []
    contents = [_contents(model) for model in models]
    for place, model in enumerate(models):
        if not strips:
            strips.append([model])
            continue
        strip = strips[-1]
        before = zip(strip, contents[place - len(strip) : place], strict=True)
        near = [member for member, has in before if _have_in_common(has, contents[place])] or strip[-1:]
        found = bridge(model, strip[-1], names, replace(assembled(near), name=strip[-1].name))
        if isinstance(found, Joined):
            steps.append(found.step)
            strip.append(found.block)
        else:
            failures.append(found)
            strips.append([model])
    return JoinedSystems(tuple(assembled(strip) for strip in strips), tuple(steps), tuple(failures))
