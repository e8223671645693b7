"""Motions of photos of rolling shutters as weighted unknowns: what is corrected of them is observed as zero."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.antennas import NONE
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.known_motions import motion_errors
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.records.block import Block
from orip.records.camera import READOUT
from orip.records.definition import MOTION_PARAMETERS
from orip.records.observation_kinds import MOTION
from orip.units import DEGREES_PER_RADIAN

_SHORTEST = 1e-5
"""Seconds: in less nothing moves."""

_UNIT = np.repeat([1.0, DEGREES_PER_RADIAN], 3)


class MotionObservations(Observations, frozen=True):
    """n corrections observed as zero; `photo` and `parameter` (n,) say which. Those of angular rates are degrees.

    Unknown is what a correction makes during the readout. The correction itself depends on the readout where a station
    has observed the motion: as if it did not, errors of motions would make the readout too short (errors in variables).
    The errors of the bundle say how far motions are from what neighbours show, and that is so whatever the readout is.

    Parameters
    ----------
    camera : array (n,) of int
        Whose readout a correction depends on; `NONE`: it is as in the iteration before.
    """

    rows: Rows
    photo: IntArray
    parameter: IntArray
    camera: IntArray

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return the corrections and their partials by what they make during the readout, and by the readout."""
        depends = self.camera != NONE
        readout = np.where(depends, state.cameras[self.camera, READOUT], state.readouts[self.photo])
        unit: FloatArray = _UNIT[self.parameter] / np.maximum(np.abs(readout), _SHORTEST)
        residual = unit * state.motion_corrections[self.photo, self.parameter]
        by_readout = np.zeros_like(residual)
        depends &= np.abs(readout) > _SHORTEST
        by_readout[depends] = -residual[depends] / readout[depends]
        return Linearisation(residual, np.column_stack([unit, by_readout]), np.ones(len(residual), dtype=bool))


def observe_motions(block: Block, unknowns: Unknowns) -> MotionObservations:
    """Return the unknown motions of all photos."""
    photo, parameter = np.nonzero(unknowns.motions != CONSTANT)
    errors = motion_errors(block)
    camera = np.where(errors.are_observed[photo, parameter], block.photo_camera[photo], NONE)
    of_readout = np.where(camera == NONE, CONSTANT, unknowns.cameras[camera, READOUT])
    rows = Rows(
        kind=MOTION,
        photo=tuple(block.photos[row].name for row in photo),
        point=("",) * len(photo),
        component=tuple(MOTION_PARAMETERS[place] for place in parameter),
        observed=np.zeros(len(photo)),
        error=errors.values[photo, parameter],
        used=np.ones(len(photo), dtype=bool),
        columns=np.column_stack([unknowns.motions[photo, parameter], of_readout]),
    )
    return MotionObservations(rows, photo, parameter, camera)


KINDS = (KindEquations(MOTION, observe_motions),)
