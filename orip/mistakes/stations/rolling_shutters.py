"""Cameras that lack a value, the readout time of their rolling shutter; or one is given that is wrong."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from orip.errors import ProjectWarning
from orip.mistakes.camera_values import with_camera, with_unknown
from orip.mistakes.hypothesis import Readjuster
from orip.mistakes.mistake import ON_GROUND, REPLACED, Consequence, declare
from orip.records.camera import READOUT, Camera, ReadoutDirection
from orip.structs import replace

if TYPE_CHECKING:
    from orip.bundle.groups.held_cameras import ReadoutTest
    from orip.bundle.solve import SolvedBlock

_MOVED_ROWS = Consequence(groups=(*ON_GROUND, "camera"))
"""Rows exposed at another time displace photos along the flight."""

ROLLING_SHUTTER = declare("rolling-shutter", "", _MOVED_ROWS)
READOUT_TIME = declare(
    "readout", "the readout of a camera is another than is given", _MOVED_ROWS,
    Consequence(
        warnings=(
            "contradicting-control", "contradicting-position", "positions-off-alike", "all-positions-off-alike",
            "scattered-positions", "measurement-precision", REPLACED,
        )
    ),
)  # fmt: skip

_SIGNIFICANT = 4.4
"""Normal deviate of an error probability of 1e-5: the residuals of a real block are not quite normal."""

_MATERIAL = 0.01
"""Mean square that the motion leaves in the residuals, in a-priori variances, from which it counts."""

_EXPLAINS = 0.25
"""Part of the misfit beyond the a-priori errors that it explains at least."""

_GLOBAL = 3.0
"""Standard deviations within which a readout time is that of a shutter that exposes all rows at once."""

_SLOWEST = 1.0
"""Seconds: no sensor that takes photos from the air reads out as slowly as that."""

_MOST_PHOTO_POINTS = 200_000
"""Most photo points that are linearised once more for this."""


def rolling_shutters(solved: SolvedBlock, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return the cameras that show another readout time than is held, with its size; none without times of stations.

    It is tried as an unknown before it is advised; where that is not possible, or fails, its size is that of the test.
    """
    from orip.bundle.groups.held_cameras import readout_tests
    from orip.bundle.known_motions import known_motions

    block = solved.block
    if len(block.photo_points.photo) > _MOST_PHOTO_POINTS:
        return []
    state = solved.state
    motion = known_motions(block).at(state.centres, state.rotations, state.antennas)
    if not motion.any():
        return []
    excess = max(solved.variance.sigma0**2 - 1.0, 0.0) if np.isfinite(solved.variance.sigma0) else 0.0
    found = []
    for row, camera in enumerate(block.cameras):
        if camera.sensor is None or "READOUT" in camera.unknown:
            continue
        given = camera.parameters[READOUT]
        tests = [
            test
            for test, held in zip(readout_tests(solved, row, motion), (given, 0.0), strict=True)
            if abs(test.readout - held) > _SIGNIFICANT * test.sd
            and test.fall_of_both > max(_MATERIAL, _EXPLAINS * excess) * test.number
            and abs(test.readout) < _SLOWEST
        ]
        if tests:
            test = _adjusted(readjuster, camera, tests) or max(tests, key=lambda one: one.fall)
            code, text = (READOUT_TIME, _misgiven(test, camera)) if given else (ROLLING_SHUTTER, _rolling(test, camera))
            found.append(ProjectWarning(code, f"camera {camera.name}", text))
    return found


def _adjusted(readjuster: Readjuster, camera: Camera, tests: list[ReadoutTest]) -> ReadoutTest | None:
    """Return the best of the readout times as an unknown, with what else its test says; None: none is adjusted."""
    places = [row for row, other in enumerate(readjuster.block.cameras) if other.name == camera.name]
    if not readjuster.is_small or not places:
        return None
    found = []
    for test in tests:
        turned = replace(readjuster.block.cameras[places[0]], readout_direction=test.direction)
        block = with_camera(readjuster.block, places[0], turned)
        tried = readjuster.adjust(with_unknown(block, places[0], "READOUT"))
        if tried is None or not tried.converged:
            continue
        row = [other.name for other in tried.block.cameras].index(camera.name)
        column = int(tried.problem.unknowns.cameras[row, READOUT])
        readout = float(tried.state.cameras[row, READOUT])
        sd = tried.deviation_scale * float(np.sqrt(tried.cofactors.reduced[column, column]))
        held = camera.parameters[READOUT] if test.direction == camera.readout_direction else 0.0
        off, of_test = readout - held, test.readout - held
        if not tried.normals.removed[column] and abs(off) > _SIGNIFICANT * sd:
            better = test._replace(readout=readout, sd=sd, pixels=test.pixels * abs(off / of_test))
            found.append((tried.variance.sigma0, better))
    return min(found)[1] if found else None


_FIRST: Mapping[ReadoutDirection, str] = MappingProxyType(
    {"down": "upper row", "up": "lower row", "right": "left column", "left": "right column"}
)
_AGAINST: Mapping[ReadoutDirection, ReadoutDirection] = MappingProxyType(
    {"down": "up", "up": "down", "right": "left", "left": "right"}
)


def _order(test: ReadoutTest) -> ReadoutDirection:
    """Return the direction in which the readout of a test is positive."""
    return test.direction if test.readout > 0.0 else _AGAINST[test.direction]


def _keys(test: ReadoutTest, camera: Camera, readout: str) -> str:
    """Return the text of a readout without its sign, with the direction if it is another than the camera's."""
    if test.direction == camera.readout_direction:
        return readout if test.readout > 0.0 else f"-{readout}"
    return f'{readout}, readout_direction = "{_order(test)}"'


def _advised(test: ReadoutTest, camera: Camera) -> str:
    keys = _keys(test, camera, f"{abs(test.readout):.3f}")
    return f'write readout = {keys} and unknown = [..., "READOUT"] in its [[camera]]'


def _rolling(test: ReadoutTest, camera: Camera) -> str:
    first = _FIRST[_order(test)]
    line = first.split()[-1]
    return (
        f"residuals along the flight depend on the {line}, as those of a rolling shutter that takes "
        f"{1e3 * abs(test.readout):.1f} ± {1e3 * test.sd:.1g} ms from the first {line} to the last one ({first} "
        f"first); meanwhile the image moves by {test.pixels:.1f} pixels, and points and the principal distance may be "
        f"off; {_advised(test, camera)}, which models it"
    )


def _misgiven(test: ReadoutTest, camera: Camera) -> str:
    is_global = abs(test.readout) < _GLOBAL * test.sd
    remedy = (
        "take it out of its [[camera]]: its shutter exposes all rows at once" if is_global else _advised(test, camera)
    )
    line = _FIRST[test.direction].split()[-1]
    return (
        f"readout = {camera.parameters[READOUT]:g} does not fit the photos, "
        f"{_keys(test, camera, f'{abs(test.readout):.4f} ± {test.sd:.1g} s')} does: "
        f"residuals along the flight depend on the {line}; the images are off by {test.pixels:.1f} pixels, and points, "
        f"stations and the principal distance may be, too; {remedy}"
    )
