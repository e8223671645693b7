"""What a hypothesis is: a block with one mistake corrected, adjusted again, and compared with the block as given."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, parts
from orip.errors import NotSolvableError, ProjectWarning
from orip.geometry.rotation import angles_from_rotation
from orip.mistakes.mistake import mistake_of
from orip.records.block import Block
from orip.records.coded_names import CodedNames, joined, repeated
from orip.structs import replace

if TYPE_CHECKING:  # `orip measure` looks for signs of mistakes, and adjusts nothing
    from orip.bundle.solve import SolvedBlock
    from orip.records.results.solution import Solution

# One adjustment is of the data as given, the other of the data as they may have been meant. Each observation fits one
# of the two, both or neither; those that fit only one decide, by the sign test (McNemar, 1947). It assumes nothing
# about the size or the distribution of residuals that are far too large.

DECIDED = 10.0
"""Difference of costs (half square sums) at which one of two readings is certain: a ratio of likelihoods of 22 000."""

_FITS = 3.0
"""Standard errors within which an observation fits, by the better of the two adjustments."""

_SIGN_TEST = 3.7
"""Quantile of the normal distribution for an error probability of 1e-4, as some ten hypotheses are tried."""

_FAR_OFF, _FEW = 10.0, 4
"""An observation that is off by ten times the limit fits by chance with a probability of at most a tenth, four of them
with 1e-4."""

_EXPLAINED = 0.3
"""The other adjustment may have at most this part of the misfits."""

_SEVERAL, _ALMOST_ALL = 4, 0.1
"""Part of the misfits that another adjustment may keep and still explain the block if it fits otherwise."""

_GOOD_SCALE, _BLUNDERS = 1.5, 0.05
"""Largest standard error of unit weight, and part of the observations that may be blunders, where a block fits."""

_LARGEST_SIGMA0 = 2.0
"""sigma0 above which the observations that were not left out do not fit: where few check each other, leaving out a
handful makes most residuals small."""

_OF_A_GROUP = 0.15
"""Largest part of the coordinates of a photo, or of the control, that may be blunders."""

_WRONG_MATCHES = 0.5
"""Largest part of the coordinates of a photo that may be wrong matches: a photo that fits less is out of place."""


class Fit(Struct, frozen=True):
    """How the observations of an adjustment fit.

    Parameters
    ----------
    columns : four CodedNames of length n
        Kind, photo, point and component of the observations.
    standard : array (n,)
        Standard residuals; infinite for what could not be computed, such as a point behind its photo.
    scale : float
        Standard error of unit weight, from the median of the standard residuals; at least 1.
    sigma0 : float
        Of the observations with full weight; NaN without redundancy.
    """

    columns: tuple[CodedNames, CodedNames, CodedNames, CodedNames]
    standard: FloatArray
    scale: float
    sigma0: float

    @property
    def observations(self) -> tuple[tuple[str, str, str, str], ...]:
        """Return the names of the observations."""
        # not stored: in a large block the names take more memory than all figures
        return tuple(zip(*self.columns, strict=True))

    def of(self, observations: tuple[tuple[str, str, str, str], ...]) -> FloatArray:
        """Return the standard residuals of some observations; infinite for those that are not in this fit."""
        if observations == self.observations:
            return self.standard
        place = dict(zip(self.observations, self.standard.tolist(), strict=True))
        return np.array([place.get(name, np.inf) for name in observations])


def fit_of_adjustment(solved: SolvedBlock) -> Fit:
    """Return how the observations fit an adjustment; disregarded ones, such as check points, are not among them."""
    from orip.adjustment.weights import MEDIAN_OF_NORMAL

    rows = [observations.rows for observations in solved.problem.observations]
    equations = solved.equations
    standard = np.abs(equations.residual)
    standard[~(equations.active & np.isfinite(standard))] = np.inf
    used = np.concatenate([observations.used for observations in rows])
    standard = standard if used.all() else standard[used]
    scale = max(1.0, float(np.median(standard)) / MEDIAN_OF_NORMAL)
    columns = (
        joined(repeated(observations.kind.name, len(observations.photo)) for observations in rows),
        joined(observations.photo for observations in rows),
        joined(observations.point for observations in rows),
        joined(observations.component for observations in rows),
    )
    if not used.all():
        kind, photo, point, component = (names[used] for names in columns)
        columns = kind, photo, point, component
    return Fit(columns, standard, scale, solved.variance.sigma0)


def explains(other: Fit, given: Fit) -> bool:
    """Tell whether another adjustment explains what the given one does not.

    A few observations suffice if they are far off: a block that is bent to fit wrong control fits in most coordinates.
    """
    limit = _FITS * min(other.scale, given.scale)
    before = given.of(other.observations)
    counted = ~(np.isinf(before) & np.isinf(other.standard))
    before, after = before[counted], other.standard[counted]
    wrong_before, wrong_after = np.count_nonzero(before > limit), np.count_nonzero(after > limit)
    if wrong_after > _EXPLAINED * wrong_before:
        return False
    if wrong_before >= _SEVERAL and wrong_after <= _ALMOST_ALL * wrong_before and is_good(other):
        return True
    gained, lost = after <= limit, before <= limit
    gained, lost = gained & ~lost, lost & ~gained
    few = np.count_nonzero(gained & (before > _FAR_OFF * limit))
    if few >= _FEW and not (lost & (after > 2.0 * limit)).any():
        return True
    count, lost_count = np.count_nonzero(gained), np.count_nonzero(lost)
    return bool(count - lost_count >= _SIGN_TEST * np.sqrt(count + lost_count) and count > 0)


def removes_misfits(other: Fit, given: Fit) -> bool:
    """Tell whether an adjustment without some observations leaves hardly any of those that fit badly before."""
    limit = _FITS * min(other.scale, given.scale)
    before, after = (int(np.count_nonzero(fit.standard > limit)) for fit in (given, other))
    return after <= max(_FEW, _EXPLAINED * before)


def is_good(fit: Fit) -> bool:
    """Tell whether the observations, except a few blunders, fit within their a-priori errors.

    No photo and no kind of observation is wrong as a whole: a block can be bent to fit photos, and wrong control less.
    """
    if fit.sigma0 > _LARGEST_SIGMA0:
        return False
    return fit.scale < _GOOD_SCALE and misfit(fit, 1.0) < _BLUNDERS and not _has_wrong_group(fit, 1.0, _OF_A_GROUP)


def fits_without_wrong_matches(fit: Fit) -> bool:
    """Return whether the only misfits are photo points scattered over the photos, as wrong matches are.

    No photo is wrong as a whole then, and no other kind of observation.
    """
    return not _has_wrong_group(fit, fit.scale, _WRONG_MATCHES)


def _has_wrong_group(fit: Fit, scale: float, of_a_photo: float) -> bool:
    """Tell whether more than a part of the observations of a photo, or of another kind, do not fit.

    `scale` is their standard error of unit weight.
    """
    kind, photo, _, _ = fit.columns
    # by photo, and what is of no photo by its kind
    is_photo = np.array([*map(bool, photo.distinct), *(False for _ in kind.distinct)])
    count, wrong = np.zeros((2, len(is_photo)), dtype=np.int64)
    for part in parts(len(fit.standard)):
        of_photo = photo.codes[part].astype(np.int64)
        place = np.where(is_photo[of_photo], of_photo, len(photo.distinct) + kind.codes[part].astype(np.int64))
        count += np.bincount(place, minlength=len(count))
        wrong += np.bincount(place[fit.standard[part] > _FITS * scale], minlength=len(count))
    return bool((wrong > np.maximum(np.where(is_photo, of_a_photo, _OF_A_GROUP) * count, _FEW)).any())


def misfit(fit: Fit, scale: float) -> float:
    """Return the part of the observations that does not fit, when their standard error of unit weight is `scale`."""
    return float(np.mean(fit.standard > _FITS * scale))


_ITERATIONS_OF_A_TRIAL = 20
"""A block that is right with one thing changed needs no more; those that are still wrong go on and on."""

_MOST_PHOTO_POINTS = 20_000
"""Most photo points: in larger blocks further adjustments would take longer than a user wants to wait."""


class Readjuster(Struct, frozen=True):
    """Adjusts a block again.

    Parameters
    ----------
    block : Block
        As measured and given.
    start : callable
        Gives such a block its starting values.
    """

    block: Block
    start: Callable[[Block], Block]

    @property
    def is_oriented(self) -> bool:
        """Return whether the orientations of all photos were given."""
        return bool(np.isfinite(self.block.photo_orientation).all())

    @property
    def is_small(self) -> bool:
        """Return whether the block is not too large to be adjusted again."""
        return len(self.block.photo_points.photo) <= _MOST_PHOTO_POINTS

    @property
    def is_worthwhile(self) -> bool:
        """Return whether to adjust again: the block is not too large, and no warning explains its misfit already."""
        return self.is_small and not self.explaining

    @property
    def explaining(self) -> set[str]:
        """Return the codes of the warnings that already explain a misfit."""
        return {warning.code for warning in self.block.warnings if mistake_of(warning.code).explains_misfit}

    def adjust(self, block: Block) -> SolvedBlock | None:
        """Return the adjustment of a block, None where there is none.

        Parameters
        ----------
        block : Block
            As `Readjuster.block`, with something changed.
        """
        return self._adjusted(block, block.definition.enp_stop)

    def adjust_roughly(self, block: Block) -> SolvedBlock | None:
        """Return the adjustment of a block, as soon as it shows what fits; None where there is none."""
        return self._adjusted(block, _rough_enp())

    def _adjusted(self, block: Block, enp_stop: float) -> SolvedBlock | None:
        try:
            return _solved(self.start(block), enp_stop)
        except (NotSolvableError, np.linalg.LinAlgError, ValueError):
            # a block changed for a trial may be impossible to adjust; the adjustment as given stands nevertheless
            return None

    def adjust_from(self, solved: SolvedBlock) -> SolvedBlock | None:
        """Return the rough adjustment of `block` that starts where another one ended, None where there is none."""
        state, place = solved.state, solved.block.point_index()
        orientation = np.hstack([state.centres, angles_from_rotation(state.rotations)])
        try:
            started = self.start(replace(self.block, photo_orientation=orientation))
            ended = state.points[[place[name] for name in started.point_names]]
            points = np.where(started.constant_points, started.point_start, ended)
            return _solved(replace(started, point_start=points), _rough_enp())
        except (NotSolvableError, np.linalg.LinAlgError):
            return None


class Misfit(NamedTuple):
    """An adjustment that may show a mistake.

    Attributes
    ----------
    solution : Solution
    solved : SolvedBlock
        The adjustment that it comes from.
    readjuster : Readjuster
        Of the block as gathered.
    """

    solution: Solution
    solved: SolvedBlock
    readjuster: Readjuster


def _rough_enp() -> float:
    from orip.adjustment.weights import SETTLED_ENP

    return SETTLED_ENP


def _solved(block: Block, enp_stop: float) -> SolvedBlock:
    from orip.bundle.solve import iteration_settings, solve_block

    # whether a mistake explains the misfit is seen long before the last observation has the right weight
    settings = iteration_settings(block.definition)
    most = min(settings.max_iterations, _ITERATIONS_OF_A_TRIAL)
    settings = replace(settings, enp_stop=min(enp_stop, settings.enp_stop), max_iterations=most, most_attempts=0)
    return solve_block(block, lambda _: None, lambda: False, settings)


_NEAR = 0.5
"""Part of the distance to their points by which most photos may move and still count as being where they were given."""


def _always(_: SolvedBlock) -> bool:
    return True


Findings = Callable[["SolvedBlock"], list[ProjectWarning]]


class Hypothesis(Struct, frozen=True):
    """A block as it would be without one mistake.

    Parameters
    ----------
    block : Block
    findings : callable
        From the adjustment of that block: what is probably wrong and what to do; empty if there is nothing to report.
    holds : callable
        From the same: whether the adjustment agrees with the hypothesis. Whether it fits is not tested here; see
        `orip.mistakes.hypothesis`.
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
