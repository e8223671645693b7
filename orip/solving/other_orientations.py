"""Photos of few points that fit as well in another place: which of them is right cannot be told from the data.

Three points are seen as measured from up to four places (Grunert 1841), and four or five, hardly less well, from a
second one where they lie on a plane or the photo is near the cylinder on which three points determine it badly. The
adjustment ends at one of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.bundle.results.ground import adjusted_photos, adjusted_points
from orip.bundle.results.unchecked_photos import unchecked_photos
from orip.bundle.solve import SolvedBlock, iteration_settings, solve_block
from orip.bundle.unknowns import CONSTANT
from orip.bundle.verdict import OTHER_ORIENTATION
from orip.errors import NotSolvableError
from orip.geometry.rotation import angles_from_rotation
from orip.interior.image_coordinates import are_equidistant, image_vectors, suit_plane_image
from orip.mistakes.hypothesis import DECIDED
from orip.number_text import measure
from orip.progress import stage
from orip.records.block import Block
from orip.records.results.solution import Diagnosis
from orip.structs import replace
from orip.wording import joined

_FEWEST, _FEW = 3, 6
"""Points of a photo of which other places are looked for; more seldom leave a second one."""

_EXACT = 1e-3
"""Factor of errors with which three points determine all orientations, also those that no adjustment would start at."""

_ELSEWHERE = 5.0
"""Standard deviations of the projection centre: what is nearer is the same place."""

_MOST_TRIED = 10
"""Most adjustments from other places."""

_MOST_PHOTO_POINTS = 20_000
"""Most photo points of a block that is adjusted again, as elsewhere."""


class _OtherPlace(Struct, frozen=True):
    """A place from which the points of a photo, a row of the block, are seen nearly as measured."""

    photo: int
    points: int
    rotation: FloatArray
    centre: FloatArray


@stage("looking for other places of photos")
def other_orientations(solved: SolvedBlock) -> list[Diagnosis]:
    """Name the photos of few points that fit as well in another place."""
    few = _photos_of_few_points(solved)
    if not (solved.converged and few):
        return []
    deviations = np.linalg.norm(adjusted_photos(solved).sd[:, :3], axis=1)
    unchecked = {photo.photos[0]: photo.points for photo in unchecked_photos(solved) if len(photo.photos) == 1}
    trials, found = _MOST_TRIED, dict[int, list[_OtherPlace]]()
    for place in _other_places(solved, [row for row in few if row in unchecked or _is_free(solved, row)]):
        limit = _ELSEWHERE * float(deviations[place.photo])
        if not _distance(solved, place.photo, place.centre) > limit:
            continue
        # three points that nothing checks always fit
        if unchecked.get(place.photo) != _FEWEST:
            trials -= 1
            if trials < 0 or not _fits(solved, place, limit):
                continue
        found.setdefault(place.photo, []).append(place)
    return [_diagnosis(solved, places, float(deviations[photo])) for photo, places in found.items()]


def _photos_of_few_points(solved: SolvedBlock) -> list[int]:
    points = solved.block.photo_points
    used = np.bincount(points.photo[points.in_use], minlength=len(solved.block.photos))
    return np.flatnonzero((used >= _FEWEST) & (used <= _FEW)).tolist()


def _is_free(solved: SolvedBlock, photo: int) -> bool:
    """Tell whether all elements of a photo are unknowns of its own."""
    return bool((solved.problem.unknowns.photos[photo] != CONSTANT).all())


def _other_places(solved: SolvedBlock, photos: Iterable[int]) -> Iterator[_OtherPlace]:
    """Yield the orientations of photos of few points by these alone."""
    from orip.prelim.resection.resection import Resected, resect

    block, state = solved.block, solved.state
    points = block.photo_points
    deviations = np.nan_to_num(adjusted_points(solved).sd, nan=0.0, posinf=np.nan)
    for photo in photos:
        rays = _rays(solved, photo)
        of_photo = points.of(rays)
        number = len(np.unique(of_photo.point))
        if number < max(len(rays), _FEWEST):  # a point measured twice is one point
            continue
        vectors = image_vectors(_adjusted_cameras(solved, rays))
        if not np.isfinite(vectors).all():
            continue
        error, deviation = float(np.median(of_photo.error)), deviations[of_photo.point].max(axis=1)
        if number == _FEWEST:  # they fit exactly, and all orientations are wanted, however weak
            error, deviation = _EXACT * error, np.zeros(number)
        resected = resect(vectors, state.points[of_photo.point], deviation, error_mm=error)
        if isinstance(resected, Resected):
            yield _OtherPlace(photo, number, resected.rotation, resected.centre)
            for rotation, centre in zip(*resected.alternatives, strict=True):
                yield _OtherPlace(photo, number, rotation, centre)


def _rays(solved: SolvedBlock, photo: int) -> IntArray:
    """Return the photo points of a photo that are used and suit a plane image."""
    points = solved.block.photo_points
    rays = np.flatnonzero((points.photo == photo) & points.in_use & ~solved.state.left_out[points.point])
    some = replace(solved.block, photo_points=points.of(rays))
    return rays[suit_plane_image(image_vectors(some), are_equidistant(some))]


def _adjusted_cameras(solved: SolvedBlock, rays: IntArray) -> Block:
    """Return the block with adjusted cameras and some of its photo points."""
    cameras = tuple(
        replace(camera, parameters=tuple(values))
        for camera, values in zip(solved.block.cameras, solved.state.cameras.tolist(), strict=True)
    )
    return replace(solved.block, cameras=cameras, photo_points=solved.block.photo_points.of(rays))


def _distance(solved: SolvedBlock, photo: int, centre: FloatArray) -> float:
    return float(np.linalg.norm(solved.state.centres[photo] - centre))


def _fits(solved: SolvedBlock, place: _OtherPlace, limit: float) -> bool:
    """Tell whether the block, adjusted from another place of a photo, stays there and fits hardly worse."""
    block, state = solved.block, solved.state
    if len(block.photo_points.photo) > _MOST_PHOTO_POINTS:
        return False
    orientation = np.hstack([state.centres, angles_from_rotation(state.rotations)])
    orientation[place.photo] = [*place.centre, *angles_from_rotation(place.rotation[None])[0]]
    points = np.where(block.constant_points, block.point_start, state.points)
    start = replace(block, photo_orientation=orientation, point_start=points)
    settings = replace(iteration_settings(block.definition), most_attempts=0)
    try:
        other = solve_block(start, lambda _: None, lambda: False, settings)
    except (NotSolvableError, np.linalg.LinAlgError):
        return False
    cost, other_cost = (solved.weighing.cost(equations) for equations in (solved.equations, other.equations))
    worse = (other_cost - cost) / max(1.0, solved.deviation_scale) ** 2
    return (
        other.converged and worse < DECIDED and _distance(solved, place.photo, other.state.centres[place.photo]) > limit
    )


def _diagnosis(solved: SolvedBlock, places: list[_OtherPlace], deviation: float) -> Diagnosis:
    """Return what is said of a photo that fits in other places, too; `deviation` is that of its centre."""
    name = solved.block.photos[places[0].photo].name
    centres = solved.block.ground.to_project(np.array([place.centre for place in places]))
    where = joined([" ".join(measure(value, deviation) for value in centre) for centre in centres.tolist()], "or")
    text = f"the {places[0].points} points of photo {name} are seen as well from {where}: which is right cannot be told"
    return Diagnosis(OTHER_ORIENTATION, f"photo {name}", text, "measure more points in this photo")
