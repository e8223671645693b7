"""Motions of photos of rolling shutters as weighted unknowns: what is corrected of them is observed as zero."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.records.block import Block
from orip.records.definition import MOTION_PARAMETERS
from orip.records.observation_kinds import MOTION
from orip.units import DEGREES_PER_RADIAN

_SHORTEST = 1e-5
"""Seconds: in less nothing moves."""

_UNIT = np.repeat([1.0, DEGREES_PER_RADIAN], 3)


class MotionObservations(Observations, frozen=True):
    """n corrections observed as zero; `photo` and `parameter` (n,) say which. Those of angular rates are degrees."""

    rows: Rows
    photo: IntArray
    parameter: IntArray

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return the corrections and their partials by themselves."""
        unit: FloatArray = _UNIT[self.parameter] / np.maximum(np.abs(state.readouts[self.photo]), _SHORTEST)
        residual = unit * state.motion_corrections[self.photo, self.parameter]
        return Linearisation(residual, unit[:, None], np.ones(len(residual), dtype=bool))


def observe_motions(block: Block, unknowns: Unknowns) -> MotionObservations:
    """Return the unknown motions of all photos, with the errors of the bundle."""
    photo, parameter = np.nonzero(unknowns.motions != CONSTANT)
    definition = block.definition
    errors = np.repeat([definition.velocity_error or 1.0, definition.rate_error or 1.0], 3)
    rows = Rows(
        kind=MOTION,
        photo=tuple(block.photos[row].name for row in photo),
        point=("",) * len(photo),
        component=tuple(MOTION_PARAMETERS[place] for place in parameter),
        observed=np.zeros(len(photo)),
        error=errors[parameter],
        used=np.ones(len(photo), dtype=bool),
        columns=unknowns.motions[photo, parameter][:, None],
    )
    return MotionObservations(rows, photo, parameter)


KINDS = (KindEquations(MOTION, observe_motions),)
