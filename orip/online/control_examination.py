"""A robust look at the control when something does not fit: wrong points may carry the datum because they came first.

All control is observed with errors so large that the rays alone decide how the block lies in itself; the rays are
tested so, and then which control points agree with each other. Values, equations and tests are those of the session:
nothing is adjusted from the beginning.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from orip.arrays import IntArray
from orip.online.answers import Suspect
from orip.online.control_consensus import ControlDifferences, agreeing_control
from orip.online.error_scale import ErrorScale
from orip.online.online_block import OnlineBlock
from orip.online.snooping import Snooping
from orip.sequential.observation_rows import ObservationKey

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

    Parameters
    ----------
    block : OnlineBlock
    snooping : Snooping
    scale : ErrorScale

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
