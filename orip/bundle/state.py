"""The state of a block during its adjustment: current values of all parameters, and how corrections change them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.known_motions import KnownMotions
from orip.bundle.rigs.starting import RigState, partials_of_photos
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rotation import (
    angles_from_rotation,
    axes_rotation_from_angle_rates,
    rotation_about_axes,
    rotation_from_angles,
)
from orip.interior.motions import Poses, poses, readout_a_mm, rolling_cameras, rows_of_readout
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, LENS_PLACES, READOUT, first_of_lens
from orip.records.definition import ANTENNA_PARAMETERS, BORESIGHT_PLACES
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

LARGEST_ROTATION = 0.5
"""Largest rotation of a photo (radians) in one iteration; a larger correction is scaled down as a whole."""


SHIFTS, TILTS, RADIUS = slice(0, 3), slice(3, 5), 5
"""Places in `FIGURE_PARAMETERS`."""


class PlacedFigures(Struct, frozen=True):
    """Where the figures of a block are.

    Parameters
    ----------
    origins : array (number of figures, 3)
        Of a level the Z is the common height, in the project.
    axes : array (number of figures, 3, 3)
        As columns; those of a level are X, Y, Z.
    radii : array (number of figures,)
        0 where there is none.
    """

    origins: FloatArray
    axes: FloatArray
    radii: FloatArray

    def moved(self, correction: FloatArray) -> PlacedFigures:
        """Return the figures after corrections (number of figures, 6) of their parameters."""
        if not len(correction):
            return self
        turn = np.zeros((len(correction), 3))
        turn[:, :2] = correction[:, TILTS]
        return PlacedFigures(
            self.origins + (self.axes @ correction[:, SHIFTS, None])[:, :, 0],
            self.axes @ rotation_about_axes(turn),
            self.radii + correction[:, RADIUS],
        )

    def values(self) -> FloatArray:
        """Return numbers (number of figures, 6) that change with the parameters in their places."""
        shifts = np.einsum("fi,fij->fj", self.origins, self.axes)
        return np.column_stack([shifts, self.axes[:, 2, 1], self.axes[:, 2, 0], self.radii])

    def where(self, chosen: BoolArray, others: PlacedFigures) -> PlacedFigures:
        """Return the chosen figures (number of figures,), and the others from elsewhere."""
        return PlacedFigures(
            np.where(chosen[:, None], self.origins, others.origins),
            np.where(chosen[:, None, None], self.axes, others.axes),
            np.where(chosen, self.radii, others.radii),
        )


NO_FIGURES = PlacedFigures(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))


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
        Velocities and angular rates of photos of rolling shutters; see `orip.bundle.known_motions`.
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
    rigs : RigState or None
        Exposures and mountings, from which centres and rotations of the photos of rigs follow.
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
    figures: PlacedFigures
    turned_by_angles: NDArray[np.bool_]
    left_out: NDArray[np.bool_]
    memory: Mapping[str, FloatArray] = field(default_factory=dict)
    rigs: RigState | None = None

    def partials_of_rigs(self) -> FloatArray | None:
        """Return the partials (k, 6, 12) of the photos of rigs; None without any."""
        return None if self.rigs is None else partials_of_photos(self.rigs)

    def with_rigs(self, rigs: RigState | None) -> BlockState:
        """Return the state with photos that follow from exposures and mountings."""
        if rigs is None:
            return self
        photos, centres, rotations = rigs.photos(), self.centres.copy(), self.rotations.copy()
        centres[rigs.photo], rotations[rigs.photo] = photos.centres, photos.rotations
        return replace(self, rigs=rigs, centres=centres, rotations=rotations)

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
        rigs = self.rigs
        if rigs is not None and unknowns.rigs is not None:
            columns = unknowns.rigs
            rigs = rigs.moved(entries_at(correction, columns.exposures), entries_at(correction, columns.mountings))
        moved = replace(
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
            figures=self.figures.moved(entries_at(correction, unknowns.figures)),
        )
        return moved.with_rigs(rigs)


def moving(state: BlockState, block: Block, known: KnownMotions) -> BlockState:
    """Return the state with motions and readouts of photos as its orientations and cameras say."""
    if not rolling_cameras(block).any():
        return state
    return replace(
        state,
        motions=known.at(state.centres, state.rotations, state.antennas),
        readouts=state.cameras[block.photo_camera, READOUT],
    )


def poses_of_rays(block: Block, state: BlockState, rays: IntArray | slice) -> Poses:
    """Return where the photos of some photo points of a block were when these were exposed."""
    points = block.photo_points
    photo = points.photo[rays]
    camera = block.photo_camera[photo]
    a_mm = readout_a_mm(block)
    if a_mm is None:
        return Poses(state.centres[photo], state.rotations[photo])
    motion = state.cameras[camera, READOUT, None] * state.motions[photo] + state.motion_corrections[photo]
    row = rows_of_readout(a_mm, points.xy[rays], camera)
    return poses(state.centres[photo], state.rotations[photo], motion, row)


def rotation_limit(correction: FloatArray, unknowns: Unknowns) -> float:
    """Return the factor that keeps the rotation of every photo and figure within `LARGEST_ROTATION`."""
    tables = [unknowns.photos]
    if unknowns.rigs is not None:
        tables += [unknowns.rigs.exposures, unknowns.rigs.mountings]
    turns = np.linalg.norm(entries_at(correction, np.vstack(tables)[:, 3:]), axis=1)
    tilts = np.linalg.norm(entries_at(correction, unknowns.figures[:, TILTS]), axis=1)
    largest = max(float(turns.max(initial=0.0)), float(tilts.max(initial=0.0)))
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
