"""The control of a session as the project gives it, and a robust look at it when something does not fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.online.answers import ErrorScale, Suspect
from orip.online.block.online_block import OnlineBlock
from orip.online.sequential.observation_rows import ObservationKey
from orip.online.snooping import Snooping
from orip.prelim.sampling import subsets


@contextmanager
def control_as_given(block: OnlineBlock) -> Iterator[None]:
    """Meanwhile, hold the control that the project holds; afterwards it is observed again, and can be tested.

    Everything is linearised again with it, at the values that there are, before and after. Where nothing is held, and
    within another such block, nothing happens.
    """
    if not block.measurements.softens_control:
        yield
        return
    block.measurements.hold_control(held=True)
    try:
        block.linearise_again()
        yield
    finally:
        block.measurements.hold_control(held=False)
        block.linearise_again()


# Rays alone say where control points are up to a datum that is nearly free. The differences e between their given and
# these coordinates have the cofactors V of both, in which the datum is a large common part. A few control points fix
# it: the others are then expected where V says, e_j - V_jS V_SS^-1 e_S, with V_jj - V_jS V_SS^-1 V_Sj (conditional
# normal distribution; Mardia, Kent and Bibby 1979, *Multivariate analysis*, section 3.2). A block may bend as much as
# its rays allow, which a similarity of the points would take for errors.

_CARRYING = 3
"""Control points that fix a datum."""

_HYPOTHESES = 200
"""Sets of three that are tried: with half of the points wrong, one in eight is right."""

_ROUNDS = 10


class ControlDifferences(NamedTuple):
    """Given minus predicted coordinates of m control points, divided by the a-priori errors of the given ones.

    Attributes
    ----------
    difference : array (k,)
    cofactor : array (k, k)
        Of the prediction alone.
    places : sequence of m arrays of int
        The rows of each control point.
    """

    difference: FloatArray
    cofactor: FloatArray
    places: Sequence[IntArray]


def agreeing_control(found: ControlDifferences, limits: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Return the largest set of control points that agree with each other.

    Parameters
    ----------
    limits : array (m,)
        Largest root of the square sum of a control point that fits; it depends on the number of its coordinates.

    Returns
    -------
    agrees : array (m,) of bool
        All False with fewer than three control points.
    misfit : array (m,)
        Root of the square sum by which each differs from what those that agree predict.
    """
    count = len(found.places)
    if count < _CARRYING:
        return np.zeros(count, dtype=bool), np.zeros(count)
    best, least = np.zeros(count, dtype=bool), np.inf
    for chosen in subsets(count, _CARRYING, _HYPOTHESES):
        carries = np.zeros(count, dtype=bool)
        carries[chosen] = True
        # one that fits badly costs no more than one that just does not fit
        cost = float(np.sum(np.minimum(misfits(found, carries) / limits, 1.0) ** 2))
        if cost < least:
            best, least = carries, cost
    return _settled(found, best, limits)


def _settled(found: ControlDifferences, carries: BoolArray, limits: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Let all that fits carry the datum, and take the worst that does not out, until nothing changes."""
    for _ in range(_ROUNDS):
        misfit = misfits(found, carries)
        grown: BoolArray = carries | (misfit <= limits)
        while grown.sum() > _CARRYING:
            misfit = misfits(found, grown)
            inside = np.where(grown, misfit / limits, 0.0)
            if inside.max() <= 1.0:
                break
            grown[int(np.argmax(inside))] = False
        if (grown == carries).all():
            break
        carries = grown
    return carries, misfits(found, carries)


def misfits(found: ControlDifferences, carries: BoolArray) -> FloatArray:
    """Return how far each control point (m,) is from what those that carry the datum predict of it.

    One that carries it is compared with what the others that do predict.
    """
    covariance = found.cofactor + np.eye(len(found.difference))
    rows = np.concatenate([found.places[place] for place in np.flatnonzero(carries).tolist()])
    inverse = np.linalg.inv(covariance[np.ix_(rows, rows)])
    weighted = inverse @ found.difference[rows]
    across = covariance[:, rows]
    left, spread = found.difference - across @ weighted, covariance - across @ inverse @ across.T
    result, first = np.zeros(len(found.places)), 0
    for place, of_point in enumerate(found.places):
        if carries[place]:
            own = slice(first, first + len(of_point))
            first = own.stop
            square = weighted[own] @ np.linalg.solve(inverse[own, own], weighted[own])
        else:
            square = left[of_point] @ np.linalg.solve(spread[np.ix_(of_point, of_point)], left[of_point])
        result[place] = np.sqrt(max(float(square), 0.0))
    return result


# All control is observed with errors so large that the rays alone decide how the block lies in itself; the rays are
# tested so, and then which control points agree with each other. Values, equations and tests are those of the session:
# nothing is adjusted from the beginning.

_FEWEST = 5
"""Control points from which one that is wrong differs from the majority."""

_RAYS = 2
"""Rays of a control point from which they tell where it is."""

_CLEARLY = 2.0
"""How many times its limit the misfit of a control point exceeds that is wrong beyond doubt: others may fit again once
the datum is right."""

_LATER = 0.1
"""Part by which the measurements have to increase before the control is looked at again: it takes its time."""


class ControlExamination:
    """Looks at the control of a block as often as there is a reason.

    Attributes
    ----------
    examined : int
        Measurements that there were the last time.
    """

    def __init__(self, block: OnlineBlock, snooping: Snooping, scale: ErrorScale) -> None:
        self._block, self._snooping, self._scale = block, snooping, scale
        self.examined = 0

    def examine_if_doubted(self, *, now: bool = False) -> list[Suspect]:
        """Look at the control if something of it does not fit, and there is more to tell than the last time.

        Parameters
        ----------
        now : bool
            A single new measurement is enough more.

        Returns
        -------
        list of Suspect
            Control points that have become suspect.
        """
        control, measured = self._checkable(), len(self._block.measurements)
        if len(control) < _FEWEST or not self._is_doubted(control):
            return []
        if measured < (self.examined + 1 if now else self.examined * (1.0 + _LATER)):
            return []
        self.examined = measured
        before = {key for key in self._snooping.suspects if key.kind == "control"}
        self._examine(control)
        return [one for key, one in self._snooping.suspects.items() if key.kind == "control" and key not in before]

    def _checkable(self) -> list[ObservationKey]:
        """Return the control points that rays of two oriented photos show, whether or not they are suspect."""
        block = self._block
        keys = [ObservationKey("control", "", name) for name in block.measurements.control.points]
        return [
            key
            for key in keys
            if (key in block.equations.included or key in self._snooping.suspects)
            and len(block.rays_with_values(points=[key.point])) >= _RAYS
        ]

    def _is_doubted(self, control: list[ObservationKey]) -> bool:
        names = dict.fromkeys(key.point for key in control)
        return not self._scale.is_believed or any(key.point in names for key in self._snooping.suspects)

    def _examine(self, control: list[ObservationKey]) -> None:
        block, snooping = self._block, self._snooping
        names = dict.fromkeys(key.point for key in control)
        snooping.disagreeing.clear()
        snooping.forgive([key for key in snooping.suspects if key.point in names])
        with block.weak_control():
            block.include(block.rays_with_values(points=names))
            block.settle(names)
            block.lose_unsettled()
            self._scale.estimate_again()
            snooping.snoop([key for key in block.equations.included if key.kind == "photo"])
            block.settle(block.values.points)
        self._judge([key for key in control if key in block.equations.included])
        block.settle(names)
        block.lose_unsettled()
        self._scale.estimate_again()
        snooping.snoop(list(block.equations.included))
        snooping.review()
        self._orient_others()

    def _orient_others(self) -> None:
        """Try the photos again that wait, and may have done so because of wrong control."""
        block = self._block
        waiting = [photo for photo in block.measurements.photos if photo not in block.values.orientations]
        oriented, placed = block.values.advance(block.measurements, waiting, ())
        if oriented:
            new = block.include(block.rays_with_values(oriented, placed))
            block.settle(placed)
            self._snooping.snoop([key for key in new if key in block.equations.included])
            block.lose_unsettled()

    def _judge(self, control: list[ObservationKey]) -> None:
        """Suspect the control points that disagree with the majority, and let the others carry the datum."""
        block, snooping = self._block, self._snooping
        if not control:
            # photos that the rays alone do not determine have been taken out
            block.linearise_again()
            return
        rows = block.rows(block.rays_with_values(points=[key.point for key in control]))
        own = [rows[key] for key in control]
        ends = np.cumsum([0, *(len(one.right) for one in own)])
        places: list[IntArray] = [np.arange(start, end) for start, end in pairwise(ends.tolist())]
        difference, cofactor = block.equations.jointly_predicted(own)
        limits = np.array([self._scale.limit(len(one.right)) for one in own])
        agrees, misfit = agreeing_control(ControlDifferences(difference, cofactor, places), limits)
        if agrees.sum() > len(control) / 2:
            for place in np.flatnonzero(~agrees).tolist():
                key = control[place]
                snooping.suspect(Suspect(key, float(misfit[place]), float(limits[place]), ()))
                if misfit[place] > _CLEARLY * limits[place]:
                    snooping.disagreeing.add(key)
        block.linearise_again()
