"""What a hypothesis is: a block with one mistake undone, whether its adjustment makes sense, and what to say then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.records.block import Block

_NEAR = 0.5
"""Part of the distance to their points by which most photos may move and still be said to be where they were given."""


def _always(_: SolvedBlock) -> bool:
    return True


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A block as it would be without one mistake.

    Parameters
    ----------
    code : str
        Stable name in kebab-case.
    where : str
        The record or file concerned; "" where the text names it.
    block : Block
    text : callable
        From the adjustment of that block: what is probably wrong and what to do; "" if nothing is to be said.
    holds : callable
        From the same: whether it is an adjustment that the hypothesis foresees. Whether it fits is not tested here; see
        `orip.mistakes.fit_comparison`.
    concerns_start : bool
        The mistake is, or may be, in the preliminary values alone: it is no objection that the data as given fit, too,
        when they start where the adjustment of the hypothesis ended.
    """

    code: str
    where: str
    block: Block
    text: Callable[[SolvedBlock], str]
    holds: Callable[[SolvedBlock], bool] = _always
    concerns_start: bool = False

    def warnings(self, solved: SolvedBlock) -> list[ProjectWarning]:
        """Return what to say if the adjustment of this block explains the misfit."""
        text = self.text(solved)
        return [ProjectWarning(self.code, self.where, text)] if text else []


def constant_text(text: str) -> Callable[[SolvedBlock], str]:
    """Return a function that gives this text for every adjustment."""
    return lambda _: text


def photos_stay_near(solved: SolvedBlock) -> bool:
    """Tell whether most photos are near the position where they were given, compared with the distance to their points.

    A block adjusts itself to control of any scale; the positions of its photos tell which scale is right.
    """
    state, points = solved.state, solved.block.photo_points
    moved = np.linalg.norm(state.centres - solved.block.photo_orientation[:, :3], axis=1)
    distance = np.linalg.norm(state.points[points.point] - state.centres[points.photo], axis=1)
    return bool(np.median(moved) < _NEAR * np.median(distance))
