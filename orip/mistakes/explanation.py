"""Why an adjustment does not fit: the same data adjusted as it was probably meant, and what to say then.

What is known from the solution itself comes cheaply and is always looked at. Hypotheses are adjusted, and only where
the solution calls for them: where it failed, where residuals are part of the picture rather than of its precision, or
where they are beyond the a-priori errors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from orip.bundle.solve import SolvedBlock, solve_block
from orip.errors import NotSolvableError, ProjectWarning
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.mistakes.angle_unit import angles_in_another_unit
from orip.mistakes.control_hypotheses import (
    control_hypotheses,
    direction_hypotheses,
    error_hypotheses,
    mirrored_control,
    released_control,
)
from orip.mistakes.control_slips import contradicting_control, control_warnings
from orip.mistakes.error_units import errors_too_large
from orip.mistakes.fit_comparison import Fit, explains, fit_of_adjustment, fit_of_solution, is_good, misfit
from orip.mistakes.hypotheses import Hypothesis, camera_hypotheses, other_cameras, photo_hypotheses
from orip.mistakes.mirrored_plane import mirrored_plane
from orip.mistakes.misnamed_points import misnamed_points
from orip.mistakes.observation_units import units_of_observations
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.solution import Solution

_MOST_PHOTO_POINTS = 20_000
"""Blocks for which other readings are tried: in larger ones they would take longer than the user likes to wait."""

_PICTURE = 0.01
"""Mean square of the residuals, as part of that of the photo coordinates, from which on the picture itself is wrong:
a tenth of the coordinates."""

_MOST = 0.5
_MUCH_CONTROL = 0.2
"""Part of the control coordinates that loses weight where more is wrong than single points."""

_MOST_TOLD = 5
"""Warnings: the first ones matter, and listings have all observations that do not fit."""

_EQUALLY = 0.01
"""Part of the observations by which two readings may differ that explain a block equally well."""

_NOT_TOO_GOOD = 0.2
"""Standard error of unit weight: errors that are too large make everything fit, and explain nothing."""

_FAR_OFF = 1e6
"""Standard residuals count up to this, also those of points behind their photo."""

_DOUBTED_PHOTOS, _DOUBTED_CONTROL = 2, 3
"""How many photos and control points are looked at, the worst first."""


_CAUSES = {"misnamed-marks", "outside-frame", "senseless-camera"}
"""Warnings that explain what follows from them."""


@dataclass(frozen=True, slots=True)
class Trials:
    """Adjusts a block as it would be.

    Parameters
    ----------
    gathered : Block
        As measured and given.
    start : callable
        Gives a gathered block what it starts from.
    cameras : tuple of Camera
        All of the project.
    warnings : sequence of ProjectWarning
        What is known to be wrong already.
    """

    gathered: Block
    start: Callable[[Block], Block]
    cameras: tuple[Camera, ...]
    warnings: Sequence[ProjectWarning] = ()

    @property
    def oriented(self) -> bool:
        """Return whether the user gave all orientations."""
        return bool(np.isfinite(self.gathered.photo_orientation).all())

    @property
    def are_worth_while(self) -> bool:
        """Return whether trying is worth the time: the block is not too large, and nothing explains it already."""
        small = len(self.gathered.photo_points.photo) <= _MOST_PHOTO_POINTS
        return small and not any(each.code in _CAUSES for each in self.warnings)

    def adjusted(self, block: Block) -> SolvedBlock | None:
        """Return the adjustment of a gathered block; None where there is none."""
        try:
            return solve_block(self.start(block), lambda _: None, lambda: False)
        except (NotSolvableError, np.linalg.LinAlgError):
            return None


def explanations_of(solution: Solution, started: Block, trials: Trials) -> list[ProjectWarning]:
    """Return what probably went wrong, the most fundamental first; nothing where the block fits.

    Parameters
    ----------
    solution : Solution
    started : Block
        As its adjustment started.
    trials : Trials
    """
    given = fit_of_solution(solution)
    if trials.are_worth_while and (found := _best(_readings(solution, started, trials), given, trials)):
        return found
    if not is_good(given) and (found := explanations_of_failure(trials, ())):
        return found
    found = [
        *mirrored_plane(trials.gathered, solution),
        *angles_in_another_unit(trials.gathered, solution),
        *errors_too_large(trials.gathered, solution),
        *units_of_observations(solution),
        *contradicting_control(trials.gathered, solution),
        *misnamed_points(trials.gathered, solution),
    ]
    return found[:_MOST_TOLD]


@dataclass(frozen=True, slots=True)
class _Reading:
    """An adjustment of the data as they may have been meant, and what to say if they were."""

    solved: SolvedBlock
    fit: Fit
    says: Callable[[], list[ProjectWarning]]
    concerns_start: bool = False

    @property
    def turned(self) -> float:
        """Return the mean rotation of the photos from where they started, radians."""
        start = rotation_from_angles(self.solved.block.photo_orientation[:, 3:])
        trace = np.einsum("nij,nij->n", start, self.solved.state.rotations)
        return float(np.mean(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))))


def _readings(solution: Solution, started: Block, trials: Trials) -> Iterator[_Reading]:
    for each in _hypotheses(solution, started, trials):
        if (solved := trials.adjusted(each.block)) is not None and each.holds(solved):
            says = partial(_said, each, solved)
            yield _Reading(solved, fit_of_adjustment(solved), says, concerns_start=each.code == "angle-unit")
    block, given = trials.gathered, fit_of_solution(solution)
    for name, released in released_control(block, [] if is_good(given) else _doubted_control(block, given)):
        if (solved := trials.adjusted(released)) is not None:
            says = partial(_released, name, solved, block, solution.ground_unit)
            yield _Reading(solved, fit_of_adjustment(solved), says)


def _said(hypothesis: Hypothesis, solved: SolvedBlock) -> list[ProjectWarning]:
    return [ProjectWarning(hypothesis.code, hypothesis.where, hypothesis.says(solved))]


def _released(name: str, solved: SolvedBlock, block: Block, ground_unit: str) -> list[ProjectWarning]:
    row = block.point_index()[name]
    sd = solved.deviation_scale * np.sqrt(np.diag(solved.cofactors_of(solved.problem.unknowns.points[row])))
    seen = block.ground.to_project(solved.state.points[[row]])[0]
    return control_warnings(block, {name: (seen, sd)}, ground_unit)


def _hypotheses(solution: Solution, started: Block, trials: Trials) -> Iterator[Hypothesis]:
    gathered, given = trials.gathered, fit_of_solution(solution)
    # what concerns cameras and directions hardly matters for where photos start
    oriented = replace(gathered, photo_orientation=started.photo_orientation)
    if not is_good(given):
        if trials.oriented and (solution.status == "not_converged" or _is_in_the_picture(solution)):
            yield from photo_hypotheses(gathered)
            yield from control_hypotheses(gathered)
        yield from other_cameras(gathered, _doubted(given, "photo", 1)[:_DOUBTED_PHOTOS], trials.cameras)
        yield from camera_hypotheses(oriented)
    if not trials.oriented and _doubted_share(solution, "control") > _MUCH_CONTROL:
        yield from mirrored_control(gathered)
    if _doubted_share(solution, "direction") > _MOST:
        yield from direction_hypotheses(oriented)


def _best(readings: Iterable[_Reading], given: Fit, trials: Trials) -> list[ProjectWarning]:
    """Return what the reading says that explains most, the first of those that explain it equally well."""
    found: list[_Reading] = []
    for each in readings:
        if explains(each.fit, given) and not _started_better(each, trials):
            found.append(each)
            if is_good(each.fit):
                break
    if not found:
        return []
    scale = min(each.fit.scale for each in found)
    least = min(misfit(each.fit, scale) for each in found)
    equal = [each for each in found if misfit(each.fit, scale) <= least + _EQUALLY]
    # what was meant needs the least turning of the photos
    return min(equal, key=lambda each: round(each.turned, 1)).says()


def _started_better(reading: _Reading, trials: Trials) -> bool:
    """Tell whether the data as given fit as well, if only they start where the reading has ended."""
    if reading.concerns_start:
        return False
    state, place = reading.solved.state, reading.solved.block.point_index()
    orientation = np.hstack([state.centres, angles_from_rotation(state.rotations)])
    started = trials.start(replace(trials.gathered, photo_orientation=orientation))
    points = np.where(
        started.constant_points, started.point_start, state.points[[place[each] for each in started.point_names]]
    )
    try:
        again = solve_block(replace(started, point_start=points), lambda _: None, lambda: False)
    except (NotSolvableError, np.linalg.LinAlgError):
        return False
    return not explains(reading.fit, fit_of_adjustment(again))


def _doubted_share(solution: Solution, kind: str) -> float:
    """Return the part of the observations of a kind in use that has lost weight."""
    rows = solution.residuals
    weights = rows.weight_factor[(np.array(rows.kind) == kind) & ~np.isnan(rows.weight_factor)]
    return float(np.mean(weights < 1.0)) if len(weights) else 0.0


def _is_in_the_picture(solution: Solution) -> bool:
    """Tell whether residuals are part of what the photos show, and not of the precision with which they do."""
    rows = solution.residuals
    photo = np.array(rows.kind) == "photo"
    residual, observed = rows.residual[photo], rows.observed[photo]
    left_out = float(np.isnan(rows.weight_factor[photo]).mean())
    return left_out > _PICTURE or float(np.mean(residual**2)) > _PICTURE * float(np.var(observed))


def _doubted_control(block: Block, given: Fit) -> list[str]:
    """Return the constant control points whose rays fit worst."""
    constant = {name for name, held in zip(block.point_names, block.constant_points, strict=True) if held.any()}
    return [name for name in _doubted(given, "photo", 2) if name in constant][:_DOUBTED_CONTROL]


def _doubted(given: Fit, kind: str, name: int) -> list[str]:
    """Return photos (name = 1) or points (name = 2) by the mean square of their residuals, the worst first."""
    squares: dict[str, list[float]] = {}
    for each, standard in zip(given.observations, given.standard.tolist(), strict=True):
        if each[0] == kind:
            squares.setdefault(each[name], []).append(min(standard, _FAR_OFF) ** 2)
    return sorted(squares, key=lambda each: -float(np.mean(squares[each])))


def explanations_of_failure(trials: Trials, not_oriented: Sequence[str]) -> list[ProjectWarning]:
    """Return what probably keeps a block from being adjusted at all.

    Parameters
    ----------
    trials : Trials
    not_oriented : sequence of str
        Photos for which no preliminary values were found.
    """
    if not trials.are_worth_while:
        return []
    few = not_oriented if len(not_oriented) <= _DOUBTED_PHOTOS else ()
    for each in (*error_hypotheses(trials.gathered), *other_cameras(trials.gathered, few, trials.cameras)):
        solved = trials.adjusted(each.block)
        if solved is not None and is_good(fit_of_adjustment(solved)) and solved.variance.sigma0 > _NOT_TOO_GOOD:
            return _said(each, solved)
    return []
