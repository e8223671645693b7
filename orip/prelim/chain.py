"""The chain: decides how preliminary values are found, finds them, and says what it did for each photo.

Routes are tried in the order of their prospects. The first that orients all photos without one that its points
contradict is taken, or what two routes agree on, otherwise the best of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.geometry.rotation import rotation_from_angles
from orip.prelim.block_grower import BlockGrower
from orip.prelim.confirmed_block import (
    block_without_contradicted_rays,
    confirmed_block,
    confirmed_by_parts,
    has_many_misses,
)
from orip.prelim.found_values import fits_by_chance, found_values, is_strong, redundancy, robust_square_sum
from orip.prelim.growing_block import GrowingBlock, misplaced_photos
from orip.prelim.joint_routes import by_level_photos, by_parts, by_photos
from orip.prelim.measured_block import MORE, MeasuredBlock, measured_block
from orip.prelim.parts import supported_photos
from orip.prelim.rays import ImageRays
from orip.prelim.routes import (
    LEAST_RESECTION,
    SAFE_RESECTION,
    Route,
    by_control,
    by_given,
    by_models,
    by_pairs,
    control_points_seen,
)
from orip.prelim.to_ground import Outcome, lengths_of_residuals, outcome_of
from orip.prelim.unknown_cameras import POINTS_NEEDED, by_unknown_cameras
from orip.records.block import Block
from orip.records.preliminary import PreliminaryValues, SimilarityStep

_STARTING_PAIRS = 5
"""Number of first pairs that are tried, one after the other."""

_MANY_PHOTOS = 12
"""Photos up to which a wrong one is often in the first pair."""

_GOOD = 2.5
"""Mean standard residual below which no further route is tried."""

_AS_GOOD = 1.03
"""Ratio of misfits: two routes that end alike are right, though the camera may not be calibrated."""

_BETTER = 0.999
"""Ratio of misfits below which a later route is better than an earlier one, not the same up to rounding."""

_FAR_OFF = 15.0
"""Residual over the a-priori error above which larger ones count the same."""

_LEAST_COORDINATES = 7
"""Ground coordinates that an absolute orientation needs."""

_RAYS_OF_TIES, _TIES_FOR_RESECTION, _WEAK_PART = 3, 8, 0.1
"""A photo is resected well from eight points of two others; a block hangs together weakly if more photos have fewer."""

_MANY_UNFIT, _UNFIT_PART = 3, 0.1
"""Control points, and part of them, that an absolute orientation down-weights where the block may be bent instead."""


def preliminary_values(block: Block) -> PreliminaryValues:
    """Find preliminary orientations of all photos, and coordinates of all points, from nothing but measurements.

    Parameters
    ----------
    block : Block
        As gathered. Orientations in it that are not NaN are used only where control does not suffice, preliminary
        coordinates of points for the datum of a free network.

    Returns
    -------
    PreliminaryValues
        In the frame of the block.
    """
    return _values(_search_by_confirmed_rays(measured_block(block)))


def preliminary_values_from_all_rays(block: Block) -> PreliminaryValues:
    """Find the same without comparing rays: for a block that differs from one whose rays were compared in little.

    Where there are many photos, one starting pair has to suffice: of a block that is right it does.
    """
    measured = measured_block(block)
    pairs = _STARTING_PAIRS if len(measured.rays.photos) <= _MANY_PHOTOS else 1
    return _values(_search_by_level_photos(measured) or _ended(_searches(measured, _routes(measured, pairs))))


def preliminary_values_soon(block: Block) -> PreliminaryValues:
    """Find the same by the routes alone that take little time: for somebody who measures more if they do not suffice.

    Rays are not compared, and photos are not placed all together.
    """
    measured = measured_block(block)
    free, with_control = measured.grower(), measured.grower(measured.full_control())
    return _values(_ended(_searches(measured, _short_routes(measured, free, with_control))))


class _Search(NamedTuple):
    """The best outcome of the routes tried, and whether it is enough.

    Attributes
    ----------
    lengths : array (n,)
        Its `lengths_of_residuals`; none without an outcome.
    tried : int
        Number of routes.
    """

    measured: MeasuredBlock
    best: Outcome | None
    lengths: FloatArray
    by_models: Route | None
    is_enough: bool
    tried: int
    is_weakly_joined: bool = False


class _End(NamedTuple):
    """How a complete outcome fits: the photos that are in the wrong place, its misfit, and whether that is convincing.

    Few redundant observations may nearly fit a wrong block, too: they have to fit as well as measuring errors explain.
    So may a block that is bent where few points tie its parts, while the control of one part does not fit.
    """

    misplaced: frozenset[int]
    misfit: float
    is_convincing: bool


def _values(found: _Search) -> PreliminaryValues:
    at_once = found.is_enough and found.tried == 1 and not found.is_weakly_joined
    return found_values(found.measured, found.best, found.lengths, found.by_models, name_weak_connections=not at_once)


def _search_by_confirmed_rays(measured: MeasuredBlock) -> _Search:
    """Try routes; if the first is not good enough and others contradict many rays, begin again without these.

    Where many rays of a few pairs miss each other, that is looked at before the first route that grows.
    """
    if (together := _search_by_level_photos(measured)) is not None:
        return together
    searches = _searches(measured, _routes(measured))
    if not has_many_misses(measured):
        first = next(searches)
        if first.is_enough:
            return first
    confirmed = confirmed_block(measured)
    if confirmed is None:
        return _search_without_contradicted(_ended(searches))
    return _search_by_parts(confirmed_by_parts(confirmed))


def _search_without_contradicted(found: _Search) -> _Search:
    """Where no route is enough, try them without the few rays that others contradict; none may be misplaced then."""
    doubtful = None if found.is_enough else block_without_contradicted_rays(found.measured)
    if doubtful is None:
        return found
    again = _ended(_searches(doubtful, _routes(doubtful)))
    return again if again.is_enough and not _has_misplaced_photos(again) else found


def _has_misplaced_photos(found: _Search) -> bool:
    if found.best is None:
        return False
    return bool(misplaced_photos(found.measured.rays, found.best.grown, found.lengths, found.measured.blunders).any())


def _search_by_parts(told: MeasuredBlock) -> _Search:
    """Try routes with the rays that parts have told, which have grown already; if these do not suffice, with new parts.

    Where photos are left even so, what was told of their rays may have been wrong: all of these count again.
    """
    first = next(_searches(told, _routes(told)))
    if first.is_enough:
        return first
    renewed = told.with_rays(told.confirmed, MORE)
    found = _ended(_searches(renewed, _routes(renewed)))
    if (left := _rays_of_photos_left(found)).any():
        whole = told.with_rays(told.confirmed | left, MORE)
        again = _ended(_searches(whole, _routes(whole)))
        return found if _rays_of_photos_left(again).any() else again
    return found


def _rays_of_photos_left(found: _Search) -> BoolArray:
    """Return which of all rays (n,) are of photos that are not oriented."""
    photo = found.measured.all_rays.photo
    return np.ones(len(photo), dtype=bool) if found.best is None else ~found.best.grown.oriented[photo]


def _search_by_level_photos(measured: MeasuredBlock) -> _Search | None:
    """Place the photos of a weakly joined block together; None where another block is, or where they do not fit."""
    if not _hangs_together_weakly(measured):
        return None
    route = by_level_photos(measured.grower(measured.full_control()), measured.known_control())
    found = _ended(_searches(measured, iter([[route]])))
    return found._replace(is_weakly_joined=True) if found.is_enough else None


def _ended(searches: Iterator[_Search]) -> _Search:
    """Return the last of the states of a search."""
    *_, last = searches
    return last


def _searches(measured: MeasuredBlock, routes: Iterator[Sequence[Route]]) -> Iterator[_Search]:
    """Try routes until nothing better is to be expected; yield what has been found after each."""
    best: Outcome | None = None
    of_best: FloatArray = np.empty(0)
    beaten = (False, -np.inf)
    ends: list[_End] = []
    by_the_models: Route | None = None
    tried = 0
    for rivals in routes:
        for route in rivals:
            if tried == 0 and measured.block.definition.models:
                by_the_models = route
            tried += 1
            outcome = outcome_of(measured, route)
            if outcome is not None:
                lengths = lengths_of_residuals(measured, outcome)
                misfit = _misfit(measured.rays, outcome.grown, lengths)
                if (outcome.is_final, -misfit) > beaten:
                    best, of_best, beaten = outcome, lengths, (outcome.is_final, -_BETTER * misfit)
                if _is_complete(measured, outcome):
                    ends.append(_end(measured, outcome, lengths, misfit))
        is_enough = _is_enough(ends)
        yield _Search(measured, best, of_best, by_the_models, is_enough, tried)
        if is_enough:
            return


def _routes(measured: MeasuredBlock, pairs: int = _STARTING_PAIRS) -> Iterator[Sequence[Route]]:
    """Yield routes, those together that begin with assumptions of which one is wrong: either may seem to fit.

    Where the first pair of photos has led to a part of the block only, other pairs lead to the same parts: these are
    placed together first.
    """
    free, with_control = measured.grower(), measured.grower(measured.full_control())
    together = _may_be_placed_together(measured)
    yield from _first_routes(measured, free, with_control)
    start = by_pairs(free, 0)
    falls_apart = together and not any(system.oriented.all() for system in start.systems)
    parts = by_parts(free, with_control, measured.known_control(), start)
    if falls_apart:
        yield list(parts)
    yield from _other_pairs(free, pairs)
    if together:
        if not falls_apart:
            yield list(parts)
        yield [by_photos(with_control, measured.known_control())]
    given: BoolArray = np.asarray(np.isfinite(measured.block.photo_orientation).all(axis=1))
    if given.any():
        orientation = np.where(given[:, None], measured.block.photo_orientation, np.nan)
        rotations = np.full((len(given), 3, 3), np.nan)
        rotations[given] = rotation_from_angles(orientation[given, 3:])
        yield [by_given(free, rotations, orientation[:, :3])]


def _may_be_placed_together(measured: MeasuredBlock) -> bool:
    return not measured.is_free and measured.known_coordinates >= _LEAST_COORDINATES


def _hangs_together_weakly(measured: MeasuredBlock) -> bool:
    """Tell whether many photos see few points of two others, from which they could be resected: growing takes long."""
    rays = measured.rays
    if not _may_be_placed_together(measured) or measured.block.definition.models:
        return False
    shown = np.bincount(rays.point, minlength=len(rays.points)) >= _RAYS_OF_TIES
    ties = np.bincount(rays.photo[shown[rays.point]], minlength=len(rays.photos))
    return bool(np.mean(ties < _TIES_FOR_RESECTION) > _WEAK_PART)


def _short_routes(measured: MeasuredBlock, free: BlockGrower, with_control: BlockGrower) -> Iterator[Sequence[Route]]:
    """Yield blocks that grow from models, control or pairs of photos."""
    yield from _first_routes(measured, free, with_control)
    yield from _other_pairs(free)


def _first_routes(measured: MeasuredBlock, free: BlockGrower, with_control: BlockGrower) -> Iterator[Sequence[Route]]:
    """Yield blocks that grow from models, control or the best pair of photos."""
    seen = control_points_seen(with_control)
    seeing = seen >= SAFE_RESECTION
    models = measured.block.definition.models
    if models:
        yield [by_models(free, models)]
    elif seeing.mean() > 0.5:
        yield [by_control(with_control)]
    if len(measured.rays.cameras.unknown) and (seen >= POINTS_NEEDED).any():
        yield [by_unknown_cameras(with_control)]
    yield [by_pairs(free, 0)]
    # where no photo sees control enough to tell a wrong point, a few points check the pair as another pair would
    wanted = seeing if seeing.any() else seen >= LEAST_RESECTION
    if wanted.any() and (models or seeing.mean() <= 0.5):
        yield [by_control(with_control)]


def _other_pairs(free: BlockGrower, pairs: int = _STARTING_PAIRS) -> Iterator[Sequence[Route]]:
    for choice in range(1, pairs):
        yield [by_pairs(free, choice)]


def _misfit(rays: ImageRays, grown: GrowingBlock, lengths: FloatArray) -> float:
    """Return the mean residual over the a-priori error, where large residuals and missing photos count `_FAR_OFF`."""
    counted = np.where(grown.oriented[rays.photo], lengths, np.inf)
    judged = counted[~np.isnan(counted)]
    return float(np.minimum(judged, _FAR_OFF).mean()) if len(judged) else _FAR_OFF


def _end(measured: MeasuredBlock, outcome: Outcome, lengths: FloatArray, misfit: float) -> _End:
    misplaced = np.flatnonzero(misplaced_photos(measured.rays, outcome.grown, lengths, measured.blunders))
    held: BoolArray = np.asarray(np.isfinite(measured.full_control()).all(axis=1))
    degrees = redundancy(measured.rays, held, ~np.isnan(lengths))
    fits = is_strong(degrees, len(measured.rays.photos)) or fits_by_chance(robust_square_sum(lengths), degrees)
    return _End(frozenset(misplaced.tolist()), misfit, fits and _control_fits(outcome.absolute))


def _control_fits(absolute: SimilarityStep | None) -> bool:
    """Tell whether an absolute orientation down-weights no more control points than may be wrong by themselves.

    Measuring errors that add up bend a long block, too, but by little: `s0` tells.
    """
    if absolute is None or absolute.s0 < _GOOD:
        return True
    unfit = np.count_nonzero((absolute.weight_factor < 1.0).any(axis=1))
    return bool(unfit < max(_MANY_UNFIT, _UNFIT_PART * len(absolute.points)))


def _is_complete(measured: MeasuredBlock, outcome: Outcome) -> bool:
    """Tell whether all photos that can be are oriented, and on the ground if there is control enough for that."""
    control_suffices = measured.known_coordinates >= _LEAST_COORDINATES
    supported = supported_photos(measured.rays, measured.known_control())
    return (outcome.is_final or not control_suffices) and bool(outcome.grown.oriented[supported].all())


def _is_enough(ends: list[_End]) -> bool:
    """Tell from complete outcomes whether nothing better is to be expected.

    That is so if one fits convincingly, or if two routes have ended alike: without misplaced photos, or with the same
    ones in a block whose other photos fit convincingly.
    """
    if not ends:
        return False
    best = min(ends, key=lambda end: (len(end.misplaced), end.misfit))
    alike = sum(end.misplaced == best.misplaced and end.misfit < _AS_GOOD * best.misfit for end in ends)
    fits = best.misfit < _GOOD and best.is_convincing
    return (fits and not best.misplaced) or (alike > 1 and (fits or not best.misplaced))
