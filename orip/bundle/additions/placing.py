"""What helps most in a block: control or check points, distances, and further photos."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.bundle.additions.candidates import (
    Network,
    control_candidates,
    distance_candidates,
    network_of,
    photo_candidates,
)
from orip.bundle.additions.search import Candidate, Criterion, Placement, place, place_greedily
from orip.bundle.solve import SolvedBlock
from orip.errors import UsageError
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.control import ANGLES_ONLY_COMPARED, ONLY_COMPARED, ControlDistance, ControlPoint, Station
from orip.units import DEGREES_PER_RADIAN

What = Literal["control", "check", "distances", "photos"]

USUAL_ERROR = 0.01
"""Of coordinates and distances, ground unit, where nothing says what they are known to."""

_DECIMALS = 4

_MOST_PHOTOS = 200
"""Candidate photos: each is a hundred times the work of a control point."""


class Wanted(Struct, frozen=True):
    """What is to be placed.

    Parameters
    ----------
    what : {"control", "check", "distances", "photos"}
    criterion : {"largest", "mean", "camera"}
        Of the points at all places, or of C.
    places : int
        About so many points are judged.
    error : float
        A-priori, of the coordinates or distances.
    longest : float or None
        Of the distances.
    """

    what: What
    count: int
    criterion: Criterion
    places: int
    error: float
    longest: float | None = None


class Placed(Struct, frozen=True):
    """What helps most, and what it is worth: control or check points, distances, or photos, in the project.

    Parameters
    ----------
    points : tuple of ControlPoint
        Check points have negative errors. For distances: their ends, where these are planned.
    photos : tuple of Station
        With neither position nor angles observed.
    """

    points: tuple[ControlPoint, ...]
    distances: tuple[ControlDistance, ...]
    photos: tuple[Station, ...]
    placement: Placement


def place_in_block(solved: SolvedBlock, wanted: Wanted) -> Placed:
    """Return what helps most in a block that has been adjusted.

    Raises
    ------
    UsageError
        As `place_in_plan`, or if control is wanted for a free network.
    """
    if solved.block.is_free_network and wanted.what in {"control", "check"}:
        message = f"a free network has no {wanted.what} points; ask for distances or photos, or set datum in [[bundle]]"
        raise UsageError(message)
    return place_in(solved, wanted, set(), is_planned=False)


def place_in(solved: SolvedBlock, wanted: Wanted, taken: set[str], *, is_planned: bool) -> Placed:
    """Return what helps most in a block; of one that is planned, points get new names, none of those that are taken."""
    network = network_of(solved, wanted.places, tied=wanted.what in {"control", "check"})
    camera = int(np.bincount(solved.block.photo_camera).argmax())
    lens = network.of_camera(camera, "C")
    targets = network.of_points.ravel()
    if wanted.criterion == "camera":
        if lens is None:
            message = (
                "C is not unknown, or nothing determines it without control; add it to unknown, or choose another goal"
            )
            raise UsageError(message)
        targets = np.append(targets, lens)
    return _MAKERS[wanted.what](network, wanted, targets, _Names(camera, taken, is_planned))


class _Names(Struct, frozen=True):
    """The camera of further photos, names that are taken, and whether points are planned, and may be named anew."""

    camera: int
    taken: set[str]
    is_planned: bool


def _control(network: Network, wanted: Wanted, targets: IntArray, names: _Names) -> Placed:
    candidates = control_candidates(network, wanted.error)
    found = _chosen(network, candidates, targets, wanted, "that three photos show")
    rows = network.rows[list(found.chosen)]
    places = network.block.ground.to_project(network.solved.state.points[rows])
    prefix = "CHK" if wanted.what == "check" else "GCP"
    named = (
        _new_names(prefix, len(rows), names.taken)
        if names.is_planned
        else [network.block.point_names[row] for row in rows.tolist()]
    )
    error = -wanted.error if wanted.what == "check" else wanted.error
    return Placed(planned_control(named, _rounded(places), error), (), (), found)


def _distances(network: Network, wanted: Wanted, targets: IntArray, names: _Names) -> Placed:
    candidates, pairs = distance_candidates(network, wanted.error, wanted.longest)
    found = _chosen(network, candidates, targets, wanted, "of which each is a distance between two points")
    chosen = pairs[list(found.chosen)]
    rows, at = np.unique(chosen, return_inverse=True)
    at = at.reshape(chosen.shape)
    places = network.block.ground.to_project(network.points[rows])
    own = [network.block.point_names[row] for row in network.rows[rows].tolist()]
    named = _new_names("E", len(rows), names.taken) if names.is_planned else own
    points = planned_control(named, _rounded(places), -wanted.error) if names.is_planned else ()
    lengths = _rounded(np.linalg.norm(np.diff(network.points[chosen], axis=1)[:, 0], axis=1)).tolist()
    distances = tuple(
        ControlDistance(f"D{number + 1}", named[at[number, 0]], named[at[number, 1]], "XYZ", length, wanted.error)
        for number, length in enumerate(lengths)
    )
    return Placed(points, distances, (), found)


def _photos(network: Network, wanted: Wanted, targets: IntArray, names: _Names) -> Placed:
    candidates, orientation = photo_candidates(network, names.camera, _MOST_PHOTOS)
    # exchanges would take minutes: a photo has a hundred rows
    found = _chosen(network, candidates, targets, wanted, "of which each is a photo of enough points", place_greedily)
    chosen = orientation[list(found.chosen)]
    ground = network.block.ground
    centres = ground.to_project(chosen[:, :3])
    angles = angles_from_rotation(ground.axes_at(centres) @ rotation_from_angles(chosen[:, 3:]))
    named = _new_names("N", len(chosen), {photo.name for photo in network.block.photos})
    photos = tuple(
        Station(name, (x, y, z), ONLY_COMPARED, (omega, phi, kappa), ANGLES_ONLY_COMPARED)
        for name, (x, y, z), (omega, phi, kappa) in zip(named, centres.tolist(), angles.tolist(), strict=True)
    )
    return Placed((), (), photos, found)


_MAKERS: Mapping[What, Callable[[Network, Wanted, IntArray, _Names], Placed]] = {
    "control": _control,
    "check": _control,
    "distances": _distances,
    "photos": _photos,
}


def _chosen(
    network: Network,
    candidates: Sequence[Candidate],
    targets: IntArray,
    wanted: Wanted,
    what: str,
    choose: Callable[[FloatArray, Sequence[Candidate], IntArray, int, Criterion], Placement] = place,
) -> Placement:
    if len(candidates) < wanted.count:
        message = f"{wanted.count} are wanted of {len(candidates)} places {what}; ask for fewer"
        raise UsageError(message)
    found = choose(network.covariance, candidates, targets, wanted.count, wanted.criterion)
    scale = network.solved.deviation_scale
    return Placement(found.chosen, scale * found.value, tuple(scale * value for value in found.curve))


def _rounded(values: FloatArray) -> FloatArray:
    """Return lengths that are to be measured, as a text gives them."""
    return np.asarray(values.round(_DECIMALS) + 0.0)  # no -0.0


def _new_names(prefix: str, count: int, taken: set[str]) -> list[str]:
    numbers = (f"{prefix}{number}" for number in range(1, count + len(taken) + 1))
    return [name for name in numbers if name not in taken][:count]


def told(found: Placed, wanted: Wanted) -> dict[str, Any]:
    """Return what helps most as documents have it: what, goal, points, distances, photos (degrees), value, curve."""
    return {
        "what": wanted.what,
        "goal": wanted.criterion,
        "points": [
            {"name": point.name, "coordinates": list(point.coordinates), "error": point.errors[0]}
            for point in found.points
        ],
        "distances": [
            {"name": one.name, "start": one.start, "end": one.end, "distance": one.distance, "error": one.error}
            for one in found.distances
        ],
        "photos": [
            {"name": one.photo, "position": list(one.position), "angles": [DEGREES_PER_RADIAN * a for a in one.angles]}
            for one in found.photos
        ],
        "value": found.placement.value,
        "curve": list(found.placement.curve),
    }


def planned_control(names: Sequence[str], places: FloatArray, error: float) -> tuple[ControlPoint, ...]:
    """Return control points at places (n, 3)."""
    return tuple(
        ControlPoint(name, (x, y, z), (error,) * 3) for name, (x, y, z) in zip(names, places.tolist(), strict=True)
    )
