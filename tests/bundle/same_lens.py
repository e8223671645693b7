"""Blocks of two cameras with the same lens and principal points of their own."""

from __future__ import annotations

import numpy as np

from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, with_lens_of
from orip.structs import replace

SHIFT = np.array([0.31, -0.22])
"""Principal point of the second camera minus that of the first, mm."""


def with_two_frames(block: Block, *, same_lens: bool = True) -> Block:
    """Return a block of one camera whose photos are taken with two by turns, the second frame shifted.

    The argument of the polynomial, ideal or measured, makes no difference: an image moves with the principal point.
    """
    lens = block.cameras[0]
    parameters = list(lens.parameters)
    for place, shift in zip((1, 2), SHIFT.tolist(), strict=True):
        parameters[place] += shift
    own = tuple(name for name in CAMERA_PARAMETERS if name in lens.unknown)
    other = replace(lens, name="OTHER", parameters=tuple(parameters), unknown=own)
    if same_lens:
        other = with_lens_of(replace(other, same_lens_as=lens.name), lens)
    camera = np.arange(len(block.photos), dtype=np.int64) % 2
    points = block.photo_points
    moved = points.xy + np.where(camera[points.photo][:, None] == 1, SHIFT, 0.0)
    photos = tuple(
        replace(photo, camera=other.name) if of else photo for photo, of in zip(block.photos, camera, strict=True)
    )
    return replace(
        block,
        cameras=(lens, other),
        photos=photos,
        photo_camera=camera,
        photo_points=replace(points, xy=moved),
    )
