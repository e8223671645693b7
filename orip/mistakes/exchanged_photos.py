"""Photos under other names: of another lens, another camera, two exchanged, or of another flight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.bundle.antennas import without_photos, without_unused_cameras
from orip.bundle.points.starting import given_coordinates
from orip.bundle.solve import SolvedBlock
from orip.geometry.rotation import rotation_from_angles
from orip.interior.image_coordinates import image_vectors
from orip.mistakes.control.free_network import free_network
from orip.mistakes.hypothesis import Hypothesis, finding
from orip.mistakes.mistake import BAD_START, MISPLACED_PHOTO, declare
from orip.records.block import Block
from orip.records.camera import Camera
from orip.structs import replace
from orip.wording import counted_names

OTHER_CAMERA = declare("other-camera", "", BAD_START, MISPLACED_PHOTO)


def other_cameras(block: Block, photos: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield photos with every other camera of the project that, like their own, has a sensor or has none.

    Parameters
    ----------
    photos : sequence of str
        Those that do not fit.
    """
    rows = {photo.name: row for row, photo in enumerate(block.photos)}
    for name in photos:
        own = block.cameras[block.photo_camera[rows[name]]]
        for camera in block.defined_cameras:
            if camera.name == own.name or (camera.sensor is None) != (own.sensor is None):
                continue
            text = (
                f"it fits with camera {camera.name}, and not with {own.name}; write "
                f'camera = "{camera.name}" in its [[photo]]'
            )
            changed = _with_camera_of_photo(block, rows[name], camera)
            yield Hypothesis(changed, finding(OTHER_CAMERA, f"photo {name}", text))


def _with_camera_of_photo(block: Block, photo: int, camera: Camera) -> Block:
    names = [known.name for known in block.cameras]
    cameras = block.cameras if camera.name in names else (*block.cameras, camera)
    photo_camera = block.photo_camera.copy()
    photo_camera[photo] = [known.name for known in cameras].index(camera.name)
    return without_unused_cameras(replace(block, cameras=cameras, photo_camera=photo_camera))


_WORST_PHOTOS = 12
"""Most photos among which an exchanged pair is sought."""

_PAIRS = 3
"""Most pairs that are tried: preliminary orientations are rough."""


def exchanged_photos(block: Block) -> Iterator[Hypothesis]:
    """Yield the pairs of photos that fit their preliminary orientations better when they are exchanged."""
    for pair in _likely_pairs(block):
        one, other = (block.photos[k].name for k in pair)
        order = np.arange(len(block.photos))
        order[list(pair)] = pair[::-1]
        changed = replace(block, photo_points=replace(block.photo_points, photo=order[block.photo_points.photo]))
        text = (
            f"photos {one} and {other} fit when they are exchanged: what is measured under one name was measured in "
            "the other; exchange the names in the POINTS lines, or the preliminary orientations"
        )
        holds = partial(_are_in_place, pair=pair)
        yield Hypothesis(changed, finding("exchanged-photos", "", text), holds, concerns_start=True)


def _are_in_place(solved: SolvedBlock, pair: tuple[int, int]) -> bool:
    """Tell whether two photos are nearer to their own preliminary rotations than to each other's."""
    start = rotation_from_angles(solved.block.photo_orientation[list(pair), 3:])
    traces = np.einsum("iab,jab->ij", start, solved.state.rotations[list(pair)])
    return bool(traces[0, 0] > traces[1, 0] and traces[1, 1] > traces[0, 1])


def _likely_pairs(block: Block) -> list[tuple[int, int]]:
    """Return the pairs of photos with the largest gain in `_Directions.deviation` if exchanged, the best first."""
    directions = _Directions(block)
    own = np.array([directions.deviation(photo, photo) for photo in range(len(block.photos))])
    worst = np.argsort(-np.nan_to_num(own), kind="stable")[:_WORST_PHOTOS].tolist()
    gains: dict[tuple[int, int], float] = {}
    for i, j in combinations(sorted(worst), 2):
        exchanged = directions.deviation(i, j), directions.deviation(j, i)
        if (gain := own[i] + own[j] - sum(exchanged)) > 0.0:
            gains[i, j] = gain
    return sorted(gains, key=lambda pair: -gains[pair])[:_PAIRS]


class _Directions:
    """The directions from preliminary projection centres to points whose coordinates are given."""

    def __init__(self, block: Block) -> None:
        given = given_coordinates(block)
        # coordinates that are known only in part are no position in the frame
        given[np.isnan(given).any(axis=1)] = np.nan
        self._points = np.where(np.isnan(block.point_start), block.ground.to_local(given), block.point_start)
        vectors = image_vectors(block)
        self._vectors: FloatArray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        self._rotations = rotation_from_angles(block.photo_orientation[:, 3:])
        self._block = block

    def deviation(self, measured: int, photo: int) -> float:
        """Return the median angle (radians) between rays and points if what was measured in one photo is another's."""
        points = self._block.photo_points
        rows: BoolArray = points.photo == measured
        offset = self._points[points.point[rows]] - self._block.photo_orientation[photo, :3]
        along = np.einsum("ij,ij->i", self._vectors[rows] @ self._rotations[photo].T, offset)
        cosine = along / np.linalg.norm(offset, axis=1)
        known = np.isfinite(cosine)
        return float(np.median(np.arccos(np.clip(cosine[known], -1.0, 1.0)))) if known.any() else np.nan


_FEWEST_OF_A_FLIGHT, _FEWEST_SHARED = 2, 8
"""Photos that can fit each other, and points of the others that they share: with fewer they are not connected."""


ANOTHER_FLIGHT = declare("another-flight", "", BAD_START)


def another_flight(block: Block, not_oriented: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield the photos that could not be oriented in the block as a free network of their own.

    Parameters
    ----------
    not_oriented : sequence of str
        Names of these photos.
    """
    others = np.array([photo.name not in not_oriented for photo in block.photos])
    if not _FEWEST_OF_A_FLIGHT <= np.count_nonzero(~others) < np.count_nonzero(others):
        return
    points = block.photo_points
    of_others = np.unique(points.point[others[points.photo]])
    shared = np.intersect1d(of_others, np.unique(points.point[~others[points.photo]]))
    if len(shared) < _FEWEST_SHARED:
        return
    own = without_photos(block, others)
    cameras = tuple(replace(camera, unknown=()) for camera in own.cameras)
    free = free_network(replace(own, cameras=cameras))
    text = (
        f"they fit each other, but not the other photos, although they share {len(shared)} numbers of points with "
        "them: they seem to be of another flight or object whose numbers were used again; give its points other "
        "numbers, or leave its photos out"
    )
    yield Hypothesis(free, finding(ANOTHER_FLIGHT, counted_names("photo", list(not_oriented)), text))
