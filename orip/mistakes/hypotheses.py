"""What may have been written otherwise than it was meant: blocks as they would be then, each with what to say.

A block that does not fit is adjusted again under each of these hypotheses; `trial` compares. They are in the order in
which they are likely, for two that explain a block equally well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.bundle.starting_points import given_coordinates
from orip.geometry.rotation import rotation_from_angles
from orip.interior.image_vectors import image_vectors
from orip.mistakes.angle_unit import ANGLE_UNITS, angle_unit_text, is_nearer
from orip.mistakes.principal_distance import principal_distance_seen
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, Camera

_NEAR = 0.5
_WORST_PHOTOS = 12
"""Photos among which an exchanged pair is looked for."""

_PAIRS = 3
"""Pairs that are tried: preliminary orientations are rough."""

_LENS = ("A3", "A5", "P1", "P2")
_DISTORTION_TEXT = (
    "the lens has a distortion that the camera's record has not; give it (distortion = { ... }), or let the adjustment "
    'find it: unknown = ["A3", "A5", "P1", "P2"]'
)
_PRINCIPAL_POINT = slice(1, 3)
_DISTORTION = slice(3, None)


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A block as it would be if something had been meant otherwise.

    Parameters
    ----------
    code : str
        Stable name in kebab-case.
    where : str
    block : Block
    says : callable
        What is probably wrong and what to do, from the adjustment of that block.
    holds : callable
        Whether the adjustment of that block is one that the hypothesis foresees; that it fits is not looked at here.
    """

    code: str
    where: str
    block: Block
    says: Callable[[SolvedBlock], str]
    holds: Callable[[SolvedBlock], bool] = lambda _: True


def plainly(text: str) -> Callable[[SolvedBlock], str]:
    """Return what says a text of any adjustment."""
    return lambda _: text


# ------------------------------------------------------------------------------------------------------------- cameras


def camera_hypotheses(block: Block) -> Iterator[Hypothesis]:
    """Yield what may be wrong with the parameters of a camera."""
    for row, camera in enumerate(block.cameras):
        where, values = f"camera {camera.name}", np.array(camera.parameters)
        unknown = np.isin(CAMERA_PARAMETERS, camera.unknown)
        if (values[_DISTORTION] != 0.0).any() and not unknown[_DISTORTION][values[_DISTORTION] != 0.0].any():
            text = (
                "the distortion fits with the opposite sign; reverse the sign of its coefficients (positive distortion "
                "moves the image outwards: measured = ideal + distortion)"
            )
            yield Hypothesis("distortion-sign", where, _with_values(block, row, _DISTORTION, -1.0), plainly(text))
        if values[_PRINCIPAL_POINT].any() and not unknown[_PRINCIPAL_POINT].any():
            yield from _principal_points(block, row, where)
        if not values[_DISTORTION].any() and not unknown[_DISTORTION].any():
            free = _with_unknown(block, row, *_LENS)
            yield Hypothesis("distortion", where, free, plainly(_DISTORTION_TEXT))
        if not unknown[0]:
            says = partial(_other_c, row=row, given=camera.parameters[0])
            yield Hypothesis("principal-distance", where, _with_unknown(_with_c_seen(block, row), row, "C"), says)


def _principal_points(block: Block, row: int, where: str) -> Iterator[Hypothesis]:
    x, y = block.cameras[row].parameters[_PRINCIPAL_POINT]
    for signs, kinds in (((1.0, -1.0), "y"), ((-1.0, 1.0), "x"), ((-1.0, -1.0), "x and y")):
        if (x, y) == (x * signs[0], y * signs[1]):
            continue
        text = (
            f"the principal point ({x:g}, {y:g}) mm fits with the opposite sign of {kinds}; reverse it (x to the right "
            "and y up, from the centre of the sensor or the fiducial marks to the principal point)"
        )
        changed = _with_values(block, row, _PRINCIPAL_POINT, np.array(signs))
        yield Hypothesis("principal-point-sign", where, changed, plainly(text))


def _with_camera(block: Block, row: int, camera: Camera) -> Block:
    return replace(block, cameras=(*block.cameras[:row], camera, *block.cameras[row + 1 :]))


def _with_values(block: Block, row: int, which: slice, factor: float | FloatArray) -> Block:
    values = np.array(block.cameras[row].parameters)
    values[which] *= factor
    return _with_camera(block, row, replace(block.cameras[row], parameters=tuple(values.tolist())))


def _with_unknown(block: Block, row: int, *kinds: str) -> Block:
    camera = block.cameras[row]
    unknown = tuple(kind for kind in CAMERA_PARAMETERS if kind in {*kinds, *camera.unknown})
    return _with_camera(block, row, replace(camera, unknown=unknown))


def _with_c_seen(block: Block, row: int) -> Block:
    """Return a block whose camera begins with the principal distance that control tells of."""
    camera = block.cameras[row]
    parameters = (principal_distance_seen(block, row), *camera.parameters[1:])
    return _with_camera(block, row, replace(camera, parameters=parameters))


def _other_c(solved: SolvedBlock, row: int, given: float) -> str:
    camera = solved.block.cameras[row]
    found = float(solved.state.cameras[row, 0])
    column = int(solved.problem.unknowns.cameras[row, 0])
    sd = float(solved.deviation_scale * np.sqrt(solved.cofactors_of(np.array([column]))[0, 0]))
    size = "" if camera.sensor is None else ", or the size of the sensor,"
    guess = principal_distance_guess(given, found, camera)
    return (
        f"C = {given:g} mm does not fit the photos, {found:.4g} ± {sd:.1g} mm does{guess}: the principal distance"
        f'{size} is probably that of another lens, zoom or camera; correct it, or let it be found (unknown = ["C"])'
    )


_DIAGONAL_OF_35_MM_FILM = 43.27
_ALIKE = 0.15
"""Of a ratio of principal distances: cameras are known so well before they are calibrated."""


def principal_distance_guess(given: float, found: float, camera: Camera) -> str:
    """Return in which unit a principal distance was probably given, as a clause; nothing where none is met."""
    ratios = {1e3: "micrometres", 1e-3: "metres", 1.0 / 25.4: "inches"}
    if camera.sensor is not None:
        diagonal = float(np.hypot(camera.sensor.width, camera.sensor.height))
        ratios[camera.sensor.columns / camera.sensor.width] = "pixels"
        ratios[_DIAGONAL_OF_35_MM_FILM / diagonal] = "the equivalent for 35 mm film"
    near = min(ratios, key=lambda each: abs(np.log(given / found / each)))
    return f" ({given:g} is that in {ratios[near]})" if abs(np.log(given / found / near)) < _ALIKE else ""


def other_cameras(block: Block, photos: Sequence[str], cameras: Sequence[Camera]) -> Iterator[Hypothesis]:
    """Yield photos with each of the other cameras of the project that measure marks or pixels as theirs does.

    Parameters
    ----------
    block : Block
    photos : sequence of str
        Those that do not fit.
    cameras : sequence of Camera
        All of the project.
    """
    names = [photo.name for photo in block.photos]
    for name in photos:
        photo = names.index(name)
        own = block.cameras[block.photo_camera[photo]]
        for camera in cameras:
            if camera.name == own.name or (camera.sensor is None) != (own.sensor is None):
                continue
            known = [each.name for each in block.cameras]
            all_cameras = block.cameras if camera.name in known else (*block.cameras, camera)
            photo_camera = block.photo_camera.copy()
            photo_camera[photo] = [each.name for each in all_cameras].index(camera.name)
            changed = _without_unused(replace(block, cameras=all_cameras, photo_camera=photo_camera))
            text = (
                f"it fits with camera {camera.name}, and not with {own.name}; write "
                f'camera = "{camera.name}" in its [[photo]]'
            )
            yield Hypothesis("other-camera", f"photo {name}", changed, plainly(text))


def _without_unused(block: Block) -> Block:
    used = np.unique(block.photo_camera)
    place = np.full(len(block.cameras), -1)
    place[used] = np.arange(len(used))
    return replace(block, cameras=tuple(block.cameras[k] for k in used), photo_camera=place[block.photo_camera])


# -------------------------------------------------------------------------------------------------------------- photos


def photo_hypotheses(block: Block) -> Iterator[Hypothesis]:
    """Yield mirrored and exchanged photos, and preliminary angles in other units."""
    for row, camera in enumerate(block.cameras):
        mine = block.photo_camera[block.photo_points.photo] == row
        where = f"camera {camera.name}"
        for axis in (1, 0):
            xy = block.photo_points.xy.copy()
            xy[mine, axis] *= -1.0
            points = replace(block.photo_points, xy=xy)
            changed = replace(block, photo_points=points)
            yield Hypothesis("mirrored", where, changed, plainly(_mirrored(camera, axis)), stay_near)
    for pair in _exchanged(block):
        one, other = (block.photos[k].name for k in pair)
        order = np.arange(len(block.photos))
        order[list(pair)] = pair[::-1]
        points = replace(block.photo_points, photo=order[block.photo_points.photo])
        text = (
            f"photos {one} and {other} fit when they are exchanged: what is measured under one name was measured in "
            "the other; exchange the names in the POINTS lines, or the preliminary orientations"
        )
        changed = replace(block, photo_points=points)
        yield Hypothesis("exchanged-photos", "", changed, plainly(text), partial(_are_in_place, pair=pair))
    for factor in ANGLE_UNITS:
        orientation = block.photo_orientation * [1.0, 1.0, 1.0, factor, factor, factor]
        changed = replace(block, photo_orientation=orientation)
        near = partial(_is_near, given=block.photo_orientation[:, 3:], factor=factor)
        yield Hypothesis("angle-unit", "orip.toml", changed, plainly(angle_unit_text(factor)), near)


def _is_near(solved: SolvedBlock, given: FloatArray, factor: float) -> bool:
    return is_nearer(given, factor, solved.state.rotations)


def stay_near(solved: SolvedBlock) -> bool:
    """Tell whether photos are where they were given, for the most part and as far as the distance to their points goes.

    A block adjusts itself to control of any scale; where its photos stood tells which is right.
    """
    state, points = solved.state, solved.block.photo_points
    moved = np.linalg.norm(state.centres - solved.block.photo_orientation[:, :3], axis=1)
    distance = np.linalg.norm(state.points[points.point] - state.centres[points.photo], axis=1)
    return bool(np.median(moved) < _NEAR * np.median(distance))


def _are_in_place(solved: SolvedBlock, pair: tuple[int, int]) -> bool:
    """Tell whether two photos are nearer to their own preliminary rotations than to each other's."""
    start = rotation_from_angles(solved.block.photo_orientation[list(pair), 3:])
    traces = np.einsum("iab,jab->ij", start, solved.state.rotations[list(pair)])
    return bool(traces[0, 0] > traces[1, 0] and traces[1, 1] > traces[0, 1])


def _mirrored(camera: Camera, axis: int) -> str:
    if axis == 1 and camera.sensor is not None:
        return (
            f"the photos fit as mirror images: pixel rows seem to count upwards; rows count down from the upper edge "
            f"(write {camera.sensor.rows} - row)"
        )
    if camera.sensor is not None:
        return (
            "the photos fit as mirror images: pixel columns seem to count from the right; columns count from the left "
            f"edge (write {camera.sensor.columns} - column)"
        )
    sign = "y seems to count downwards" if axis == 1 else "x seems to count to the left, as on film seen from its back"
    return f"the photos fit as mirror images: {sign}; reverse it, or name the fiducial marks as the camera has them"


def _exchanged(block: Block) -> list[tuple[int, int]]:
    """Return pairs of photos that fit their preliminary orientations better when they are exchanged, the best first.

    Looked at are the directions from the photos to the points whose coordinates are given.
    """
    points, given = block.photo_points, given_coordinates(block)
    # a place that is given in part has none in the frame
    given[np.isnan(given).any(axis=1)] = np.nan
    start = np.where(np.isnan(block.point_start), block.ground.to_local(given), block.point_start)
    vectors = image_vectors(block)
    vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    rotations = rotation_from_angles(block.photo_orientation[:, 3:])

    def deviation(rows: NDArray[np.bool_], photo: int) -> float:
        """Return the typical angle between rays and points when what was measured is taken for a photo."""
        offset = start[points.point[rows]] - block.photo_orientation[photo, :3]
        cosine = np.einsum("ij,ij->i", vectors[rows] @ rotations[photo].T, offset) / np.linalg.norm(offset, axis=1)
        known = np.isfinite(cosine)
        return float(np.median(np.arccos(np.clip(cosine[known], -1.0, 1.0)))) if known.any() else np.nan

    measured = [points.photo == photo for photo in range(len(block.photos))]
    own = np.array([deviation(rows, photo) for photo, rows in enumerate(measured)])
    worst = np.argsort(-np.nan_to_num(own), kind="stable")[:_WORST_PHOTOS].tolist()
    better: dict[tuple[int, int], float] = {}
    for i, j in combinations(sorted(worst), 2):
        exchanged = deviation(measured[i], j), deviation(measured[j], i)
        if (gain := own[i] + own[j] - sum(exchanged)) > 0.0:
            better[i, j] = gain
    return sorted(better, key=lambda pair: -better[pair])[:_PAIRS]
