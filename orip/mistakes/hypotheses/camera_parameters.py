"""Camera parameters: distortion or principal point with the opposite sign, and distortion that is not in the record.

Every function yields hypotheses for one camera, given by its index in the block.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.records.project.camera import CAMERA_PARAMETERS, Camera
from orip.structs import replace

_PRINCIPAL_POINT = slice(1, 3)
_DISTORTION = slice(3, None)
_LENS = ("A3", "A5", "P1", "P2")
"""The distortion of an ordinary lens."""


def distortion_sign(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield a camera's distortion with the opposite sign."""
    camera = block.cameras[row]
    given = _values(camera)[_DISTORTION] != 0.0
    if given.any() and not _is_unknown(camera)[_DISTORTION][given].any():
        text = (
            "the distortion fits with the opposite sign; reverse the sign of its coefficients (positive distortion "
            "moves the image outwards: measured = ideal + distortion)"
        )
        changed = _with_factors(block, row, _DISTORTION, np.array(-1.0))
        yield Hypothesis(changed, finding("distortion-sign", f"camera {camera.name}", text))


def principal_point_sign(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield a camera's principal point with the opposite sign of y, of x, and of both."""
    camera = block.cameras[row]
    x, y = camera.parameters[_PRINCIPAL_POINT]
    if _is_unknown(camera)[_PRINCIPAL_POINT].any():
        return
    for signs, kinds in (((1.0, -1.0), "y"), ((-1.0, 1.0), "x"), ((-1.0, -1.0), "x and y")):
        if (x, y) == (x * signs[0], y * signs[1]):
            continue
        text = (
            f"the principal point ({x:g}, {y:g}) mm fits with the opposite sign of {kinds}; reverse it (x to the right "
            "and y up, from the centre of the sensor or the fiducial marks to the principal point)"
        )
        changed = _with_factors(block, row, _PRINCIPAL_POINT, np.array(signs))
        yield Hypothesis(changed, finding("principal-point-sign", f"camera {camera.name}", text))


def distortion_of_lens(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield a camera without distortion as one whose distortion is unknown."""
    camera = block.cameras[row]
    if not _values(camera)[_DISTORTION].any() and not _is_unknown(camera)[_DISTORTION].any():
        text = (
            "the lens has a distortion that is not in the camera's record; give it (distortion = { ... }), or let the "
            'adjustment determine it: unknown = ["A3", "A5", "P1", "P2"]'
        )
        changed = with_unknown(block, row, *_LENS)
        yield Hypothesis(changed, finding("distortion", f"camera {camera.name}", text))


def with_camera(block: Block, row: int, camera: Camera) -> Block:
    """Return a block with another camera in one row."""
    return replace(block, cameras=(*block.cameras[:row], camera, *block.cameras[row + 1 :]))


def with_unknown(block: Block, row: int, *kinds: str) -> Block:
    """Return a block in which parameters of one camera are unknown, besides those that are unknown already."""
    camera = block.cameras[row]
    unknown = tuple(kind for kind in CAMERA_PARAMETERS if kind in {*kinds, *camera.unknown})
    return with_camera(block, row, replace(camera, unknown=unknown))


def _with_factors(block: Block, row: int, which: slice, factor: FloatArray) -> Block:
    values = _values(block.cameras[row])
    values[which] *= factor
    return with_camera(block, row, replace(block.cameras[row], parameters=tuple(values.tolist())))


def _values(camera: Camera) -> FloatArray:
    return np.array(camera.parameters, dtype=np.float64)


def _is_unknown(camera: Camera) -> BoolArray:
    return np.isin(CAMERA_PARAMETERS, camera.unknown)
