"""Why an adjustment does not fit, or is impossible: what was probably mistaken.

What a solution shows by itself is always looked at. Hypotheses need further adjustments; they are tried only where the
adjustment failed, did not fit within its a-priori errors, or down-weighted many observations of a kind.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np
from msgspec import Struct

from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_between, rotation_from_angles
from orip.mistakes.camera_values import far_from_given
from orip.mistakes.control.check_points import contradicting_check_points, control_in_another_height_system
from orip.mistakes.control.contradicting_control import contradicting_control, without_control
from orip.mistakes.control.contradicting_distances import contradicting_distances
from orip.mistakes.given_orientations import (
    compared_with_adjusted,
    misgiven,
    misgiven_as_a_whole,
    moved_photos,
    without_orientations,
)
from orip.mistakes.ground_systems import control_axes
from orip.mistakes.hypothesis import (
    Fit,
    Hypothesis,
    Misfit,
    Readjuster,
    explains,
    fit_of_adjustment,
    fits_without_wrong_matches,
    is_good,
    misfit,
    removes_misfits,
)
from orip.mistakes.misread_photos import mirror_readings, mirrored_text
from orip.mistakes.order import SIGNS_IN_RESULT, hypotheses_of_failure, hypotheses_of_misfit
from orip.mistakes.other_units import angles_in_another_unit, errors_too_large
from orip.mistakes.photo_coordinates import COORDINATE_UNIT, MIRRORED, mirrored_alone, mirrored_photos, mirrored_plane
from orip.mistakes.photo_precision import IMPRECISE, precision_too_small
from orip.mistakes.point_numbers import misnamed_points, points_under_two_numbers
from orip.mistakes.stations.contradicting_positions import (
    contradicting_positions,
    part_of_flight_elsewhere,
    scattered_positions,
)
from orip.mistakes.stations.doubted_camera import (
    camera_explains_more,
    lens_of_doubted_camera,
    without_positions,
)
from orip.mistakes.stations.misread_pictures import pictures_instead_of_positions
from orip.mistakes.stations.misread_positions import misread_stations
from orip.mistakes.stations.off_alike import all_off_alike
from orip.mistakes.stations.rolling_shutters import rolling_shutters
from orip.mistakes.stations.two_lenses import two_lenses_of_photos
from orip.mistakes.vertical_photos import misread_vertical_photos
from orip.records.block import Block
from orip.records.results.solution import Solution
from orip.structs import replace

_MOST_WARNINGS = 5
"""Most warnings: the first ones matter, and the listings have all observations that do not fit."""

_EQUALLY = 0.01
"""Part of the observations by which the misfits of two equally good hypotheses may differ."""

_STAYS = 0.3
"""Mean rotation, radians, up to which photos are where they were given: a hypothesis that turns them further may be the
mirror image of a likelier one."""

_AS_WELL, _NEAR_GIVEN = 1.05, 0.5
"""Ratio of sigma0 up to which two readings fit equally, and shift of a photo over the distance to its points with which
it is where it was given."""

_FITS = 1.5
"""Standard error of unit weight up to which the photos fit, whatever the stations do."""

_CONTROL_FITS = 5.0
"""Standard errors within which a control point fits."""

_LEAST_SIGMA0 = 0.2
"""Standard error of unit weight below which a hypothesis explains nothing: errors that are too large fit anything."""


_MIRRORED_ONE_BY_ONE = 40_000
"""Photos that are tried as mirrored ones, times photo points of the block: a search for preliminary values for each."""


def explain_misfit(
    solution: Solution,
    solved: SolvedBlock,
    started: Block,
    readjuster: Readjuster,
    from_own_values: SolvedBlock | None = None,
) -> list[ProjectWarning]:
    """Return what was probably mistaken, the most fundamental first; nothing where the block fits.

    Parameters
    ----------
    solved : SolvedBlock
        The adjustment that it comes from.
    started : Block
        The block with its starting values.
    from_own_values : SolvedBlock or None
        Its adjustment without the given orientations; None: there was none yet.
    """
    given, misfit = fit_of_adjustment(solved), Misfit(solution, solved, readjuster)
    if found := next(filter(None, (find(misfit) for find in SIGNS_IN_RESULT)), []):
        return found[:_MOST_WARNINGS]
    if solved.weighing.of_tracks and fits_without_wrong_matches(given):
        lenses = two_lenses_of_photos(misfit) or lens_of_doubted_camera(misfit)
        return (lenses or _shown_by_itself(solution, solved, given, readjuster))[:_MOST_WARNINGS]
    if found := misread_vertical_photos(misfit):
        return found
    if found := rolling_shutters(solved, readjuster):
        return [*found, *_shown_by_itself(solution, solved, given, readjuster)][:_MOST_WARNINGS]
    elsewhere = None if is_good(given) else _with_found_orientations(readjuster, from_own_values)
    if elsewhere is not None and (found := _misgiven(elsewhere, readjuster.block)):
        return _or_mirrored(found, elsewhere, readjuster)
    tried = hypotheses_of_misfit(solution, solved, given, started, readjuster) if readjuster.is_worthwhile else ()
    if found := _best_explanation(tried, given, readjuster) or two_lenses_of_photos(misfit):
        return found
    if elsewhere is not None:
        return _shown_elsewhere(elsewhere, readjuster)
    scattered = scattered_positions(solution) if given.scale < _FITS and readjuster.is_worthwhile else []
    if scattered:
        scattered = all_off_alike(misfit) or scattered
    if found := scattered or _of_precision(misfit) or lens_of_doubted_camera(misfit):
        return found
    return _shown_by_itself(solution, solved, given, readjuster)[:_MOST_WARNINGS]


def _of_precision(misfit: Misfit) -> list[ProjectWarning]:
    """Return that photo points are less precise than is said, after what the block shows if they are."""
    found = precision_too_small(misfit.solved, misfit.readjuster)
    if found is None:
        return []
    others: list[ProjectWarning] = []
    if found.warning.code == IMPRECISE:
        readjuster, fit = replace(misfit.readjuster, block=found.block), fit_of_adjustment(found.solved)
        others = _shown_by_itself(solution_of(found.solved), found.solved, fit, readjuster)
    return [*others[: _MOST_WARNINGS - 1], found.warning]


def _with_found_orientations(readjuster: Readjuster, known: SolvedBlock | None = None) -> SolvedBlock | None:
    """Return an adjustment that fits without the given orientations; None where there is none, or none are given.

    `known` is one that has been made already.
    """
    released = without_orientations(readjuster.block)
    if released is None or not readjuster.is_worthwhile:
        return None
    solved = readjuster.adjust(released) if known is None else known
    return solved if solved is not None and is_good(fit_of_adjustment(solved)) else None


def _misgiven(elsewhere: SolvedBlock, block: Block) -> list[ProjectWarning]:
    """Return what is wrong with given positions or orientations, from where the photos are without them."""
    return misread_stations(block, elsewhere) or misgiven(elsewhere, block)


def _shown_elsewhere(solved: SolvedBlock, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return what is wrong in a block that fits with other orientations than the given ones, where these all differ."""
    found = _shown_by_itself(solution_of(solved), solved, fit_of_adjustment(solved), readjuster)
    if part := _part_elsewhere(readjuster):
        return part
    return found or misgiven_as_a_whole(compared_with_adjusted(solved, readjuster.block))


def _part_elsewhere(readjuster: Readjuster) -> list[ProjectWarning]:
    """Return that positions of a part of the flight are off alike, if all fits without positions."""
    without = readjuster.adjust(without_positions(readjuster.block))
    if without is None or not is_good(fit_of_adjustment(without)):
        return []
    return part_of_flight_elsewhere(solution_of(without), readjuster.block)


def _shown_by_itself(
    solution: Solution, solved: SolvedBlock, given: Fit, readjuster: Readjuster
) -> list[ProjectWarning]:
    """Return what a solution shows without another hypothesis; of single observations only where the others fit."""
    block = readjuster.block
    found = [
        *(mirrored_plane(block, solution) or mirrored_alone(block, solution)),
        *angles_in_another_unit(block, solution),
        *(
            ()
            if any(warning.code == COORDINATE_UNIT for warning in block.warnings)
            else errors_too_large(block, solution)
        ),
        *_or_mirrored(moved_photos(block, solved, given), solved, readjuster),
    ]
    control = contradicting_control(block, solution)
    if control and _fits_without(control, solution, given, readjuster):
        found += control
    heights = list(control_in_another_height_system(block, solution))
    if heights:
        return [*heights, *found]
    if is_good(given):
        found = [
            *pictures_instead_of_positions(contradicting_positions(solution), solved, readjuster),
            *far_from_given(block, solved),
            *found,
            *contradicting_distances(block, solution),
            *misnamed_points(block, solution),
            *points_under_two_numbers(block, solution, solved),
            *contradicting_check_points(block, solution),
        ]
    return found


def _fits_without(control: Sequence[ProjectWarning], solution: Solution, given: Fit, readjuster: Readjuster) -> bool:
    """Tell whether the block fits without the control points of some warnings; large blocks are not tried.

    Residuals of measurements have longer tails than chance: if it is these points that do not fit, it suffices that
    the others do. Where a warning explains the misfit already, wrong photos may have displaced them.
    """
    if not readjuster.is_worthwhile:
        return not readjuster.is_small
    names = [point.name for point in readjuster.block.control_points]
    wrong = [name for name in names if any(name in f"{found.where} {found.text}".split() for found in control)]
    solved = readjuster.adjust_roughly(without_control(readjuster.block, wrong))
    if solved is None or camera_explains_more(solution, solved, readjuster):
        return False
    without, (kind, _, point, _) = fit_of_adjustment(solved), given.columns
    off = kind.where("control".__eq__) & (given.standard > _CONTROL_FITS * given.scale)
    return removes_misfits(without, given) or (set(wrong) <= set(point[off].occurring()) and is_good(without))


def explain_start(solved: SolvedBlock, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return what was probably mistaken in given orientations that led an adjustment astray.

    Parameters
    ----------
    solved : SolvedBlock
        Adjusted from other starting values.
    readjuster : Readjuster
        Of the block with the given orientations.
    """
    found = _or_mirrored(misgiven(solved, readjuster.block), solved, readjuster)
    if not found and compared_with_adjusted(solved, readjuster.block).is_all_elsewhere:
        return _mirrored_as_a_whole(readjuster)
    return found


def _mirrored_as_a_whole(readjuster: Readjuster) -> list[ProjectWarning]:
    """Return that photos or control are mirrored, if the block then fits with all photos where they were given.

    As it is, the block of an object that is nearly a plane fits as well, seen from the other side.
    """
    if not (readjuster.is_oriented and readjuster.is_worthwhile):
        return []
    hypotheses = chain(mirrored_photos(readjuster.block), control_axes(readjuster.block))
    for tried in _adjusted(hypotheses, readjuster):
        if is_good(tried.fit) and tried.rotated < _STAYS:
            return tried.findings(readjuster)
    return []


def _or_mirrored(moved: list[ProjectWarning], solved: SolvedBlock, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return warnings of photos that are not where they were given; of a mirrored one, that it is that.

    In a large block only the first ones are tried: where many have moved, hardly each of them is mirrored.
    """
    tried = max(_MIRRORED_ONE_BY_ONE // max(len(readjuster.block.photo_points.photo), 1), 1)
    return [*(_as_mirror_image(found, solved, readjuster) or found for found in moved[:tried]), *moved[tried:]]


def _as_mirror_image(found: ProjectWarning, solved: SolvedBlock, readjuster: Readjuster) -> ProjectWarning | None:
    """Return that a photo is mirrored, if it fits better so: its given orientation is not to blame then.

    A mirrored photo ends up anywhere, that of a plane object on the other side of it.
    """
    block = readjuster.block
    rows = [row for row, photo in enumerate(block.photos) if found.where == f"photo {photo.name}"]
    if not rows or not readjuster.is_worthwhile:
        return None
    orientation = block.photo_orientation.copy()
    orientation[rows] = np.nan
    for reading in mirror_readings(block, rows[0]):
        tried = readjuster.adjust(replace(reading.block, photo_orientation=orientation))
        if tried is None or not is_good(fit_of_adjustment(tried)):
            continue
        # of a plane it fits as well, and is where it was given
        limit = _AS_WELL if _is_where_given(tried, block, rows[0]) else 1.0
        if tried.variance.sigma0_all < limit * solved.variance.sigma0_all:
            text = mirrored_text(block, rows[0], reading.unturned(tried.state.rotations[rows[0]]))
            return ProjectWarning(reading.kind, found.where, text if reading.kind == MIRRORED else reading.text)
    return None


def _is_where_given(solved: SolvedBlock, block: Block, row: int) -> bool:
    """Tell whether a photo ended on the side of its points on which it was given, near enough for an approximation."""
    compared = compared_with_adjusted(solved, block)
    return bool(compared.shifts[row] < _NEAR_GIVEN)


def explain_failure(
    readjuster: Readjuster, not_oriented: Sequence[str], rest: SolvedBlock | None = None
) -> list[ProjectWarning]:
    """Return what probably keeps a block from being adjusted, or some of its photos; see `hypotheses_of_failure`."""
    if not readjuster.is_worthwhile:
        return []
    elsewhere = _with_found_orientations(readjuster)
    if elsewhere is not None and (found := _misgiven(elsewhere, readjuster.block)):
        return found
    for tried in _adjusted(hypotheses_of_failure(readjuster, not_oriented, rest), readjuster):
        if is_good(tried.fit) and tried.solved.variance.sigma0 > _LEAST_SIGMA0:
            return tried.findings(readjuster)
    return [] if elsewhere is None else _shown_elsewhere(elsewhere, readjuster)


class _Tried(Struct, frozen=True):
    """A hypothesis and its rough adjustment."""

    hypothesis: Hypothesis
    solved: SolvedBlock
    fit: Fit

    @property
    def rotated(self) -> float:
        """Return the mean rotation of the photos from where they started, radians."""
        start = rotation_from_angles(self.solved.block.photo_orientation[:, 3:])
        return float(np.mean(angles_between(start, self.solved.state.rotations)))

    def findings(self, readjuster: Readjuster) -> list[ProjectWarning]:
        """Return the warnings of the hypothesis, with the figures of its complete adjustment."""
        return self.hypothesis.findings(readjuster.adjust(self.hypothesis.block) or self.solved)


def _adjusted(hypotheses: Iterable[Hypothesis], readjuster: Readjuster) -> Iterator[_Tried]:
    """Yield the hypotheses that can be adjusted, with a rough adjustment that agrees with them."""
    for hypothesis in hypotheses:
        solved = readjuster.adjust_roughly(hypothesis.block)
        if solved is not None and hypothesis.holds(solved):
            yield _Tried(hypothesis, solved, fit_of_adjustment(solved))


def _best_explanation(hypotheses: Iterable[Hypothesis], given: Fit, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return the warnings of the hypothesis that explains most; of those that explain as much, of the first."""
    found: list[_Tried] = []
    for tried in _adjusted(hypotheses, readjuster):
        if explains(tried.fit, given) and not _better_start_suffices(tried, readjuster):
            found.append(tried)
            if is_good(tried.fit) and (tried.rotated < _STAYS or not readjuster.is_oriented):
                break
    if not found:
        return []
    scale = min(tried.fit.scale for tried in found)
    least = min(misfit(tried.fit, scale) for tried in found)
    equal = [tried for tried in found if misfit(tried.fit, scale) <= least + _EQUALLY]
    # with the data as they were meant the photos rotate least from where they started
    best = min(equal, key=lambda tried: round(tried.rotated, 1))
    return best.findings(readjuster)


def _better_start_suffices(tried: _Tried, readjuster: Readjuster) -> bool:
    """Tell whether the data as given fit as well if they start where the hypothesis ended."""
    if tried.hypothesis.concerns_start:
        return False
    again = readjuster.adjust_from(tried.solved)
    return again is not None and not explains(tried.fit, fit_of_adjustment(again))
