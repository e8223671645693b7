"""Solutions of RTKLIB, forward and backward in time: joined, compared, what of them cannot be trusted; satellites.

The two directions use the same observations: where the ambiguities of an epoch are fixed to the same integers, both
give the same position, and joining them as if they were independent would claim a precision that is not there. So an
epoch is taken from the better direction as it is, and positions that differ show that a set of integers is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.records.epochs import SECONDS_PER_WEEK

FIXED, FLOAT = 1, 2
"""RTKLIB's numbers of qualities; those above are of code measurements."""

_FIELDS = 15
_Q_FIELD = 5
_CONTRADICTION = 3.0
"""Standard deviations of a position by which the two directions may differ."""

_ROUNDING = 2e-4
"""Metres: positions are given to 0.1 mm."""

_WEAK = 4.0
"""Times the median standard deviation from which an epoch is called weak."""


class Solution(Struct, frozen=True):
    """n epochs of a solution.

    Parameters
    ----------
    header : tuple of str
    lines : tuple of n str
        As RTKLIB wrote them.
    time : array (n,)
        Seconds since 1980-01-06, GPS time.
    place : array (n, 3)
        Geocentric, m.
    covariance : array (n, 3, 3)
        m².
    quality : array (n,) of int
        1 fixed, 2 float, others from code.
    satellites : array (n,) of int
    ratio : array (n,)
        Of the second best to the best set of ambiguities.
    """

    header: tuple[str, ...]
    lines: tuple[str, ...]
    time: FloatArray
    place: FloatArray
    covariance: FloatArray
    quality: IntArray
    satellites: IntArray
    ratio: FloatArray

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self.time)

    @property
    def is_fixed(self) -> BoolArray:
        """Return where ambiguities are fixed, array (n,)."""
        return np.equal(self.quality, FIXED)

    @property
    def deviations(self) -> FloatArray:
        """Return standard deviations of the geocentric coordinates, array (n, 3)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def take(self, rows: Sequence[int] | IntArray) -> Solution:
        """Return some epochs."""
        at = np.asarray(rows, dtype=np.int64)
        return Solution(
            self.header, tuple(self.lines[row] for row in at), self.time[at], self.place[at], self.covariance[at],
            self.quality[at], self.satellites[at], self.ratio[at],
        )  # fmt: skip


def parse_solution(text: str) -> Solution:
    """Return the epochs of what RTKLIB wrote with geocentric coordinates and GPS weeks."""
    lines = text.splitlines()
    rows, kept = [], []
    for line in lines:
        words = line.split()
        if line.startswith("%") or len(words) != _FIELDS:
            continue
        values = [float(word) for word in words]
        if all(map(math.isfinite, values)):
            rows.append(values)
            kept.append(line)
    table = np.array(rows).reshape(len(rows), _FIELDS)
    return Solution(
        tuple(line for line in lines if line.startswith("%")),
        tuple(kept),
        table[:, 0] * SECONDS_PER_WEEK + table[:, 1],
        table[:, 2:5],
        _covariances(table[:, 7:13]),
        table[:, _Q_FIELD].astype(np.int64),
        table[:, 6].astype(np.int64),
        table[:, 14],
    )


def _covariances(columns: FloatArray) -> FloatArray:
    """Return covariances (n, 3, 3) of sdx sdy sdz sdxy sdyz sdzx, the latter roots of sizes with signs (n, 6)."""
    squares = np.sign(columns) * np.square(columns)
    order = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])
    covariance: FloatArray = squares[:, order]
    return covariance


class Joined(Struct, frozen=True):
    """A solution of both directions.

    Parameters
    ----------
    solution : Solution
        n epochs, each of the better direction; one whose directions contradict each other is float.
    difference : array (n, 3)
        Forward less backward, m; NaN where one of them has no fixed position.
    doubt : tuple of n str
        Why an epoch is not to be trusted; empty: it is.
    """

    solution: Solution
    difference: FloatArray
    doubt: tuple[str, ...]


def join_directions(forward: Solution, backward: Solution) -> Joined:
    """Return the epochs of both directions in the order of time."""
    row_forward = {time: row for row, time in enumerate(forward.time.tolist())}
    row_backward = {time: row for row, time in enumerate(backward.time.tolist())}
    times = sorted(row_forward.keys() | row_backward.keys())
    parts, difference, contradicts = [], np.full((len(times), 3), np.nan), np.zeros(len(times), dtype=np.bool_)
    for at, time in enumerate(times):
        one, other = row_forward.get(time), row_backward.get(time)
        parts.append(_better(forward, one, backward, other))
        if one is not None and other is not None and forward.is_fixed[one] and backward.is_fixed[other]:
            difference[at] = forward.place[one] - backward.place[other]
            limit = _CONTRADICTION * np.minimum(forward.deviations[one], backward.deviations[other]) + _ROUNDING
            contradicts[at] = bool((np.abs(difference[at]) > limit).any())
    return _judged(_stacked(forward, parts), difference, contradicts)


def forward_alone(forward: Solution) -> Joined:
    """Return a solution of a receiver that stands: each epoch has the observations of all before it."""
    doubt = tuple(_unfixed(int(quality)) for quality in forward.quality)
    return Joined(forward, np.full((len(forward), 3), np.nan), doubt)


def _unfixed(quality: int) -> str:
    if quality == FIXED:
        return ""
    return "ambiguities are not fixed" if quality == FLOAT else "from code measurements alone"


def _better(forward: Solution, one: int | None, backward: Solution, other: int | None) -> tuple[Solution, int]:
    if one is None:
        assert other is not None
        return backward, other
    if other is None:
        return forward, one
    sizes = (np.trace(forward.covariance[one]), np.trace(backward.covariance[other]))
    is_forward = (forward.quality[one], sizes[0]) <= (backward.quality[other], sizes[1])
    return (forward, one) if is_forward else (backward, other)


def _stacked(forward: Solution, parts: Sequence[tuple[Solution, int]]) -> Solution:
    return Solution(
        forward.header,
        tuple(part.lines[row] for part, row in parts),
        np.array([part.time[row] for part, row in parts]),
        np.array([part.place[row] for part, row in parts]).reshape(len(parts), 3),
        np.array([part.covariance[row] for part, row in parts]).reshape(len(parts), 3, 3),
        np.array([part.quality[row] for part, row in parts], dtype=np.int64),
        np.array([part.satellites[row] for part, row in parts], dtype=np.int64),
        np.array([part.ratio[row] for part, row in parts]),
    )


def _judged(solution: Solution, difference: FloatArray, contradicts: BoolArray) -> Joined:
    quality = np.where(contradicts & solution.is_fixed, FLOAT, solution.quality)
    lines = tuple(
        line if before == after else _with_quality(line, int(after))
        for line, before, after in zip(solution.lines, solution.quality, quality, strict=True)
    )
    size = np.sqrt(np.trace(solution.covariance, axis1=1, axis2=2))
    usual = float(np.median(size[quality == FIXED])) if (quality == FIXED).any() else math.inf
    doubt = []
    for row in range(len(solution)):
        if contradicts[row]:
            why = "forward and backward contradict each other: ambiguities are fixed to wrong integers"
        elif quality[row] == FIXED and size[row] > _WEAK * usual:
            why = f"weak geometry, {solution.satellites[row]} satellites"
        else:
            why = _unfixed(int(quality[row]))
        doubt.append(why)
    judged = Solution(
        solution.header, lines, solution.time, solution.place, solution.covariance, quality, solution.satellites,
        solution.ratio,
    )  # fmt: skip
    return Joined(judged, difference, tuple(doubt))


def _with_quality(line: str, quality: int) -> str:
    """Return a line with another quality, in the columns that it has."""
    words = line.split()
    start = 0
    for word in words[:_Q_FIELD]:
        start = line.index(word, start) + len(word)
    at = line.index(words[_Q_FIELD], start)
    return f"{line[:at]}{quality}{line[at + len(words[_Q_FIELD]) :]}"


class Stretch(Struct, frozen=True):
    """Successive epochs that are not to be trusted for one reason; times in seconds since 1980-01-06."""

    begin: float
    end: float
    epochs: int
    why: str


def doubted_stretches(joined: Joined) -> tuple[Stretch, ...]:
    """Return when a solution is not to be trusted, in the order of time."""
    return tuple(_stretches(joined))


def _stretches(joined: Joined) -> Iterator[Stretch]:
    time, doubt = joined.solution.time, joined.doubt
    begin = 0
    for row in range(1, len(doubt) + 1):
        if row == len(doubt) or doubt[row] != doubt[begin]:
            if doubt[begin]:
                yield Stretch(float(time[begin]), float(time[row - 1]), row - begin, doubt[begin])
            begin = row


_FIELDS_OF_STATUS = 17
"""$SAT, week, seconds, satellite, frequency, azimuth, elevation, residuals of code and phase, valid, SNR, fix ..."""

_SATELLITE, _FREQUENCY, _PHASE, _VALID, _SLIPS = 3, 4, 8, 9, 15
_WORSE, _LEAST = 5.0, 0.02
"""Times the median of all satellites, and metres, from which one is named."""


class SatelliteUse(Struct, frozen=True):
    """A satellite: epochs in which it was used, residuals of its phases (RMS, m), cycle slips of all frequencies."""

    name: str
    epochs: int
    residual: float
    slips: int


def satellites_used(text: str) -> tuple[SatelliteUse, ...]:
    """Return the satellites of a file of status, by name; lines that are none of theirs are left out."""
    phases: dict[str, list[float]] = {}
    epochs: dict[str, int] = {}
    slips: dict[tuple[str, str], int] = {}
    for line in text.splitlines():
        fields = line.split(",")
        if fields[0] != "$SAT" or len(fields) < _FIELDS_OF_STATUS:
            continue
        name, frequency = fields[_SATELLITE], fields[_FREQUENCY]
        slips[name, frequency] = max(slips.get((name, frequency), 0), int(fields[_SLIPS]))
        if fields[_VALID] == "1":
            phases.setdefault(name, []).append(float(fields[_PHASE]))
            epochs[name] = epochs.get(name, 0) + (frequency == "1")
    return tuple(
        SatelliteUse(
            name, epochs[name], float(np.sqrt(np.mean(np.square(values)))),
            sum(count for (other, _), count in slips.items() if other == name),
        )
        for name, values in sorted(phases.items())
    )  # fmt: skip


def unlike_the_others(satellites: tuple[SatelliteUse, ...]) -> tuple[SatelliteUse, ...]:
    """Return satellites whose phases fit far worse than the median of all."""
    if len(satellites) < 5:
        return ()
    middle = float(np.median([one.residual for one in satellites]))
    return tuple(one for one in satellites if one.residual > max(_WORSE * middle, _LEAST))
