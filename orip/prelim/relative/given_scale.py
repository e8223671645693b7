"""Relative orientation by points whose residuals are of a given scale, where more than half of the points may be wrong.

Wrong points near the epipolar lines fit a bent model better than chance explains. The scale estimated from one pair of
photos follows them; that which is usual in the block does not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.geometry.stereo import TwoPhotos
from orip.prelim.compiled import kernels
from orip.prelim.relative.solution import CHOICE, DANISH, SAMPLING, Pairs, PairSolution, log_of_sets, samples_of
from orip.structs import replace

_SAMPLES = 200
"""Samples of five points: with 60 % of wrong ones a sample is free of them with probability 0.01."""

_ITERATIONS = 8

_SURE = 10.0
"""Logarithm of the factor by which points have to agree better than by chance."""

_RULES = np.array([_SAMPLES, *SAMPLING[1:], *DANISH, _ITERATIONS, *CHOICE[1:4], _SURE, *CHOICE[5:]], dtype=np.float64)
"""The constants as the compiled loop takes them: `RelativeRules` in pair_loops.h, all samples at once."""

_RULES_OF_ADJUSTMENT = np.array([1.0, *_RULES[1:]])
"""The same without samples."""


class PairAtScale(Struct, frozen=True):
    """A relative orientation of n points whose residuals are of a given scale.

    Parameters
    ----------
    photos : TwoPhotos
        The base has the length 1.
    coordinates, deviations : arrays (n, 3)
    usable : array (n,) of bool
    left_by_rotation : float
        As in `PairSolution`.
    """

    photos: TwoPhotos
    coordinates: FloatArray
    deviations: FloatArray
    usable: BoolArray
    scale: float
    left_by_rotation: float

    @property
    def seuw(self) -> float:
        """Return the standard error of unit weight."""
        return self.scale


def at_scale(solution: PairSolution, pairs: Pairs, scale: float) -> PairSolution | None:
    """Return the orientation that most points fit at a scale; None where as many would by chance.

    Standard deviations of angles and base, redundancy numbers and the length of the base stay those of `solution`.

    Parameters
    ----------
    solution : PairSolution
        Found at another scale.
    scale : float
        Standard residual of right points.
    """
    return _at_scale(solution, pairs, scale)


class _Room(NamedTuple):
    """What the compiled loops write of n points; `found` is `RelativeFound` in solution.h."""

    found: FloatArray
    parallax: FloatArray
    weight_factor: FloatArray
    coordinates: FloatArray
    deviations: FloatArray
    in_front: BoolArray
    usable: BoolArray

    @property
    def photos(self) -> TwoPhotos:
        """Return the orientation."""
        return TwoPhotos(self.found[:3], self.found[3:12].reshape(3, 3))


def _room(count: int) -> _Room:
    parallax, weights = np.empty((2, count))
    coordinates, deviations = np.empty((2, count, 3))
    in_front, usable = np.empty((2, count), dtype=np.bool_)
    return _Room(np.zeros(28), parallax, weights, coordinates, deviations, in_front, usable)


def _at_scale(solution: PairSolution, pairs: Pairs, scale: float) -> PairSolution | None:
    count = len(pairs.error)
    room = _room(count)
    if not kernels.orient_at_scale(*pairs, log_of_sets(count), _RULES, *room, samples_of(count)[:_SAMPLES], scale):
        return None
    return replace(
        solution,
        photos=room.photos,
        parallax=room.parallax,
        weight_factor=room.weight_factor,
        coordinates=room.coordinates,
        deviations=room.deviations,
        in_front=room.in_front,
        usable=room.usable,
        scale=scale,
        seuw=scale,
    )


def adjusted_at_scale(start: TwoPhotos, pairs: Pairs, scale: float) -> PairAtScale | None:
    """Return an orientation adjusted to the points that fit it at a scale; None where as many would by chance.

    Parameters
    ----------
    start : TwoPhotos
        Nearly right; the base has the length 1.
    pairs : Pairs
        Five points at least.
    scale : float
        Standard residual of right points.
    """
    return _adjusted(start, pairs, scale)


def _adjusted(start: TwoPhotos, pairs: Pairs, scale: float) -> PairAtScale | None:
    count = len(pairs.error)
    room = _room(count)
    room.found[:3], room.found[3:12] = start.base, start.rotation.ravel()
    if not kernels.adjust_at_scale(*pairs, log_of_sets(count), _RULES_OF_ADJUSTMENT, *room, scale):
        return None
    return PairAtScale(room.photos, room.coordinates, room.deviations, room.usable, scale, float(room.found[27]))
