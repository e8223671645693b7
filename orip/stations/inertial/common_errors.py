"""Errors that the whole flight has in common: by which time the samples are late, and by what the lever arm is wrong.

Both are unknowns beside those of the states: one step of the least-squares solution with them, from the solution
without, shows their size, their standard deviations, and how much better the observations fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.stations.inertial.solution import Solved
from orip.structs import replace

_TIME, _LEVER = [0], [1, 2, 3]
_SIGNIFICANT = 4.5
"""Standard deviations: exceeded by chance in one of 100 000 flights."""

_LEAST_SHIFT, _LEAST_LEVER = 0.003, 0.03
"""Seconds and metres below which nothing is said."""


class CommonErrors(Struct, frozen=True):
    """What is significant; None: it is not.

    Parameters
    ----------
    shift : tuple of 2 float, or None
        By which the samples are to be later, and its standard deviation, s.
    lever_arm : tuple of 2 arrays (3,), or None
        What is to be added to the lever arm, and its standard deviations, m.
    is_either : bool
        Either of the two explains it: at an even speed a time is a way.
    """

    shift: tuple[float, float] | None
    lever_arm: tuple[FloatArray, FloatArray] | None
    is_either: bool = False


def common_errors(solved: Solved) -> CommonErrors:
    """Return what the observations ask for: time, lever arm, both, or one of them where they cannot be told apart."""
    triangle = solved.border(_Border(solved).columns)
    normal, side = triangle[:4, :4].T @ triangle[:4, :4], triangle[:4, :4].T @ triangle[:4, 4]
    both, deviation = _solved(normal, side, [*_TIME, *_LEVER])
    shift, sd = _solved(normal, side, _TIME)
    lever, lever_sd = _solved(normal, side, _LEVER)
    late = _is_large(both[:1], deviation[:1], _LEAST_SHIFT)
    off = _is_large(both[1:], deviation[1:], _LEAST_LEVER)
    if late and off:
        return CommonErrors((float(both[0]), float(deviation[0])), (both[1:], deviation[1:]))
    alone = CommonErrors(
        (float(shift[0]), float(sd[0])) if _is_large(shift, sd, _LEAST_SHIFT) else None,
        (lever, lever_sd) if _is_large(lever, lever_sd, _LEAST_LEVER) else None,
    )
    if late:
        return replace(alone, lever_arm=None)
    return replace(alone, shift=None) if off else replace(alone, is_either=None not in {alone.shift, _first(alone)})


def _first(found: CommonErrors) -> float | None:
    return None if found.lever_arm is None else float(found.lever_arm[0][0])


def _is_large(value: FloatArray, deviation: FloatArray, least: float) -> bool:
    return bool((np.abs(value) > np.maximum(least, _SIGNIFICANT * deviation)).any())


def _solved(normal: FloatArray, side: FloatArray, rows: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return some unknowns without the others, and their standard deviations."""
    covariance = np.linalg.inv(normal[np.ix_(rows, rows)] + 1e-12 * np.eye(len(rows)))
    return covariance @ side[rows], np.sqrt(np.diag(covariance))


class _Border:
    """Partials of the observations of the receiver by time and lever arm."""

    def __init__(self, solved: Solved) -> None:
        graph, states = solved.graph, solved.trajectory
        fixed = np.flatnonzero(states.fix >= 0)
        imu, rotation = graph.observed.imu, states.rotation[fixed]
        swing = np.cross(imu.mean_rates(states.time[fixed]), graph.observed.lever_arm)
        # an antenna seen by samples that come later is where it was before
        self._moved = -np.einsum("nji,nj->ni", rotation, states.velocity[fixed]) - swing
        force = np.column_stack([np.interp(states.time[fixed], imu.time, column) for column in imu.force.T])
        self._changed = -np.einsum("nij,nj->ni", rotation, force) - np.array([0.0, 0.0, -9.81])
        self._groups, self._row = solved.groups, _rows_of(solved.groups)

    def columns(self, number: int, rows: FloatArray, side: FloatArray) -> FloatArray:
        """Return the columns of a factor: time, lever arm, right-hand side."""
        found = np.zeros((len(rows), 5))
        if self._groups[number] == "position":
            # the position of the unit is along the axes of the body, as the lever arm is
            found[:, 0], found[:, 1:4] = rows[:, 3:6] @ self._moved[self._row[number]], rows[:, 3:6]
        elif self._groups[number] == "velocity":
            found[:, 0] = rows @ self._changed[self._row[number]]
        found[:, 4] = side
        return found


def _rows_of(groups: Sequence[str]) -> list[int]:
    """Return the number of the fix of each factor; a velocity comes after its position."""
    found, row = [], -1
    for group in groups:
        row += group == "position"
        found.append(row)
    return found


def said_of_common_errors(found: CommonErrors, shift: float, lever_arm: Sequence[float]) -> Iterator[tuple[str, str]]:
    """Yield codes and texts of warnings; `shift` and `lever_arm` are those given."""
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
