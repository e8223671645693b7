"""Where observations help most: greedy choice and exchange among candidates, on the covariance matrix alone.

An observation a x = l of variance s² takes Q to Q - Q aᵀ (a Q aᵀ + s²)⁻¹ a Q, and one that is taken away the other way
round (the update of the Kalman filter). No candidate needs another factorisation. Greedy choice and exchange are those
of optimal designs (Fedorov 1972, Mitchell 1974).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray

Criterion = Literal["largest", "mean", "camera"]
"""The largest standard deviation of a target, the root of the mean variance, or that of the last target alone."""

_BETTER = 1e-9
"""Relative fall of the criterion below which an exchange is none."""

_MOST_SWEEPS = 20

_MOST_NUMBERS = 250_000
"""Covariances of candidates and targets that are looked at together: they stay in the cache."""

_MOST_STARTS, _WORK = 12, 2_000_000
"""Random starts at most, and the product of unknowns, candidates and choices that they may take all together."""


class Candidate(Struct, frozen=True):
    """An observation, or several together, that could be made.

    Parameters
    ----------
    columns : array (k,) of int
        Places of its unknowns in the covariance matrix.
    rows : array (r, k)
        Its partials by them.
    variance : array (r,)
    """

    name: str
    columns: IntArray
    rows: FloatArray
    variance: FloatArray


class Placement(Struct, frozen=True):
    """What was chosen.

    Parameters
    ----------
    chosen : tuple of int
        Places of the candidates.
    value : float
        Of the criterion with all of them.
    curve : tuple of float
        The criterion without any, and with the best first 1, 2, ... of the greedy choice: what each is worth.
    """

    chosen: tuple[int, ...]
    value: float
    curve: tuple[float, ...]


class _Alike(NamedTuple):
    """Candidates of one shape: places (c,), columns (c, k), rows (c, r, k) and variance (c, r)."""

    places: IntArray
    columns: IntArray
    rows: FloatArray
    variance: FloatArray


def place(
    covariance: FloatArray, candidates: Sequence[Candidate], targets: IntArray, count: int, criterion: Criterion
) -> Placement:
    """Choose the candidates that bring a criterion down most.

    The choice is greedy, then improved by exchanges until none is left that helps; so are places that are least known
    one after the other, and random ones where that takes little time. The best of these ends is taken.

    Parameters
    ----------
    covariance : array (n, n)
        Of targets and of the candidates' unknowns, positive definite.
    targets : array (t,) of int
        Unknowns that are judged; with the criterion "camera" the last one alone.
    count : int
        Not more than there are candidates.
    criterion : {"largest", "mean", "camera"}
    """
    judged = _judged(targets, criterion)
    greedy = place_greedily(covariance, candidates, targets, count, criterion)
    starts = [greedy.chosen, _spread(covariance, candidates, count), *_random(len(covariance), len(candidates), count)]
    ends = [_exchanged(covariance, candidates, judged, criterion, start) for start in starts]
    chosen, value = min(ends, key=lambda end: end[1])
    return Placement(tuple(sorted(chosen)), value, greedy.curve)


def place_greedily(
    covariance: FloatArray, candidates: Sequence[Candidate], targets: IntArray, count: int, criterion: Criterion
) -> Placement:
    """Choose one candidate after the other, each the best with those before it; see `place`."""
    judged = _judged(targets, criterion)
    chosen: list[int] = []
    matrix, alike = covariance, _alike(candidates, len(judged))
    curve = [_value(matrix.diagonal()[judged], criterion)]
    for _ in range(count):
        best, _ = _best(matrix, alike, judged, criterion, chosen)
        matrix = _with(matrix, candidates[best])
        chosen.append(best)
        curve.append(_value(matrix.diagonal()[judged], criterion))
    return Placement(tuple(chosen), curve[-1], tuple(curve))


def _judged(targets: IntArray, criterion: Criterion) -> IntArray:
    return targets[-1:] if criterion == "camera" else targets


def with_all(covariance: FloatArray, candidates: Sequence[Candidate]) -> FloatArray:
    """Return the covariance matrix with all of some candidates observed."""
    for candidate in candidates:
        covariance = _with(covariance, candidate)
    return covariance


def _exchanged(
    covariance: FloatArray,
    candidates: Sequence[Candidate],
    judged: IntArray,
    criterion: Criterion,
    start: Sequence[int],
) -> tuple[list[int], float]:
    """Return where exchanges of one for another end, and the criterion there."""
    chosen = list(start)
    alike, before = _alike(candidates, len(judged)), np.inf
    for _ in range(_MOST_SWEEPS):
        # added up anew, as taking away loses digits
        all_in = with_all(covariance, [candidates[one] for one in chosen])
        value = _value(all_in.diagonal()[judged], criterion)
        if value >= before * (1.0 - _BETTER):
            break
        before = value
        for position, one in enumerate(chosen):
            without = _with(all_in, candidates[one], taken_away=True)
            others = [other for other in chosen if other != one]
            best, found = _best(without, alike, judged, criterion, others)
            if found < value * (1.0 - _BETTER):
                chosen[position], value = best, found
                all_in = _with(without, candidates[best])
    return chosen, value


def _alike(candidates: Sequence[Candidate], targets: int) -> list[_Alike]:
    """Return the candidates in lots of the same shape, as many together as can be looked at with all targets."""
    by_shape: dict[tuple[int, ...], list[int]] = {}
    for number, candidate in enumerate(candidates):
        by_shape.setdefault(candidate.rows.shape, []).append(number)
    lots = []
    for (_, unknowns), places in by_shape.items():
        most = max(_MOST_NUMBERS // (targets * unknowns), 1)
        for part in (places[first : first + most] for first in range(0, len(places), most)):
            some = [candidates[number] for number in part]
            lots.append(
                _Alike(
                    np.array(part),
                    np.array([one.columns for one in some]),
                    np.array([one.rows for one in some]),
                    np.array([one.variance for one in some]),
                )
            )
    return lots


def _best(
    matrix: FloatArray,
    alike: Sequence[_Alike],
    judged: IntArray,
    criterion: Criterion,
    taken: Sequence[int],
) -> tuple[int, float]:
    """Return the candidate with which the criterion is least, and the criterion with it."""
    of_judged = matrix[judged]
    best, least = -1, np.inf
    for lot in alike:
        values = _values_with(lot, matrix, of_judged, matrix.diagonal()[judged], criterion)
        values[np.isin(lot.places, taken)] = np.inf
        lowest = int(np.argmin(values))
        if best < 0 or values[lowest] < least:
            best, least = int(lot.places[lowest]), float(values[lowest])
    return best, least


def _values_with(
    lot: _Alike,
    matrix: FloatArray,
    of_judged: FloatArray,
    variances: FloatArray,
    criterion: Criterion,
) -> FloatArray:
    """Return the criterion (c,) with each candidate of a lot; `variances` (t,) are those without it."""
    candidates, unknowns = lot.columns.shape
    near = of_judged[:, lot.columns.ravel()].reshape(-1, candidates, unknowns)
    own = matrix[lot.columns[:, :, None], lot.columns[:, None, :]]
    gain = np.matmul(np.swapaxes(near, 0, 1), np.swapaxes(lot.rows, 1, 2))
    noise = lot.variance[:, :, None] * np.eye(lot.variance.shape[1])
    middle = np.linalg.inv(lot.rows @ own @ np.swapaxes(lot.rows, 1, 2) + noise)
    fall = np.sum((gain @ middle) * gain, axis=2)
    kept = np.maximum(variances - fall, 0.0)
    return np.asarray(np.sqrt(kept.mean(axis=1) if criterion == "mean" else kept.max(axis=1)))


def _with(matrix: FloatArray, candidate: Candidate, *, taken_away: bool = False) -> FloatArray:
    columns, rows = candidate.columns, candidate.rows
    gain = matrix[:, columns] @ rows.T
    noise = np.diag(candidate.variance)
    own = rows @ gain[columns]
    return np.asarray(matrix - gain @ np.linalg.inv(own - noise if taken_away else own + noise) @ gain.T)


def _value(variances: FloatArray, criterion: Criterion) -> float:
    kept = np.maximum(variances, 0.0)
    return float(np.sqrt(kept.mean() if criterion == "mean" else kept.max()))


def _spread(covariance: FloatArray, candidates: Sequence[Candidate], count: int) -> list[int]:
    """Return candidates each of which is the least known one, all before it observed."""
    found: list[int] = []
    matrix = covariance
    for _ in range(count):
        own = np.array([_own_variance(matrix, candidate) for candidate in candidates])
        own[found] = -1.0
        found.append(int(np.argmax(own)))
        matrix = _with(matrix, candidates[found[-1]])
    return found


def _random(unknowns: int, candidates: int, count: int) -> list[list[int]]:
    """Return random choices, the same in each run: more of small problems, none of large ones."""
    random = np.random.default_rng(0)
    number = min(_MOST_STARTS, int(_WORK // (unknowns * candidates * count)))
    return [random.choice(candidates, count, replace=False).tolist() for _ in range(number)]


def _own_variance(matrix: FloatArray, candidate: Candidate) -> float:
    own = candidate.rows @ matrix[np.ix_(candidate.columns, candidate.columns)] @ candidate.rows.T
    return float(np.max(own.diagonal() / candidate.variance))
