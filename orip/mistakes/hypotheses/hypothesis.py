"""What a hypothesis is: a block with one mistake corrected, whether its adjustment makes sense, and its warnings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.records.block import Block

_NEAR = 0.5
"""Part of the distance to their points by which most photos may move and still count as being where they were given."""


def _always(_: SolvedBlock) -> bool:
    return True


Findings = Callable[[SolvedBlock], list[ProjectWarning]]


class Hypothesis(Struct, frozen=True):
    """A block as it would be without one mistake.

    Parameters
    ----------
    block : Block
    findings : callable
        From the adjustment of that block: what is probably wrong and what to do; empty if there is nothing to report.
    holds : callable
        From the same: whether the adjustment agrees with the hypothesis. Whether it fits is not tested here; see
        `orip.mistakes.fit_comparison`.
    concerns_start : bool
        The mistake is, or may be, in the preliminary values alone: it is no objection that the data as given fit, too,
        when they start where the adjustment of the hypothesis ended.
    """

    block: Block
    findings: Findings
    holds: Callable[[SolvedBlock], bool] = _always
    concerns_start: bool = False


def finding(code: str, where: str, text: str) -> Findings:
    """Return a function that gives the same warning for every adjustment.

    Parameters
    ----------
    code : str
        Stable name in kebab-case.
    where : str
        The record or file concerned; "" where the text names it.
    text : str
        What is probably wrong and what to do.
    """
    return lambda _: [ProjectWarning(code, where, text)]


def photos_stay_near(solved: SolvedBlock) -> bool:
    """Tell whether most photos are near the position where they were given, compared with the distance to their points.

    A block fits control of any scale; the positions of its photos show which scale is right.
    """
    state, points = solved.state, solved.block.photo_points
    moved = np.linalg.norm(state.centres - solved.block.photo_orientation[:, :3], axis=1)
    distance = np.linalg.norm(state.points[points.point] - state.centres[points.photo], axis=1)
    return bool(np.median(moved) < _NEAR * np.median(distance))
