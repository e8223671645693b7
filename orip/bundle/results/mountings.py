"""Adjusted exposures and mountings of rigs, with precision."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.results.ground import LEVEL_PHI, UNDETERMINED, reduced_cofactors
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import ExposureEstimate, MountingEstimate
from orip.records.rig import MOUNTING_PARAMETERS
from orip.units import DEGREES_PER_RADIAN

_UNIT = np.array([1.0, 1.0, 1.0, *3 * [DEGREES_PER_RADIAN]])


def mounting_estimates(solved: SolvedBlock) -> tuple[MountingEstimate, ...]:
    """Return offset and rotation of each mounted camera."""
    rigs, columns = solved.state.rigs, solved.problem.unknowns.rigs
    if rigs is None or columns is None:
        return ()
    shown = np.broadcast_to(np.eye(6), (len(rigs.offsets), 6, 6)).copy()
    shown[:, 3:, 3:] = _of_rotations(rigs.mountings)
    values = np.hstack([rigs.offsets, angles_from_rotation(rigs.mountings)])
    names = [(camera.rig, camera.mounting.name) for camera in solved.block.places_on_rigs().mounted]
    rows = _figures(solved, columns.mountings, values, shown, names, MOUNTING_PARAMETERS)
    return tuple(MountingEstimate(*row) for row in rows)


def exposure_estimates(solved: SolvedBlock) -> tuple[ExposureEstimate, ...]:
    """Return centre and rotation of each exposure of a rig, as photos have them."""
    rigs, columns, ground = solved.state.rigs, solved.problem.unknowns.rigs, solved.block.ground
    if rigs is None or columns is None:
        return ()
    centres = ground.to_project(rigs.centres)
    axes = ground.axes_at(centres)
    rotations = axes @ rigs.rotations
    shown = np.zeros((len(centres), 6, 6))
    shown[:, :3, :3] = ground.project_with_partials(rigs.centres).by_local
    shown[:, 3:, 3:] = _of_rotations(rotations) @ axes
    values = np.hstack([centres, angles_from_rotation(rotations)])
    places = solved.block.places_on_rigs()
    names = list(zip(places.exposures, places.rig_of_exposure, strict=True))
    rows = _figures(solved, columns.exposures, values, shown, names, PHOTO_PARAMETERS)
    return tuple(ExposureEstimate(*row) for row in rows)


def _of_rotations(rotations: FloatArray) -> FloatArray:
    """Return the partials (n, 3, 3) of angles by small rotations; near phi = ±90 degrees these themselves."""
    angles = angles_from_rotation(rotations)
    found = angle_rates_from_axes_rotation(angles)
    found[np.abs(np.cos(angles[:, 1])) < LEVEL_PHI] = np.eye(3)
    return found


def _figures(
    solved: SolvedBlock,
    columns: IntArray,
    values: FloatArray,
    shown: FloatArray,
    names: Sequence[tuple[str, str]],
    parameters: Sequence[str],
) -> Iterator[tuple[str, str, str, float, float]]:
    """Yield two names, parameter, value and standard deviation of n records with unknowns at `columns` (n, 6).

    `shown` (n, 6, 6) are the partials of the values by these.
    """
    cofactors = shown @ reduced_cofactors(solved, columns) @ np.swapaxes(shown, 1, 2)
    sd = solved.deviation_scale * np.sqrt(np.maximum(np.einsum("nii->ni", cofactors), 0.0)) * _UNIT
    unknown: BoolArray = columns != CONSTANT
    touched = shown != 0.0
    sd[~(touched & unknown[:, None, :]).any(axis=2)] = np.nan
    removed = unknown & solved.normals.removed[columns]
    sd[(touched & removed[:, None, :]).any(axis=2)] = UNDETERMINED
    for (one, other), of_values, of_sd in zip(names, (values * _UNIT).tolist(), sd.tolist(), strict=True):
        for parameter, value, deviation in zip(parameters, of_values, of_sd, strict=True):
            yield one, other, parameter, value, deviation
