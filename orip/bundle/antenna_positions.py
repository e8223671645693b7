"""Positions of the antennas of exposure stations: partials and unknowns, and what decorrelates their coordinates."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.antennas import StationPlaces, rows_or
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rotation import cross_matrix
from orip.records.block import Block
from orip.records.definition import LEVER_ARM
from orip.records.ground import GroundSystem

_ARM, _OFFSET = slice(0, 3), 6


def antenna_positions_with_partials(
    state: BlockState, places: StationPlaces, members: IntArray, ground: GroundSystem
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return positions (s, 3) as GNSS observes them, partials (s, 3, 16) and which can be computed (s,).

    Partials are by the unknowns of `PositionObservations.linearise_with_partials`; zero where nothing can be computed.

    Parameters
    ----------
    members : array (s,) of int
        Rows of `places`.
    """
    photo, elapsed = places.photo[members], places.elapsed[members][:, None, None]
    rotation, velocity = state.rotations[photo], places.velocity[members]
    antenna = rows_or(state.antennas, places.antenna[members], 0.0)
    arm = (rotation @ antenna[:, _ARM, None])[:, :, 0]
    found = ground.project_with_partials(state.centres[photo] + arm)
    value = found.value + velocity * antenna[:, [_OFFSET]]
    value = value + rows_or(state.shifts, places.shift[members], 0.0)
    value = value + elapsed[:, 0] * rows_or(state.drifts, places.drift[members], 0.0)
    turned = found.by_local @ -cross_matrix(arm) @ state.rotation_basis()[photo]
    axes = np.broadcast_to(np.eye(3), turned.shape)
    partials = np.concatenate(
        [found.by_local, turned, found.by_local @ rotation, velocity[:, :, None], axes, elapsed * axes], axis=2
    )
    known: BoolArray = np.asarray(np.isfinite(value).all(axis=1) & np.isfinite(partials).all(axis=(1, 2)))
    return value, np.where(known[:, None, None], partials, 0.0), known


def columns_of_positions(
    block: Block, unknowns: Unknowns, places: StationPlaces, members: IntArray, whitening: FloatArray
) -> IntArray:
    """Return the unknowns (s, k, 16) of k combinations (s, k, 3) of X, Y and Z of stations."""
    photo, antenna = unknowns.elements[places.photo[members]], places.antenna[members]
    of_antenna = rows_or(unknowns.antennas, antenna, CONSTANT)
    shift = rows_or(unknowns.shifts, places.shift[members], CONSTANT)
    drift = rows_or(unknowns.drifts, places.drift[members], CONSTANT)
    given = np.array([record.lever_arm for record in block.antennas], dtype=np.float64).reshape(-1, len(LEVER_ARM))
    has_arm = (rows_or(given, antenna, 0.0) != 0.0).any(axis=1) | (of_antenna[:, _ARM] != CONSTANT).any(axis=1)
    mixed = whitening != 0.0
    depends = (mixed @ block.ground.dependence.astype(np.int64)) > 0

    def where(condition: BoolArray, columns: IntArray) -> IntArray:
        shape = (*whitening.shape[:2], columns.shape[1])
        return np.where(np.broadcast_to(condition, shape), columns[:, None], CONSTANT)

    always = mixed.any(axis=2, keepdims=True)
    return np.concatenate(
        [
            where(depends, photo[:, :3]),
            where(has_arm[:, None, None], photo[:, 3:]),
            where(always, of_antenna[:, _ARM]),
            where(always, of_antenna[:, [_OFFSET]]),
            where(mixed, shift),
            where(mixed, drift),
        ],
        axis=2,
    )


def position_errors(block: Block) -> FloatArray:
    """Return a-priori errors (number of stations, 3), NaN where no position was observed."""
    errors = [station.position_error if station.has_position else (np.nan,) * 3 for station in block.stations]
    return np.array(errors, dtype=np.float64).reshape(-1, 3)


def observed_coordinates(block: Block) -> BoolArray:
    """Return which coordinates (number of stations, 3) are observed, or only compared."""
    error = position_errors(block)
    return np.asarray(np.isfinite(error) & (error != 0.0))


def decorrelation(error: FloatArray, covariance: FloatArray | None) -> FloatArray:
    """Return diag(error) L^-1 (k, k) for a covariance L L^T; what has no error above zero stays as it is.

    Parameters
    ----------
    error : array (k,)
        Zero or negative of components that are constant or only compared; NaN of those not observed.
    covariance : array (k, k) or None
    """
    found = np.eye(len(error))
    observed = np.flatnonzero(error > 0.0)
    if covariance is not None and len(observed):
        factor = np.linalg.cholesky(covariance[np.ix_(observed, observed)])
        found[np.ix_(observed, observed)] = error[observed, None] * np.linalg.inv(factor)
    return found
