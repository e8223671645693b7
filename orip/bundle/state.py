"""The state of a block during its adjustment: current values of all parameters, and how corrections change them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rotation import (
    angles_from_rotation,
    axes_rotation_from_angle_rates,
    rotation_about_axes,
    rotation_from_angles,
)
from orip.interior.motions import Poses, TimedPhotos, motions, poses, rolling_cameras, rows_of_readout
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, LENS_PLACES, READOUT, first_of_lens
from orip.records.definition import ANTENNA_PARAMETERS, BORESIGHT_PLACES
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

LARGEST_ROTATION = 0.5
"""Largest rotation of a photo (radians) in one iteration; a larger correction is scaled down as a whole."""


class BlockState(Struct, frozen=True):
    """Current values.

    Parameters
    ----------
    cameras : array (number of cameras, 13)
        In the order of `CAMERA_PARAMETERS`.
    additional : array (number of cameras, k)
        Values of the parameter sets; k that of the largest set, zero where a camera has fewer or none.
    centres : array (number of photos, 3)
    rotations : array (number of photos, 3, 3)
        Photo to ground.
    motions : array (number of photos, 6)
        Velocities and angular rates of photos of rolling shutters, from their neighbours; see `orip.interior.motions`.
    motion_corrections : array (number of photos, 6)
        What is unknown of them, times the readout: shifts (ground unit) and turns (radians) during all of it.
    readouts : array (number of photos,)
        Seconds, those that the a-priori errors of the corrections are of; held in an iteration.
    points : array (number of points, 3)
    antennas : array (number of antennas, 7)
        In the order of `ANTENNA_PARAMETERS`, boresight in radians.
    shifts, drifts : arrays (k, 3)
        Of the stretches of `StationPlaces`, along the project's axes.
    theodolites : array (number of theodolite sets,)
        Zero directions, radians.
    turned_by_angles : array (number of photos,) of bool
        Photos with a constant rotation element: their unknowns are omega, phi, kappa themselves. The others' unknowns
        are small rotations about the ground axes, which have no singular case.
    left_out : array (number of points,) of bool
        Points that take no part: their rays have no angle of intersection.
    memory : mapping of kind to array
        Shifts of exact constraints, kept from one iteration to the next.
    """

    cameras: FloatArray
    additional: FloatArray
    centres: FloatArray
    rotations: FloatArray
    motions: FloatArray
    motion_corrections: FloatArray
    readouts: FloatArray
    points: FloatArray
    antennas: FloatArray
    shifts: FloatArray
    drifts: FloatArray
    theodolites: FloatArray
    turned_by_angles: NDArray[np.bool_]
    left_out: NDArray[np.bool_]
    memory: Mapping[str, FloatArray] = field(default_factory=dict)

    def angles(self) -> FloatArray:
        """Return omega, phi, kappa (number of photos, 3), radians."""
        return angles_from_rotation(self.rotations)

    def rotation_basis(self) -> FloatArray:
        """Return for each photo the matrix (3, 3) from its rotation unknowns to rotations about the ground axes."""
        basis = np.broadcast_to(np.eye(3), self.rotations.shape).copy()
        if self.turned_by_angles.any():
            basis[self.turned_by_angles] = axes_rotation_from_angle_rates(self.angles()[self.turned_by_angles])
        return basis

    def moved(self, correction: FloatArray, unknowns: Unknowns) -> BlockState:
        """Return the state after a correction of all unknowns (radians for rotations)."""
        rotation = entries_at(correction, unknowns.photos[:, 3:])
        rotations = rotation_about_axes(rotation) @ self.rotations
        if self.turned_by_angles.any():
            turned = self.turned_by_angles
            rotations[turned] = rotation_from_angles(self.angles()[turned] + rotation[turned])
        return replace(
            self,
            cameras=self.cameras + entries_at(correction, unknowns.cameras),
            additional=self.additional + entries_at(correction, unknowns.additional),
            antennas=self.antennas + entries_at(correction, unknowns.antennas),
            shifts=self.shifts + entries_at(correction, unknowns.shifts),
            drifts=self.drifts + entries_at(correction, unknowns.drifts),
            centres=self.centres + entries_at(correction, unknowns.photos[:, :3]),
            rotations=rotations,
            motion_corrections=self.motion_corrections + entries_at(correction, unknowns.motions),
            points=self.points + entries_at(correction, unknowns.points),
            theodolites=self.theodolites + entries_at(correction, unknowns.theodolites),
        )


def moving(state: BlockState, block: Block, strips: tuple[TimedPhotos, ...]) -> BlockState:
    """Return the state with motions and readouts of photos as its orientations and cameras say."""
    if not rolling_cameras(block).any():
        return state
    return replace(
        state,
        motions=motions(strips, state.centres, state.rotations),
        readouts=state.cameras[block.photo_camera, READOUT],
    )


def poses_of_rays(block: Block, state: BlockState, rays: IntArray | slice) -> Poses:
    """Return where the photos of some photo points of a block were when these were exposed."""
    points = block.photo_points
    photo = points.photo[rays]
    camera = block.photo_camera[photo]
    row = rows_of_readout(block, points.xy[rays], camera)
    if row is None:
        return Poses(state.centres[photo], state.rotations[photo])
    motion = state.cameras[camera, READOUT, None] * state.motions[photo] + state.motion_corrections[photo]
    return poses(state.centres[photo], state.rotations[photo], motion, row)


def rotation_limit(correction: FloatArray, unknowns: Unknowns) -> float:
    """Return the factor that keeps the rotation of every photo within `LARGEST_ROTATION`."""
    turns = np.linalg.norm(entries_at(correction, unknowns.photos[:, 3:]), axis=1)
    largest = float(turns.max(initial=0.0))
    return min(1.0, LARGEST_ROTATION / largest) if largest > 0.0 else 1.0


def entries_at(vector: FloatArray, columns: NDArray[np.int64]) -> FloatArray:
    """Return the entries of a vector (u,) or (u, k) of all unknowns at columns, zero where there is no unknown."""
    if not len(vector):
        return np.zeros((*columns.shape, *vector.shape[1:]))
    # a constant leads to the last entry
    found = vector[columns]
    found[columns == CONSTANT] = 0.0
    return np.asarray(found)


def antenna_parameters(block: Block) -> FloatArray:
    """Return the values of all antennas (n, 7), boresight in radians."""
    values = np.array([antenna.values for antenna in block.antennas], dtype=np.float64)
    values = values.reshape(-1, len(ANTENNA_PARAMETERS))
    values[:, BORESIGHT_PLACES] *= RADIANS_PER_DEGREE
    return values


def camera_parameters(block: Block) -> FloatArray:
    """Return the values of all cameras, those of a lens as its first camera has them."""
    parameters = np.array([camera.parameters for camera in block.cameras], dtype=np.float64)
    values = parameters.reshape(-1, len(CAMERA_PARAMETERS))
    values[:, LENS_PLACES] = values[first_of_lens(block.cameras)][:, LENS_PLACES]
    return values
