"""Errors that the whole flight has in common: in the time of the samples, the lever arm, the receiver's velocities.

They are unknowns beside those of the states: one step of the least-squares solution with them, from the solution
without, shows their size, their standard deviations, and how much better the observations fit. Velocities that are late
have been filtered by the receiver, or are means since the epoch before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.stations.inertial.samples import ImuSamples
from orip.stations.inertial.solution import Solved
from orip.structs import replace

_TIME, _LEVER, _DELAY = [0], [1, 2, 3], [4]
_SIGNIFICANT = 4.5
"""Standard deviations: exceeded by chance in one of 100 000 flights."""

_LEAST_SHIFT, _LEAST_LEVER, _LEAST_DELAY = 0.003, 0.03, 0.005
"""Seconds and metres below which nothing is said."""

_LONGEST_DELAY = 1.0


class CommonErrors(Struct, frozen=True):
    """What is significant; None: it is not.

    Parameters
    ----------
    shift : tuple of 2 float, or None
        By which the samples are to be later, and its standard deviation, s.
    lever_arm : tuple of 2 arrays (3,), or None
        What is to be added to the lever arm, and its standard deviations, m.
    delay : tuple of 2 float, or None
        By which the receiver's velocities are late, and its standard deviation, s.
    is_either : bool
        Either of the first two explains it: at an even speed a time is a way.
    """

    shift: tuple[float, float] | None
    lever_arm: tuple[FloatArray, FloatArray] | None
    delay: tuple[float, float] | None = None
    is_either: bool = False


def common_errors(solved: Solved) -> CommonErrors:
    """Return what the observations ask for: time, lever arm, both, or one of them where they cannot be told apart.

    The delay of velocities is an unknown beside each of them.
    """
    equations = _equations(solved)
    both, deviation = _solved(*equations, [*_TIME, *_LEVER, *_DELAY])
    shift, sd = _solved(*equations, [*_TIME, *_DELAY])
    lever, lever_sd = _solved(*equations, [*_LEVER, *_DELAY])
    delay = _delay(solved, both, deviation)
    late = _is_large(both[:1], deviation[:1], _LEAST_SHIFT)
    off = _is_large(both[1:4], deviation[1:4], _LEAST_LEVER)
    if late and off:
        return CommonErrors((float(both[0]), float(deviation[0])), (both[1:4], deviation[1:4]), delay)
    alone = CommonErrors(
        (float(shift[0]), float(sd[0])) if _is_large(shift[:1], sd[:1], _LEAST_SHIFT) else None,
        (lever[:3], lever_sd[:3]) if _is_large(lever[:3], lever_sd[:3], _LEAST_LEVER) else None,
        delay,
    )
    if late:
        return replace(alone, lever_arm=None)
    return replace(alone, shift=None) if off else replace(alone, is_either=None not in {alone.shift, _first(alone)})


def velocity_delay(solved: Solved) -> float:
    """Return by what the receiver's velocities are late, s; 0 where it is not significant."""
    found = _delay(solved, *_solved(*_equations(solved), [*_TIME, *_LEVER, *_DELAY]))
    return 0.0 if found is None else found[0]


def _delay(solved: Solved, value: FloatArray, deviation: FloatArray) -> tuple[float, float] | None:
    whole, sd = solved.graph.delay + value[4:], deviation[4:]
    is_said = _is_large(whole, sd, _LEAST_DELAY) and abs(whole[0]) < _LONGEST_DELAY
    return (float(whole[0]), float(sd[0])) if is_said else None


def _equations(solved: Solved) -> tuple[FloatArray, FloatArray]:
    """Return normal equations of the five unknowns, and their right-hand side."""
    triangle = solved.border(_Border(solved).columns)
    return triangle[:5, :5].T @ triangle[:5, :5], triangle[:5, :5].T @ triangle[:5, 5]


def _first(found: CommonErrors) -> float | None:
    return None if found.lever_arm is None else float(found.lever_arm[0][0])


def _is_large(value: FloatArray, deviation: FloatArray, least: float) -> bool:
    return bool((np.abs(value) > np.maximum(least, _SIGNIFICANT * deviation)).any())


def _solved(normal: FloatArray, side: FloatArray, rows: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return some unknowns without the others, and their standard deviations."""
    covariance = np.linalg.inv(normal[np.ix_(rows, rows)] + 1e-12 * np.eye(len(rows)))
    return covariance @ side[rows], np.sqrt(np.diag(covariance))


class _Border:
    """Partials of the observations of the receiver by time, lever arm and delay of velocities."""

    def __init__(self, solved: Solved) -> None:
        graph, states = solved.graph, solved.trajectory
        fixed = np.flatnonzero(states.fix >= 0)
        imu, rotation = graph.observed.imu, states.rotation[fixed]
        swing = np.cross(imu.mean_rates(states.time[fixed]), graph.observed.lever_arm)
        # an antenna seen by samples that come later is where it was before
        self._moved = -np.einsum("nji,nj->ni", rotation, states.velocity[fixed]) - swing
        self._changed, self._changed_before = (
            -np.einsum("nij,nj->ni", rotation, _at(time, imu)) - np.array([0.0, 0.0, -9.81])
            for time in (states.time[fixed], states.time[fixed] - graph.delay)
        )
        self._groups, self._row = solved.groups, _rows_of(solved.groups)

    def columns(self, number: int, rows: FloatArray, side: FloatArray) -> FloatArray:
        """Return the columns of a factor: time, lever arm, delay of velocities, right-hand side."""
        found = np.zeros((len(rows), 6))
        if self._groups[number] == "position":
            # the position of the unit is along the axes of the body, as the lever arm is
            found[:, 0], found[:, 1:4] = rows[:, 3:6] @ self._moved[self._row[number]], rows[:, 3:6]
        elif self._groups[number] == "velocity":
            row = self._row[number]
            found[:, 0], found[:, 4] = rows @ self._changed[row], rows @ self._changed_before[row]
        found[:, 5] = side
        return found


def _at(times: FloatArray, imu: ImuSamples) -> FloatArray:
    """Return the specific forces (m, 3) at some times."""
    return np.column_stack([np.interp(times, imu.time, column) for column in imu.force.T])


def _rows_of(groups: Sequence[str]) -> list[int]:
    """Return the number of the fix of each factor; a velocity comes after its position."""
    found, row = [], -1
    for group in groups:
        row += group == "position"
        found.append(row)
    return found


def said_of_common_errors(
    found: CommonErrors, shift: float, lever_arm: Sequence[float], *, is_corrected: bool
) -> Iterator[tuple[str, str]]:
    """Yield codes and texts of warnings; `shift` and `lever_arm` are those given, `is_corrected`: for the delay."""
    other = "; or the lever arm is wrong, which cannot be told apart at an even speed" if found.is_either else ""
    if found.shift is not None:
        late, deviation = found.shift
        text = (
            f"the samples fit the positions best {late:+.4f} ± {deviation:.4f} s later: a time offset; "
            f"add --shift {shift + late:.4f}{other}"
        )
        yield "time-offset", text
    if found.lever_arm is not None and not found.is_either:
        value, sds = found.lever_arm
        new = ",".join(f"{given + more:.2f}" for given, more in zip(lever_arm, value, strict=True))
        said = ", ".join(f"{one:.2f}" for one in sds)
        text = f"the positions fit best with --lever-arm={new} (standard deviations {said} m): measure it again"
        yield "lever-arm", text
    if found.delay is not None:
        late, deviation = found.delay
        way = "; they are taken as what they are" if is_corrected else "; without --as-given they are taken as such"
        text = f"the receiver's velocities are those of {late:.3f} ± {deviation:.3f} s before{way}"
        yield "velocity-delay", text
