"""The state with which the adjustment of a block starts."""

from __future__ import annotations

import numpy as np

from orip.bundle.antennas import station_places
from orip.bundle.figures import placed_figures
from orip.bundle.known_motions import motions_of_rolling_shutters
from orip.bundle.rigs.starting import starting_rigs
from orip.bundle.state import BlockState, antenna_parameters, camera_parameters, moving
from orip.bundle.unknowns import set_names
from orip.geometry.rotation import rotation_from_angles
from orip.records.block import Block


def starting_state(block: Block) -> BlockState:
    """Return the state that the block's preliminary values give."""
    places = station_places(block)
    state = BlockState(
        cameras=camera_parameters(block),
        additional=np.zeros((len(block.cameras), max(len(set_names(camera)) for camera in block.cameras))),
        antennas=antenna_parameters(block),
        shifts=np.zeros((len(places.shifts), 3)),
        drifts=np.zeros((len(places.drifts), 3)),
        centres=block.photo_orientation[:, :3].copy(),
        rotations=rotation_from_angles(block.photo_orientation[:, 3:]),
        motions=np.zeros((len(block.photos), 6)),
        motion_corrections=np.zeros((len(block.photos), 6)),
        readouts=np.zeros(len(block.photos)),
        points=block.point_start.copy(),
        theodolites=np.array([theodolite.zero_direction for theodolite in block.theodolites], dtype=np.float64),
        figures=placed_figures(block),
        left_out=np.zeros(len(block.point_names), dtype=bool),
        turned_by_angles=np.array(
            [any(kind in photo.constant for kind in ("OMEGA", "PHI", "KAPPA")) for photo in block.photos], dtype=bool
        ),
    )
    return moving(state.with_rigs(starting_rigs(block)), block, motions_of_rolling_shutters(block))
