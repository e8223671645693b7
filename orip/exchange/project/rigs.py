"""Rigs of another program's project in orip's conventions, and those of a result as other programs have them.

A mounting is given against the reference camera, whose axes are those of the reading: orip's times D = diag(1, -1, -1)
where y is down. In orip a rig has the axes of its reference camera.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.rigs.starting import robust_poses
from orip.exchange.conversion.poses import camera_axes
from orip.exchange.project.block import ImportedBlock
from orip.exchange.sources.names import unique_names
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.exchanged import ExchangedExposure, ExchangedMounting, ExchangedRig, PoseReading
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.records.rig import MOUNTING_PARAMETERS, Mounting, Rig, RigExposure, Rigs
from orip.units import RADIANS_PER_DEGREE


def imported_rigs(block: ImportedBlock) -> Rigs:
    """Return the rigs of a block and their exposures; what the other program estimates is unknown.

    A mounting that it holds has the value that the photos show.
    """
    project = block.project
    given = tuple(rig for rig in project.rigs if len(rig.mountings) > 1)
    of_rigs = {one.camera for rig in given for one in rig.mountings}
    rig_names = unique_names([rig.name for rig in given], "RIG", ignoring_case=True)
    exposures = [
        one
        for one in project.exposures
        if (cameras := [camera for n in one.photos if (camera := project.photos[n].camera) in of_rigs])
        and len(set(cameras)) == len(cameras)  # two photos of a camera are not of one instant
    ]
    names = unique_names([one.name for one in exposures], "EXPOSURE", ignoring_case=True)
    return Rigs(
        tuple(
            Rig(name, (Mounting(_camera(block, rig.mountings[0])), *(_mounting(block, rig, n) for n in _others(rig))))
            for name, rig in zip(rig_names, given, strict=True)
        ),
        tuple(
            RigExposure(name, tuple(block.photos[n] for n in one.photos if project.photos[n].camera in of_rigs))
            for name, one in zip(names, exposures, strict=True)
        ),
    )


def _others(rig: ExchangedRig) -> range:
    return range(1, len(rig.mountings))


def _camera(block: ImportedBlock, mounting: ExchangedMounting) -> str:
    return block.cameras[mounting.camera].camera.name


def _mounting(block: ImportedBlock, rig: ExchangedRig, number: int) -> Mounting:
    """Return a mounting against the reference camera."""
    given, name = rig.mountings[number], _camera(block, rig.mountings[number])
    if given.is_held:
        pose = _shown_by_photos(block, rig.mountings[0].camera, given.camera)
        return Mounting(name) if pose is None else Mounting(name, _three(pose[0]), None, _degrees(pose[1]))
    turned = camera_axes(block.found.reading)
    is_observed = bool(given.rotation and given.offset)
    offset = _three(turned @ given.offset) if is_observed and given.offset_error else None
    rotation = turned @ np.reshape(given.rotation, (3, 3)) @ turned if is_observed and given.rotation_error else None
    return Mounting(
        name,
        offset,
        None if offset is None else given.offset_error,
        None if rotation is None else _degrees(rotation),
        None if rotation is None else given.rotation_error,
    )


def _shown_by_photos(block: ImportedBlock, reference: int, camera: int) -> tuple[FloatArray, FloatArray] | None:
    """Return offset and rotation of a camera against another, as photos of the same exposures have them."""
    photos, found = block.project.photos, block.found
    pairs = [
        (first, second)
        for exposure in block.project.exposures
        for first in exposure.photos
        for second in exposure.photos
        if (photos[first].camera, photos[second].camera) == (reference, camera)
    ]
    rows: IntArray = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    to_rig = np.swapaxes(found.rotations[rows[:, 0]], 1, 2)
    offsets = (to_rig @ (found.centres[rows[:, 1]] - found.centres[rows[:, 0]])[:, :, None])[:, :, 0]
    mountings = to_rig @ found.rotations[rows[:, 1]]
    known = np.isfinite(offsets).all(axis=1) & np.isfinite(mountings).all(axis=(1, 2))
    if not known.any():
        return None
    places, rotations = robust_poses(offsets[known], mountings[known], np.zeros(int(known.sum()), dtype=np.int64), 1)
    return places[0], rotations[0]


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = np.asarray(values).tolist()
    return x, y, z


def _degrees(rotation: FloatArray) -> tuple[float, float, float]:
    return _three(angles_from_rotation(rotation) / RADIANS_PER_DEGREE)


def exchanged_rigs(
    solution: Solution, rigs: Rigs, cameras: Sequence[str], reading: PoseReading
) -> tuple[ExchangedRig, ...]:
    """Return the adjusted mountings of rigs.

    Parameters
    ----------
    rigs : Rigs
        Of the project.
    cameras : sequence of record_key
        Those that are exchanged.
    """
    values = {(one.rig, one.camera, one.name): one.value for one in solution.mountings}
    turned = camera_axes(reading)
    found = []
    for rig in rigs.rigs:
        mounted = [
            one.name
            for one in rig.cameras
            if record_key(one.name) in cameras and (rig.name, one.name, MOUNTING_PARAMETERS[0]) in values
        ]
        poses = np.array([[values[rig.name, one, key] for key in MOUNTING_PARAMETERS] for one in mounted])
        if len(mounted) < 2:
            continue
        rotations = rotation_from_angles(poses[:, 3:] * RADIANS_PER_DEGREE)
        to_reference = turned @ rotations[0].T
        mountings = tuple(
            ExchangedMounting(
                cameras.index(record_key(name)),
                tuple((to_reference @ rotations[n] @ turned).ravel().tolist()),
                tuple((to_reference @ (poses[n, :3] - poses[0, :3])).tolist()),
            )
            for n, name in enumerate(mounted)
        )
        found.append(ExchangedRig(rig.name, mountings))
    return tuple(found)


def exchanged_exposures(solution: Solution, rigs: Rigs) -> tuple[ExchangedExposure, ...]:
    """Return the exposures with their photos in a solution."""
    row = {record_key(name): n for n, name in enumerate(solution.photos.names)}
    adjusted = {one.exposure for one in solution.rig_exposures}
    return tuple(
        ExchangedExposure(one.name, tuple(row[record_key(name)] for name in one.photos if record_key(name) in row))
        for one in rigs.exposures
        if one.name in adjusted
    )
