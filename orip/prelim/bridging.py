"""Bridging: the models of a row, one after the other, become a strip in the system of its first model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from orip.model.preliminary import NotOriented, SimilarityStep, SubBlock
from orip.prelim.joining import Joined, Names, assembled, join


@dataclass(frozen=True, slots=True)
class JoinedSystems:
    """What became of several sub-blocks.

    Parameters
    ----------
    systems : tuple of SubBlock
        One if all could be joined.
    steps : tuple of SimilarityStep
        In the order in which they were made.
    failures : tuple of NotOriented
        Why a sub-block began a system of its own.
    """

    systems: tuple[SubBlock, ...]
    steps: tuple[SimilarityStep, ...]
    failures: tuple[NotOriented, ...]


def bridge(model: SubBlock, previous: SubBlock, names: Names) -> Joined | NotOriented:
    """Bridge a model to the one before it, or to a strip of models; see `join`."""
    return join(model, previous, names, "bridge")


def bridge_row(models: Sequence[SubBlock], names: Names) -> JoinedSystems:
    """Bridge the models of a row.

    Parameters
    ----------
    models : sequence of SubBlock
        In the order of their columns.
    names : Names

    Returns
    -------
    JoinedSystems
        Strips. Each model is bridged to all that the strip has so far; the step names it with the model before it. One
        that cannot be bridged begins a new strip.
    """
    strips: list[list[SubBlock]] = []
    steps: list[SimilarityStep] = []
    failures: list[NotOriented] = []
    for model in models:
        if not strips:
            strips.append([model])
            continue
        strip = strips[-1]
        found = bridge(model, replace(assembled(strip), name=strip[-1].name), names)
        if isinstance(found, Joined):
            steps.append(found.step)
            strip.append(found.block)
        else:
            failures.append(found)
            strips.append([model])
    return JoinedSystems(tuple(assembled(strip) for strip in strips), tuple(steps), tuple(failures))
