"""The answer to a request, how a photo point stands and what has changed, and what to measure next."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.points.starting import given_coordinates
from orip.geometry.rotation import rotation_from_angles
from orip.interior.mounting import frame_corners
from orip.online.answers import Answer, Candidate, Suspect, words_of
from orip.online.block.current_values import CurrentValues
from orip.online.block.online_block import OnlineBlock
from orip.online.sequential.hyper_rows import ObservationRows, factored
from orip.online.sequential.observation_rows import ObservationKey
from orip.online.snooping import Snooping
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.structs import replace

# A further observation with the equations a, divided by its errors, multiplies the determinant of the normal equations
# by det(I + a N^-1 a^T). Half of its binary logarithm is the information that the observation gives, in bits (Lindley
# 1956, *On a measure of the information provided by an experiment*): it is large where coordinates are imprecise, where
# observations are unchecked, and where the datum is weak.

_MOST_OF_A_PHOTO = 12
"""Points of a photo whose gain is computed: those with the fewest rays."""

_CELLS = 3
"""Parts along each side of a photo, each of which should have a point: those of von Gruber."""

_PAIR = 2
"""Coordinates of a photo point."""

_COMMON = 2
"""Points that are common to two photos from which one tells where the other's points are expected."""

_LEAST_GAIN = 0.05
"""Bits below which a measurement tells nothing: rounded they are 0.0."""

_INSIDE = 0.95
"""Part of the frame within which a point is expected to be measurable."""


def advice(block: OnlineBlock, photos: Collection[str], most: int) -> tuple[Candidate, ...]:
    """Return what to measure next in some photos, the most profitable first.

    Parameters
    ----------
    photos : collection of str
        In which something is measured.
    most : int
        Candidates that are returned.
    """
    found: list[Candidate] = []
    for photo in photos:
        if photo in block.values.orientations:
            rays = list(_further_rays(block, photo))
            found += [*rays, *_empty_parts(block, photo, rays)]
        else:
            found += _known_points(block, photo)
    worth = (one for one in found if one.gain is None or one.gain >= _LEAST_GAIN)
    return tuple(sorted(worth, key=lambda one: -(one.gain or 0.0))[:most])


def _further_rays(block: OnlineBlock, photo: str) -> Iterator[Candidate]:
    """Yield the points that an oriented photo should show."""
    measurements = block.measurements
    expected = _expected(block, photo)
    names = sorted(expected, key=lambda name: (len(measurements.photos_of(name)), name))[:_MOST_OF_A_PHOTO]
    part = measurements.as_if((photo, name, expected[name]) for name in names)
    if part is None:
        return
    rows = block.linearised(_at_values(block, part))
    rays = {name: rows[key] for name in names if (key := ObservationKey("photo", photo, name)) in rows}
    equations = [_of_reduced(block, name, ray, rows) for name, ray in rays.items()]
    errors = dict(zip((part.point_names[row] for row in part.photo_points.point), part.photo_points.error, strict=True))
    for name, (difference, cofactor, _) in zip(rays, block.equations.predicted(equations), strict=True):
        gain = 0.5 * float(np.log2(np.linalg.det(np.eye(len(cofactor)) + cofactor))) if len(cofactor) else 0.0
        covariance, xy = (
            cofactor * np.outer(errors[name], errors[name]) if len(cofactor) == _PAIR else None,
            expected[name],
        )
        if not block.equations.has_point(name):
            covariance = predicted_covariances(block, [photo], name).get(photo)
        else:
            # as if measured where the values have it; the solution is somewhere else by as much as is still linear
            xy = _moved(block, photo, xy, -difference * errors[name])
        ellipse = None if covariance is None else _ellipse(covariance)
        yield Candidate(photo, name, xy, ellipse, gain, _why(block, name))


def _moved(block: OnlineBlock, photo: str, stored: tuple[float, float], by: FloatArray) -> tuple[float, float]:
    """Return stored coordinates of a place in a photo that is moved, mm."""
    to_photo = block.measurements.inputs.interior.to_photo[record_key(photo)]
    return _stored(block, photo, {"": to_photo.apply(np.array([stored]))[0] + by})[""]


def _why(block: OnlineBlock, name: str) -> str:
    rays = len(block.measurements.photos_of(name))
    if not rays:
        return "control that is not measured yet"
    if rays == 1:
        return "a second ray places it"
    return "a third ray checks it" if rays == 2 else "one more ray"


def _of_reduced(
    block: OnlineBlock, name: str, ray: ObservationRows, rows: Mapping[ObservationKey, ObservationRows]
) -> ObservationRows:
    """Return the equations of a ray; of a point that is not in, what they say with its control about the others."""
    if block.equations.has_point(name):
        return ray
    control = [other for key, other in rows.items() if key.point == name and key.kind != "photo"]
    _, reduced = factored([*control, ray])
    return ObservationRows(None, np.zeros((len(reduced.right), 3)), reduced.columns, reduced.rows, reduced.right)


def _at_values(block: OnlineBlock, part: Block) -> Block:
    """Return a block at the session's values, points that have none at their given coordinates."""
    started = block.values.started(part)
    start = started.point_start.copy()
    missing = np.isnan(start).any(axis=1)
    start[missing] = part.ground.to_local(given_coordinates(part)[missing])
    return replace(started, point_start=start)


def _expected(block: OnlineBlock, photo: str) -> dict[str, tuple[float, float]]:
    """Return by name the stored coordinates at which an oriented photo should show points that it lacks."""
    measurements = block.measurements
    mine = set(measurements.points_in(photo))
    near = {name for other in measurements.sharing(mine) for name in measurements.points_in(other)}
    tied = {name for name in near - mine if name in block.values.points}
    control = {
        name
        for name in measurements.control.points
        if not measurements.photos_of(name) and measurements.control.has_coordinates(name)
    }
    names, places = sorted(tied), [block.values.points[name] for name in sorted(tied)]
    for name, place in given_places(block, sorted(control - tied), photo).items():
        names.append(name)
        places.append(place)
    if not names:
        return {}
    camera, orientation = _camera(block, photo), block.values.orientations[photo]
    rays = (np.array(places) - orientation[:3]) @ rotation_from_angles(orientation[None, 3:])[0]
    c, dx, dy = block.values.cameras.get(camera.name, camera.parameters)[:3]
    with np.errstate(all="ignore"):
        xy = -c * rays[:, :2] / rays[:, 2:] + (dx, dy)
    seen = (rays[:, 2] * c < 0.0) & _is_inside(camera, xy)
    return _stored(block, photo, {names[row]: xy[row] for row in np.flatnonzero(seen).tolist()})


def given_places(block: OnlineBlock, points: Collection[str], photo: str = "") -> dict[str, FloatArray]:
    """Return the local coordinates (3,) of points that have all of them by control.

    Parameters
    ----------
    photo : str
        Any that is oriented, empty: the first one.
    """
    measurements, oriented = block.measurements, photo or next(iter(block.values.orientations), "")
    known = [name for name in points if measurements.control.has_coordinates(name)] if oriented else []
    part = measurements.as_if((oriented, name, (0.0, 0.0)) for name in known)
    if part is None:
        return {}
    # with the other ends of distances, which are not asked for
    places = dict(zip(part.point_names, _at_values(block, part).point_start, strict=True))
    return {name: places[name] for name in known if np.isfinite(places[name]).all()}


def predicted_covariances(block: OnlineBlock, photos: Collection[str], point: str) -> dict[str, FloatArray]:
    """Return the covariances (2, 2), mm², of the places at which oriented photos are expected to show a point.

    Those in which it is measured are left out, and those of which nothing can be said.
    """
    lacking = [photo for photo in photos if block.measurements.at(photo, point) is None]
    part = block.measurements.as_if((photo, point, (0.0, 0.0)) for photo in lacking)
    if part is None:
        return {}
    rows = block.linearised(_at_values(block, part))
    rays = {photo: rows[key] for photo in lacking if (key := ObservationKey("photo", photo, point)) in rows}
    by_control: FloatArray = np.zeros((3, 3))
    if not block.equations.has_point(point):
        control = [other.by_point for key, other in rows.items() if key.point == point and key.kind != "photo"]
        information = sum((one.T @ one for one in control), np.zeros((3, 3)))
        if np.linalg.matrix_rank(information) < len(information):
            return {}
        by_control = np.asarray(np.linalg.inv(information), dtype=np.float64)
    equations = [
        ray
        if not by_control.any()
        else ObservationRows(None, np.zeros((_PAIR, 3)), ray.columns, ray.by_reduced, ray.right)
        for ray in rays.values()
    ]
    errors = dict(zip((part.photos[row].name for row in part.photo_points.photo), part.photo_points.error, strict=True))
    return {
        photo: (cofactor + ray.by_point @ by_control @ ray.by_point.T) * np.outer(errors[photo], errors[photo])
        for (photo, ray), (_, cofactor, is_open) in zip(rays.items(), block.equations.predicted(equations), strict=True)
        if len(cofactor) == _PAIR and not is_open.any()
    }


def _stored(block: OnlineBlock, photo: str, places: Mapping[str, FloatArray]) -> dict[str, tuple[float, float]]:
    """Return stored coordinates of places in a photo, mm."""
    if not places:
        return {}
    to_photo = block.measurements.inputs.interior.to_photo[record_key(photo)]
    stored = to_photo.inverse().apply(np.array(list(places.values())))
    return {name: (float(x), float(y)) for name, (x, y) in zip(places, stored, strict=True)}


def _is_inside(camera: Camera, xy: FloatArray) -> FloatArray:
    corners = frame_corners(camera)
    if corners is None:
        return np.asarray(np.isfinite(xy).all(axis=1))
    lower, upper = (_INSIDE * corner for corner in corners)
    return np.asarray((xy >= lower).all(axis=1) & (xy <= upper).all(axis=1))


def _camera(block: OnlineBlock, photo: str) -> Camera:
    records = block.measurements.inputs.records
    return records.camera_of(records.photos[record_key(photo)])


def _photo_mm(block: OnlineBlock, photo: str, points: Collection[str]) -> FloatArray:
    """Return photo coordinates (n, 2) of measured points, mm."""
    stored = [xy for name in points if (xy := block.measurements.at(photo, name)) is not None]
    to_photo = block.measurements.inputs.interior.to_photo[record_key(photo)]
    return to_photo.apply(np.array(stored, dtype=np.float64).reshape(-1, 2))


def _empty_parts(block: OnlineBlock, photo: str, rays: Collection[Candidate]) -> Iterator[Candidate]:
    """Yield the middles of the parts of an oriented photo that have no point, and none that could be measured."""
    corners = frame_corners(_camera(block, photo))
    if corners is None:
        return
    to_photo = block.measurements.inputs.interior.to_photo[record_key(photo)]
    measured = _photo_mm(block, photo, block.measurements.points_in(photo))
    expected = to_photo.apply(np.array([ray.xy for ray in rays], dtype=np.float64).reshape(-1, 2))
    size = (corners[1] - corners[0]) / _CELLS
    places = np.floor((np.vstack([measured, expected]) - corners[0]) / size)
    taken = {(int(x), int(y)) for x, y in places}
    for x in range(_CELLS):
        for y in range(_CELLS):
            if (x, y) not in taken:
                place = _stored(block, photo, {"": corners[0] + size * (np.array([x, y]) + 0.5)})[""]
                yield Candidate(photo, "", place, None, None, "no point is measured in this part of the photo")


def _known_points(block: OnlineBlock, photo: str) -> Iterator[Candidate]:
    """Yield known points of a photo that waits, where a photo with common points has them."""
    measurements = block.measurements
    mine = set(measurements.points_in(photo))
    common = {
        other: sorted(mine.intersection(measurements.points_in(other)))
        for other in measurements.sharing(mine)
        if other in block.values.orientations
    }
    if not common:
        return
    best = max(common, key=lambda other: (len(common[other]), other))
    known = [name for name in measurements.points_in(best) if name not in mine and name in block.values.points]
    if len(common[best]) < _COMMON or not known:
        return
    there, here = (_photo_mm(block, name, common[best]) @ [1.0, 1.0j] for name in (best, photo))
    turn, shift = np.linalg.lstsq(np.column_stack([there, np.ones(len(there))]), here, rcond=None)[0]
    place = turn * (_photo_mm(block, best, known) @ [1.0, 1.0j]) + shift
    xy = np.column_stack([place.real, place.imag])
    inside = _is_inside(_camera(block, photo), xy)
    expected = {name: at for name, at, seen in zip(known, xy, inside, strict=True) if seen}
    for name, stored in _stored(block, photo, expected).items():
        yield Candidate(photo, name, stored, None, None, "a known point: the photo waits for these")


def _ellipse(covariance: FloatArray) -> tuple[float, float, float]:
    """Return semi-axes of the standard ellipse of a position, and the direction of the larger one, degrees from x."""
    values, vectors = np.linalg.eigh(covariance)
    minor, major = np.sqrt(np.clip(values, 0.0, None))
    return float(major), float(minor), float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180.0)


class Before(Struct, frozen=True):
    """What there was before a request, as far as an answer tells of changes."""

    sigma0: float | None
    suspects: tuple[ObservationKey, ...]
    oriented: frozenset[str]
    placed: frozenset[str]


class Request(Struct):
    """A request that has been answered, and what is left of it to be done.

    Parameters
    ----------
    key : ObservationKey
        The photo point that it is about.
    points : dict of str
        Points that may have moved.
    new : list of ObservationKey
        Observations that it has taken in.
    is_tested : bool
        Whether nothing more is to be found by testing what these concern.
    """

    key: ObservationKey
    before: Before
    answer: Answer
    points: dict[str, None]
    new: list[ObservationKey]
    is_tested: bool
    has_oriented: bool


def answer_now(
    key: ObservationKey,
    before: Before,
    snooping: Snooping,
    excluded: Collection[ObservationKey],
    advised: tuple[Candidate, ...],
) -> Answer:
    """Return how a photo point stands, with what has changed since before a request and what to measure next."""
    block, suspects = snooping.block, snooping.suspects
    values, included = block.values, block.equations.included
    answer = Answer(
        key.photo, key.point, "waiting", "",
        sigma0=block.sigma0,
        sigma0_before=before.sigma0,
        suspects=tuple(one for other, one in suspects.items() if other not in before.suspects),
        cleared=tuple(other for other in before.suspects if other in included),
        oriented=tuple(photo for photo in values.orientations if photo not in before.oriented),
        placed=tuple(point for point in values.points if point not in before.placed),
        next=advised,
    )  # fmt: skip
    if key in excluded:
        return replace(answer, state="excluded", text=f"{words_of(key)} is left out by your decision")
    if key in suspects:
        suspect = suspects[key]
        text = f"{words_of(key)} does not fit: w {suspect.w:.1f}, limit {suspect.limit:.1f}{_also(suspect)}"
        return replace(answer, state="suspect", text=text, w=suspect.w, limit=suspect.limit)
    if key not in included:
        return replace(answer, text=_wait(values, key))
    standing = block.equations.standing(key)
    square, checked = standing.square()
    redundancy = tuple(float(value) for value in standing.redundancy)
    if not checked:
        return replace(answer, state="unchecked", text=f"{words_of(key)} is not checked yet", redundancy=redundancy)
    w, limit = float(np.sqrt(square)), snooping.scale.limit(checked)
    answer = replace(answer, w=w, limit=limit, redundancy=redundancy)
    if checked < len(redundancy):
        return replace(answer, state="unchecked", text=f"{words_of(key)} is checked in one direction only")
    return replace(answer, state="included", text=f"{words_of(key)} fits: w {w:.1f}, limit {limit:.1f}")


def is_news(answer: Answer, before: Answer) -> bool:
    """Return whether an answer says more than the one before it, figures apart."""

    def said(one: Answer) -> tuple[object, ...]:
        return one.state, one.is_pending, {other.key for other in one.suspects}, one.cleared, one.oriented, one.placed

    return said(answer) != said(before)


def _wait(values: CurrentValues, key: ObservationKey) -> str:
    """Return what a photo point waits for."""
    if key.photo not in values.orientations:
        return values.photos_wait.get(key.photo, f"photo {key.photo} waits: it is not oriented")
    return values.points_wait.get(key.point, f"point {key.point} waits: it has no coordinates")


def _also(suspect: Suspect) -> str:
    if not suspect.alike:
        return "; measure it again"
    names = ", ".join(map(words_of, suspect.alike))
    return f"; an error in {names} would look the same: measure these again, or the point in one more photo"
