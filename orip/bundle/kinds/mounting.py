"""Mountings of cameras on rigs: offsets and rotations that are observed."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.kinds.station_attitude import rotation_residuals_with_partials
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.records.block import Block
from orip.records.observation_kinds import MOUNTING
from orip.records.rig import MOUNTING_PARAMETERS, OFFSET

_LENGTHS = len(OFFSET)


class MountingObservations(Observations, frozen=True):
    """n observed parameters; `camera` and `place` (n,) say of which mounted camera and which parameter.

    `observed` (c, 3) are the observed angles, degrees.
    """

    rows: Rows
    camera: IntArray
    place: IntArray
    observed: FloatArray

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (ground unit, degrees) and partials by three unknowns.

        An offset depends on the first of them, its own. Near phi = ±90 degrees the residuals of the three angles are
        small rotations about the axes of the rig.
        """
        count = len(self.place)
        if state.rigs is None or not count:
            return Linearisation(np.zeros(count), np.zeros((count, 3)), np.ones(count, dtype=bool))
        residual, partials = np.zeros(count), np.zeros((count, 3))
        is_length = self.place < _LENGTHS
        length, camera = np.flatnonzero(is_length), self.camera
        residual[length] = state.rigs.offsets[camera[length], self.place[length]] - self.rows.observed[length]
        partials[length, 0] = 1.0
        angle = np.flatnonzero(~is_length)
        turned, rates, _ = rotation_residuals_with_partials(
            state.rigs.mountings[camera[angle]], self.observed[camera[angle]]
        )
        rows, axis = np.arange(len(angle)), self.place[angle] - _LENGTHS
        residual[angle], partials[angle] = turned[rows, axis], rates[rows, axis]
        return Linearisation(residual, partials, np.ones(count, dtype=bool))


def observe_mountings(block: Block, unknowns: Unknowns) -> MountingObservations:
    """Return the parameters of mountings that have an a-priori error."""
    mounted = block.places_on_rigs().mounted
    found = [
        (row, place, error)
        for row, camera in enumerate(mounted)
        for place, error in enumerate(camera.mounting.errors)
        if error is not None
    ]
    camera, place = (np.array([one[k] for one in found], dtype=np.int64) for k in (0, 1))
    none = (np.nan,) * 3
    values = np.array(
        [(*(one.mounting.offset or none), *(one.mounting.rotation or none)) for one in mounted], dtype=np.float64
    ).reshape(-1, len(MOUNTING_PARAMETERS))
    columns = np.full((len(found), 3), CONSTANT)
    if unknowns.rigs is not None and found:
        columns[:, 0] = unknowns.rigs.mountings[camera, place]
        angles = place >= _LENGTHS
        columns[angles] = unknowns.rigs.mountings[camera[angles], _LENGTHS:]
    rows = Rows(
        kind=MOUNTING,
        photo=("",) * len(found),
        point=tuple(mounted[row].name for row in camera.tolist()),
        component=tuple(MOUNTING_PARAMETERS[column] for column in place.tolist()),
        observed=values[camera, place],
        error=np.array([error for _, _, error in found], dtype=np.float64),
        used=np.ones(len(found), dtype=bool),
        columns=columns,
    )
    return MountingObservations(rows, camera, place, values[:, _LENGTHS:])


KINDS = (KindEquations(MOUNTING, observe_mountings),)
