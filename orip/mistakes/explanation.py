"""Why an adjustment does not fit, or there is none: what was probably mistaken.

What a solution shows by itself is always looked at. Hypotheses need further adjustments; they are tried only where the
adjustment failed, did not fit within its a-priori errors, or down-weighted many observations of a kind.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_between, rotation_from_angles
from orip.mistakes.after_adjustment.angle_unit import angles_in_another_unit
from orip.mistakes.after_adjustment.contradicting_control import contradicting_control
from orip.mistakes.after_adjustment.errors_too_large import errors_too_large
from orip.mistakes.after_adjustment.mirrored_plane import mirrored_plane
from orip.mistakes.after_adjustment.misnamed_points import misnamed_points
from orip.mistakes.after_adjustment.observation_units import units_of_observations
from orip.mistakes.fit_comparison import Fit, explains, fit_of_adjustment, fit_of_solution, is_good, misfit
from orip.mistakes.hypotheses.hypothesis import Hypothesis
from orip.mistakes.hypotheses.order import hypotheses_of_failure, hypotheses_of_misfit
from orip.mistakes.readjuster import Readjuster
from orip.records.block import Block
from orip.records.solution import Solution

_MOST_WARNINGS = 5
"""The first ones matter, and the listings have all observations that do not fit."""

_EQUALLY = 0.01
"""Part of the observations by which the misfits of two hypotheses may differ that explain a block equally well."""

_LEAST_SIGMA0 = 0.2
"""Standard error of unit weight below which a hypothesis explains nothing: errors that are too large fit anything."""


def explain_misfit(solution: Solution, started: Block, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return what was probably mistaken, the most fundamental first; nothing where the block fits.

    Parameters
    ----------
    solution : Solution
    started : Block
        As its adjustment started.
    readjuster : Readjuster
    """
    given = fit_of_solution(solution)
    if readjuster.is_worthwhile:
        tried = hypotheses_of_misfit(solution, started, readjuster)
        if found := _best_explanation(tried, given, readjuster):
            return found
    if not is_good(given) and (found := explain_failure(readjuster, ())):
        return found
    block = readjuster.block
    found = [
        *mirrored_plane(block, solution),
        *angles_in_another_unit(block, solution),
        *errors_too_large(block, solution),
        *units_of_observations(solution),
        *contradicting_control(block, solution),
        *misnamed_points(block, solution),
    ]
    return found[:_MOST_WARNINGS]


def explain_start(solution: Solution, started: Block, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return what was probably mistaken in given preliminary values that led an adjustment astray.

    Parameters
    ----------
    solution : Solution
        That of the given values.
    started : Block
        As its adjustment started.
    readjuster : Readjuster
    """
    if not readjuster.is_worthwhile:
        return []
    tried = hypotheses_of_misfit(solution, started, readjuster)
    of_start = (hypothesis for hypothesis in tried if hypothesis.concerns_start)
    return _best_explanation(of_start, fit_of_solution(solution), readjuster)


def explain_failure(readjuster: Readjuster, not_oriented: Sequence[str]) -> list[ProjectWarning]:
    """Return what probably keeps a block from being adjusted at all.

    Parameters
    ----------
    readjuster : Readjuster
    not_oriented : sequence of str
        Photos for which no preliminary orientation was found.
    """
    if not readjuster.is_worthwhile:
        return []
    for tried in _adjusted(hypotheses_of_failure(readjuster.block, not_oriented), readjuster):
        if is_good(tried.fit) and tried.solved.variance.sigma0 > _LEAST_SIGMA0:
            return tried.hypothesis.warnings(tried.solved)
    return []


@dataclass(frozen=True, slots=True)
class _Tried:
    """A hypothesis and its adjustment."""

    hypothesis: Hypothesis
    solved: SolvedBlock
    fit: Fit

    @property
    def rotated(self) -> float:
        """Return the mean rotation of the photos from where they started, radians."""
        start = rotation_from_angles(self.solved.block.photo_orientation[:, 3:])
        return float(np.mean(angles_between(start, self.solved.state.rotations)))


def _adjusted(hypotheses: Iterable[Hypothesis], readjuster: Readjuster) -> Iterator[_Tried]:
    """Yield the hypotheses that can be adjusted and turn out as they foresee."""
    for hypothesis in hypotheses:
        solved = readjuster.adjust(hypothesis.block)
        if solved is not None and hypothesis.holds(solved):
            yield _Tried(hypothesis, solved, fit_of_adjustment(solved))


def _best_explanation(hypotheses: Iterable[Hypothesis], given: Fit, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return what to say for the hypothesis that explains most; of those that explain as much, the first."""
    found: list[_Tried] = []
    for tried in _adjusted(hypotheses, readjuster):
        if explains(tried.fit, given) and not _better_start_suffices(tried, readjuster):
            found.append(tried)
            if is_good(tried.fit):
                break
    if not found:
        return []
    scale = min(tried.fit.scale for tried in found)
    least = min(misfit(tried.fit, scale) for tried in found)
    equal = [tried for tried in found if misfit(tried.fit, scale) <= least + _EQUALLY]
    # the data as they were meant rotate the photos least
    best = min(equal, key=lambda tried: round(tried.rotated, 1))
    return best.hypothesis.warnings(best.solved)


def _better_start_suffices(tried: _Tried, readjuster: Readjuster) -> bool:
    """Tell whether the data as given fit as well if they start where the hypothesis ended."""
    if tried.hypothesis.concerns_start:
        return False
    again = readjuster.adjust_from(tried.solved)
    return again is not None and not explains(tried.fit, fit_of_adjustment(again))
