"""Photos under other names: of another lens, another camera, two exchanged, or of another flight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.antennas import without_photos, without_unused_cameras
from orip.bundle.points.starting import given_coordinates
from orip.bundle.solve import SolvedBlock
from orip.bundle.verdict import group_findings
from orip.errors import ProjectWarning
from orip.geometry.rotation import rotation_from_angles
from orip.interior.image_coordinates import image_vectors
from orip.mistakes.camera_values import other_principal_distance, with_unknown
from orip.mistakes.free_network import free_network
from orip.mistakes.hypothesis import DECIDED, Fit, Hypothesis, Readjuster, finding, fit_of_adjustment, is_good
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.records.solution import Solution
from orip.structs import replace
from orip.wording import counted_names

# Another principal distance moves photos up or down, as a strip of wrong heights would be: that they are of another
# lens shows where the points fit better with it than without any of the positions that are accused.

TWO_LENSES = "two-lenses"

OF_TWO_LENSES = "photos of one camera were taken with two lenses, or zoom positions"
"""What the status says."""

_POSITIONS = ("station", "element")

_FITS = 4.0
"""Standard errors within which an observation fits."""

_FEWEST_PHOTOS_OF_A_LENS = 3
"""Photos of each lens."""

_PART = 0.7
"""Part of the photos of a camera that fits badly at most: else all of it is wrong."""

_EXPLAINED = 0.2
"""Part of the photos that fit badly that still do with a camera of their own, at most."""

_BETTER = 3.0
"""Standard deviations by which the sum of squares is smaller at least with a second camera."""

_OF_A_PHOTO = 15.0
"""What the positions of one photo may add to the sum of squares after they have lost most of their weight."""

_DIFFERENT, _SIGNIFICANT = 0.002, 5.0
"""Least difference of the two principal distances, as a part of these and in standard deviations."""


def two_lenses(solution: Solution, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return that photos have another lens than their camera, if they fit with one of their own.

    Parameters
    ----------
    solution : Solution
    readjuster : Readjuster
        Of the block as gathered.
    """
    if not readjuster.is_small:
        return []
    block, accused = readjuster.block, _with_wrong_positions(solution)
    if len(accused) < _FEWEST_PHOTOS_OF_A_LENS:
        return []
    for camera, rows in _groups(block, accused):
        solved = readjuster.adjust(_with_second_camera(block, camera, rows))
        if solved is None or not is_good(fit_of_adjustment(solved)):
            continue
        left = _still_wrong(fit_of_adjustment(solved))
        explains = left <= _EXPLAINED * len(accused) and _fits_better(solution, solved, len(accused))
        if explains and (text := _text(solved, block, camera)):
            where = counted_names("photo", [block.photos[row].name for row in rows.tolist()])
            return [ProjectWarning(TWO_LENSES, where, text)]
    return []


def _with_wrong_positions(solution: Solution) -> set[str]:
    """Return the `record_key` of photos whose observed position has lost weight."""
    rows = solution.residuals
    return {
        record_key(photo)
        for kind, photo, weight in zip(rows.kind, rows.photo, rows.weight_factor.tolist(), strict=True)
        if photo and kind in _POSITIONS and weight < 1.0
    }


def _still_wrong(fit: Fit) -> int:
    """Return of how many photos the positions do not fit."""
    kind, photo = fit.columns[0], fit.columns[1]
    wrong = kind.where(lambda name: name in _POSITIONS) & (fit.standard > _FITS)
    return len(np.unique(photo.codes[wrong]))


def _groups(block: Block, accused: set[str]) -> Iterator[tuple[int, IntArray]]:
    """Yield cameras with the rows of their accused photos, where these are not nearly all."""
    is_accused = np.array([record_key(photo.name) in accused for photo in block.photos])
    for camera in range(len(block.cameras)):
        own = block.photo_camera == camera
        rows = np.flatnonzero(own & is_accused)
        if (
            _FEWEST_PHOTOS_OF_A_LENS
            <= len(rows)
            <= min(_PART * np.count_nonzero(own), np.count_nonzero(own) - _FEWEST_PHOTOS_OF_A_LENS)
        ):
            yield camera, rows


def _with_second_camera(block: Block, camera: int, rows: IntArray) -> Block:
    """Return a block in which photos have a camera of their own, the principal distances of both being unknown."""
    changed = with_unknown(block, camera, "C")
    second = replace(changed.cameras[camera], name=f"{block.cameras[camera].name}_2")
    photo_camera = block.photo_camera.copy()
    photo_camera[rows] = len(block.cameras)
    return replace(changed, cameras=(*changed.cameras, second), photo_camera=photo_camera)


def _fits_better(solution: Solution, solved: SolvedBlock, accused: int) -> bool:
    """Tell whether the observations that keep their weight fit better, and not the positions of photos alone."""
    gained = (solution.sigma0**2 - solved.variance.sigma0**2) * solution.redundancy_used
    return gained > max(_BETTER * float(np.sqrt(2.0 * solution.redundancy_used)), _OF_A_PHOTO * accused)


def _text(solved: SolvedBlock, block: Block, camera: int) -> str:
    """Return what the two principal distances are; "" where they hardly differ."""
    places = [camera, len(solved.block.cameras) - 1]
    one, other = (float(solved.state.cameras[place, 0]) for place in places)
    columns = np.array([int(solved.problem.unknowns.cameras[place, 0]) for place in places])
    cofactors = solved.cofactors_of(columns)
    sd = solved.deviation_scale * np.sqrt(np.diag(cofactors))
    of_difference = solved.deviation_scale * float(np.sqrt([1.0, -1.0] @ cofactors @ [1.0, -1.0]))
    if abs(one - other) < max(_DIFFERENT * one, _SIGNIFICANT * of_difference):
        return ""
    name = block.cameras[camera].name
    return (
        f"they fit with C = {other:.5g} ± {sd[1]:.1g} mm, the other photos of camera {name} with {one:.5g} ± "
        f"{sd[0]:.1g} mm: they seem to be taken with another lens, zoom or focus; define a second [[camera]] in "
        "orip.toml and name it in these photos"
    )


# A flat block fits with nearly any principal distance, only higher or lower: heights of stations, a little relief or
# other photos show it, and tests of groups then accuse the camera or, as often, the stations.

_OTHER_LENS = 0.05
"""Difference of principal distances, as a part of these, that is another lens and not another calibration."""

_HEIGHT_SYSTEMS = 120.0
"""Ground units that photos have to rise or sink by: heights in another system bend a flat block like another lens."""


def lens_of_doubted_camera(solution: Solution, solved: SolvedBlock, readjuster: Readjuster) -> list[ProjectWarning]:
    """Return that photos have another lens than their camera, where groups that contradict accuse camera or stations.

    Parameters
    ----------
    solution : Solution
    solved : SolvedBlock
        The adjustment that it comes from.
    readjuster : Readjuster
        Of the block as gathered.
    """
    found = group_findings(solution)
    of_stations = any("exposure station" in each.where for each in found)
    if not (readjuster.is_worthwhile and (of_stations or any("camera" in each.where for each in found))):
        return []
    block = readjuster.block
    for row, camera in enumerate(block.cameras):
        if "C" in camera.unknown or not (of_stations or any(f"camera {camera.name}" in each.where for each in found)):
            continue
        photos = [photo.name for photo, of in zip(block.photos, block.photo_camera, strict=True) if of == row]
        hypotheses = [*other_cameras(block, photos if len(photos) == 1 else ()), *other_principal_distance(block, row)]
        for hypothesis in hypotheses:
            tried = readjuster.adjust(hypothesis.block)
            if tried is not None and _is_other_lens(tried, solved, row, photos, of_stations=of_stations):
                return list(hypothesis.findings(tried))
    return []


def _is_other_lens(
    tried: SolvedBlock, solved: SolvedBlock, row: int, photos: Sequence[str], *, of_stations: bool
) -> bool:
    """Tell whether a block fits decidedly better with a far different principal distance of some photos."""
    if not (tried.converged and is_good(fit_of_adjustment(tried))):
        return False
    weighing = solved.weighing
    if not weighing.cost(solved.equations) - weighing.cost(tried.equations) > DECIDED:
        return False
    place = [photo.name for photo in tried.block.photos].index(photos[0])
    given = solved.state.cameras[row, 0]
    other = tried.state.cameras[tried.block.photo_camera[place], 0]
    moved = np.linalg.norm(tried.state.centres[place] - solved.state.centres[place])
    return bool(abs(other - given) > _OTHER_LENS * given and (moved > _HEIGHT_SYSTEMS or not of_stations))


def other_cameras(block: Block, photos: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield photos with every other camera of the project that, like their own, has a sensor or has none.

    Parameters
    ----------
    block : Block
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
            yield Hypothesis(changed, finding("other-camera", f"photo {name}", text))


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


def another_flight(block: Block, not_oriented: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield the photos that could not be oriented in the block as a free network of their own.

    Parameters
    ----------
    block : Block
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
    yield Hypothesis(free, finding("another-flight", counted_names("photo", list(not_oriented)), text))
