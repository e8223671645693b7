"""Two adjustments or two results compared: which ended at the better minimum, and figure by figure."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from orip.adjustment.convergence import TerminationReason
from orip.arrays import BoolArray
from orip.bundle.results.misfits import lost_rays
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.records.block import Block
from orip.records.results.result_tests import Figure, FigureGroup, ResultFigures
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN
from orip.wording import agreeing, counted, counted_names

_ABSURD_SIGMA0 = 5.0
"""sigma0 above which a wrong minimum is suspected: a-priori errors are seldom wrong by a larger factor."""

_MANY_DOWN_WEIGHTED = 0.2
"""Part of all photo points above which blunders cannot be the reason."""

_MOST_OF_A_PHOTO = 0.5
"""Part of its photo points that do not fit above which the photo is out of place, not its points."""

_HANDFUL = 10
"""Redundancy below which some observations can mostly be left out so that the others fit."""

_LOWER = 1e-6
"""Relative difference of costs: iterations end when corrections are 1e-4 of the standard deviations, and the cost
follows with their square."""


def doubt_about(solved: SolvedBlock) -> str:
    """Return what is suspicious about the end of an adjustment, to complete "the adjustment ..."; "" if nothing is.

    An adjustment that was started far from its minimum does not converge, or leaves photos undetermined, points behind
    their cameras or far away, residuals of many times the a-priori errors or a photo that fits few of its points.
    """
    if solved.reason in (TerminationReason.MAX_ITERATIONS, TerminationReason.DIVERGED):
        return "did not converge"
    if names := _undetermined_photos(solved):
        return f"left {counted_names('photo', names)} undetermined"
    if behind := _points_behind(solved):
        return f"put {counted_names('point', behind)} behind {agreeing(len(behind), 'its camera', 'their cameras')}"
    sigma0 = solved.variance.sigma0
    if not np.isfinite(sigma0) and solved.variance.redundancy > 0:
        return "left no observation with full weight that another one checks"
    if sigma0 > _ABSURD_SIGMA0:
        return f"ended at sigma0 {sigma0:.4g}"
    used, reduced = _down_weighted_points(solved)
    if reduced.sum() > _MANY_DOWN_WEIGHTED * used.sum():
        return f"down-weighted {reduced.sum()} of the {counted(int(used.sum()), 'photo point')}"
    if names := _lost_points(solved, used, reduced):
        return f"left {counted_names('point', names)} undetermined, of which no ray fits"
    if names := _photos_out_of_place(solved, used, reduced):
        return f"down-weighted most points of {counted_names('photo', names)}"
    return ""


def is_better(other: SolvedBlock, given: SolvedBlock) -> bool:
    """Tell whether another adjustment of the same observations ended at a better minimum.

    One that has converged and determines all photos is better than one that has not, else the lower robust cost is:
    unless it is so only because observations have lost weight that a handful of others check.
    """
    rank, other_rank = _soundness(given), _soundness(other)
    if other_rank != rank:
        return other_rank > rank
    reduced, other_reduced = (int(np.count_nonzero(_down_weighted_points(solved)[1])) for solved in (given, other))
    if other_reduced > reduced and other.variance.redundancy < _HANDFUL:
        return False
    # without down-weighting, too, an observation that is lost must cost more than one that fits
    weighing = replace(
        given.weighing,
        start=given.weighing.start or 1,
        scale=_scale_of_errors(given, other),
        of_tracks=given.weighing.of_tracks or other.weighing.of_tracks,
    )
    return weighing.cost(other.equations) < (1.0 - _LOWER) * weighing.cost(given.equations)


def _scale_of_errors(*ends: SolvedBlock) -> float:
    """Return how many times too small the a-priori errors are: where residuals are larger, all cost nearly the same.

    An observation that is left out would then be as cheap as one that fits like all others.
    """
    known = [end.variance.sigma0 for end in ends if np.isfinite(end.variance.sigma0)]
    return max(1.0, min(known, default=1.0))


def _soundness(solved: SolvedBlock) -> tuple[bool, int]:
    return solved.converged, -len(_undetermined_photos(solved))


def _undetermined_photos(solved: SolvedBlock) -> list[str]:
    columns = solved.problem.unknowns.photos
    removed = solved.normals.removed[columns] & (columns != CONSTANT)
    return _names(solved.block, np.flatnonzero(removed.any(axis=1)).tolist())


def _points_behind(solved: SolvedBlock) -> list[str]:
    """Return the points that lie behind the camera of a photo that shows them."""
    state = solved.state
    points = solved.block.photo_points.of(np.flatnonzero(lost_rays(solved)))
    offset = state.points[points.point] - state.centres[points.photo]
    depth = np.einsum("ni,ni->n", offset, state.rotations[points.photo, :, 2])
    rows = np.unique(points.point[(depth >= 0.0) & points.in_use])
    return [solved.block.point_names[row] for row in rows.tolist()]


def _down_weighted_points(solved: SolvedBlock) -> tuple[BoolArray, BoolArray]:
    """Return which photo points (n,) are used, and which of them are down-weighted."""
    points = solved.block.photo_points
    used: BoolArray = points.in_use
    # photo points are the first kind of observation
    factors = solved.weight_factors[: 2 * len(points.photo)].reshape(-1, 2)
    return used, np.asarray(used & (factors < 1.0).any(axis=1))


def _lost_points(solved: SolvedBlock, used: BoolArray, reduced: BoolArray) -> list[str]:
    """Return the points that nothing determines since all of their rays, several, have lost weight."""
    point, count = solved.block.photo_points.point, len(solved.block.point_names)
    number, wrong = np.bincount(point[used], minlength=count), np.bincount(point[reduced], minlength=count)
    columns = solved.problem.unknowns.points
    undetermined = (solved.normals.removed[columns] & (columns != CONSTANT)).any(axis=1)
    return [solved.block.point_names[row] for row in np.flatnonzero(undetermined & (number > 1) & (wrong == number))]


def _photos_out_of_place(solved: SolvedBlock, used: BoolArray, reduced: BoolArray) -> list[str]:
    """Return the photos most of whose points are down-weighted."""
    photo, count = solved.block.photo_points.photo, len(solved.block.photos)
    number, wrong = np.bincount(photo[used], minlength=count), np.bincount(photo[reduced], minlength=count)
    return _names(solved.block, np.flatnonzero(wrong > _MOST_OF_A_PHOTO * number).tolist())


def _names(block: Block, rows: list[int]) -> list[str]:
    return [block.photos[row].name for row in rows]


_FULL_CIRCLE = 360.0


class Tolerance(Struct, frozen=True):
    """How far two figures may be apart and still be equal.

    Parameters
    ----------
    absolute : float
        In each figure's own unit; of a distortion coefficient, mm of distortion 10 mm from the principal point.
    relative : float
        Of a ground coordinate it is a share of the extent of the block, of an angle one of a radian, of C, DX and DY
        one of C, of any other figure one of its value, or its standard deviation if that is larger: none depends on
        where the origin of a system lies.
    sigma : float or None
        If given, adjusted values may differ by so many standard deviations (of both, combined) instead, and figures of
        precision and reliability are not compared.
    """

    absolute: float = 1e-9
    relative: float = 1e-6
    sigma: float | None = None


class Difference(Struct, frozen=True):
    """Two figures that are not equal.

    Parameters
    ----------
    name : str
    a, b : float, str or None
        Their values in the two results.
    size : float
        The difference without sign; infinite where one of them is not a number.
    allowed : float
    """

    name: str
    a: float | str | None
    b: float | str | None
    size: float
    allowed: float

    @property
    def excess(self) -> float:
        """Return how many times the allowed difference it is."""
        return self.size / self.allowed if self.allowed > 0.0 else math.inf


class Comparison(Struct, frozen=True):
    """What two results have in common and what not.

    Parameters
    ----------
    compared : int
        Figures that both have.
    differences : tuple of Difference
        Largest first, measured by what is allowed.
    only_a, only_b : tuple of str
        Names of figures, or of records with figures, that are in one result only.
    """

    compared: int
    differences: tuple[Difference, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]

    @property
    def equal(self) -> bool:
        """Tell whether there is no difference."""
        return not (self.differences or self.only_a or self.only_b)


class _Scales(Struct, frozen=True):
    """Lengths that relative tolerances are shares of."""

    extent: float
    principal_distance: float


def compare_figures(a: ResultFigures, b: ResultFigures, tolerance: Tolerance) -> Comparison:
    """Compare two results; angles are compared on the circle."""
    extent = max(_extent(a), _extent(b))
    compared, differences = 0, []
    only_a = [group.name for key, group in a.items() if key not in b and _counts(group, tolerance)]
    only_b = [group.name for key, group in b.items() if key not in a and _counts(group, tolerance)]
    for key in a.keys() & b.keys():
        one, other = a[key], b[key]
        only_a += _missing(one, other)
        only_b += _missing(other, one)
        scales = _Scales(extent, max(_principal_distance(one), _principal_distance(other)))
        for name in one.figures.keys() & other.figures.keys():
            pair = one.figures[name], other.figures[name]
            if tolerance.sigma is not None and not all(figure.adjusted for figure in pair):
                continue
            compared += 1
            found = _difference(f"{one.name} {name}".strip(), *pair, tolerance, scales)
            if found is not None:
                differences.append(found)
    differences.sort(key=lambda difference: (-difference.excess, difference.name))
    return Comparison(compared, tuple(differences), tuple(sorted(only_a)), tuple(sorted(only_b)))


def _counts(group: FigureGroup, tolerance: Tolerance) -> bool:
    return tolerance.sigma is None or any(figure.adjusted for figure in group.figures.values())


def _missing(one: FigureGroup, other: FigureGroup) -> Iterator[str]:
    return (f"{one.name} {name}".strip() for name in one.figures if name not in other.figures and not _is_sd(name))


def _is_sd(name: str) -> bool:
    """Tell whether a figure is the standard deviation of another one that is already missing."""
    return name.endswith(" sd")


def _difference(name: str, a: Figure, b: Figure, tolerance: Tolerance, scales: _Scales) -> Difference | None:
    allowed = _allowed(a, b, tolerance, scales)
    if isinstance(a.value, float) and isinstance(b.value, float):
        size = abs(a.value - b.value)
        if a.quantity == "angle":
            size = abs(math.remainder(a.value - b.value, _FULL_CIRCLE))
        return Difference(name, a.value, b.value, size, allowed) if size > allowed else None
    return None if a.value == b.value else Difference(name, a.value, b.value, math.inf, allowed)


def _allowed(a: Figure, b: Figure, tolerance: Tolerance, scales: _Scales) -> float:
    if tolerance.sigma is not None and (a.sd is not None or b.sd is not None):
        return tolerance.sigma * math.hypot(a.sd or 0.0, b.sd or 0.0)
    if a.quantity == "ground":
        scale = scales.extent
    elif a.quantity == "angle":
        scale = DEGREES_PER_RADIAN
    elif a.quantity == "photo":
        scale = scales.principal_distance
    else:
        scale = max(
            abs(number) for figure in (a, b) for number in (figure.value, figure.sd, 0.0) if isinstance(number, float)
        )
    return tolerance.absolute / a.effect + tolerance.relative * scale


def _principal_distance(group: FigureGroup) -> float:
    value = group.figures["C"].value if "C" in group.figures else None
    return abs(value) if isinstance(value, float) else 0.0


def _extent(figures: ResultFigures) -> float:
    """Return the largest range of a ground coordinate, over points and projection centres."""
    by_axis: dict[str, list[float]] = {}
    for (kind, _name), group in figures.items():
        if kind in {"photo", "point"}:
            for name, figure in group.figures.items():
                if figure.quantity == "ground" and isinstance(figure.value, float):
                    by_axis.setdefault(name[0], []).append(figure.value)
    return max((max(values) - min(values) for values in by_axis.values()), default=0.0)
