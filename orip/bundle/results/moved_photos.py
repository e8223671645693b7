"""How the photos of rolling shutters moved while they were exposed, and by how much their images did."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.results.ground import deviations
from orip.bundle.solve import SolvedBlock
from orip.interior.motions import rolling_cameras
from orip.records.results.solution import PhotoMotion
from orip.units import DEGREES_PER_RADIAN

_UNIT = np.repeat([1.0, DEGREES_PER_RADIAN], 3)


def photo_motions(solved: SolvedBlock) -> tuple[PhotoMotion, ...]:
    """Return the motions of the photos of rolling shutters along and about the project's axes; none of others."""
    block, state = solved.block, solved.state
    photos = np.flatnonzero(rolling_cameras(block)[block.photo_camera])
    if not len(photos):
        return ()
    axes = block.ground.axes_at(block.ground.to_project(state.centres[photos]))
    readout = state.readouts[photos, None]
    readout = np.where(readout == 0.0, np.inf, readout)
    local = (state.motions[photos] + state.motion_corrections[photos] / readout).reshape(-1, 2, 3)
    values = _UNIT * np.einsum("nij,nkj->nki", axes, local).reshape(-1, 6)
    sd = _UNIT * deviations(solved, solved.problem.unknowns.motions[photos]) / np.abs(readout)
    pixels = _pixels(solved)[photos]
    return tuple(
        PhotoMotion(block.photos[photo].name, *[*np.column_stack([of_photo, sds]).ravel().tolist(), size])
        for photo, of_photo, sds, size in zip(photos.tolist(), values, sd, pixels.tolist(), strict=True)
    )


def _pixels(solved: SolvedBlock) -> FloatArray:
    """Return the root mean square (number of photos,) of the motion of the image points of a photo in the readout."""
    kind, block = solved.problem.observations[0], solved.block
    assert isinstance(kind, PhotoPointObservations), "photo points are the first kind of observation"
    pixel = np.array(
        [np.nan if camera.sensor is None else camera.sensor.height / camera.sensor.rows for camera in block.cameras]
    )
    squares, number = np.zeros(len(block.photos)), np.zeros(len(block.photos))
    for part in kind.in_parts():
        ends = [part.moving_image(solved.state, end).image for end in (-0.5, 0.5)]
        seen = ends[0].in_front & ends[1].in_front
        moved = (ends[1].xy - ends[0].xy)[seen] / pixel[part.camera[seen], None]
        squares += np.bincount(part.photo[seen], np.sum(moved**2, axis=1), len(squares))
        number += np.bincount(part.photo[seen], minlength=len(squares))
    return np.asarray(np.sqrt(squares / np.maximum(number, 1.0)))
