"""What could be observed beside a network: control points, distances between its points, and further photos.

Each candidate is the rows of its observation equations by unknowns whose covariance matrix is known. Those of a photo
have its six elements eliminated: they are new unknowns, on which nothing else depends.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.bundle.additions.search import Candidate
from orip.bundle.kinds.photo_point import POINT_PARTIALS, observe_photo_points
from orip.bundle.solve import SolvedBlock
from orip.bundle.starting_state import starting_state
from orip.bundle.unknowns import CONSTANT, number_unknowns
from orip.geometry.rotation import angles_from_rotation, looking_along, rotation_from_angles
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import CAMERA_PARAMETERS, Camera
from orip.records.photo import Photo
from orip.structs import replace

_EDGE = 0.02
"""Part of the frame at each side in which no tie point is expected."""

_STEEP = 1.3
"""Radians from the vertical within which all that a photo shows is near it."""


def with_rays(block: Block, error: FloatArray) -> Block:
    """Return a block of one camera with its points in all photos whose frame they are in.

    Parameters
    ----------
    error : array (2,)
        A-priori errors of x and y, mm.
    """
    camera = block.cameras[0]
    half = (0.5 - _EDGE) * _size(camera)
    places_near = _nearby(block, half)
    rotations = rotation_from_angles(block.photo_orientation[:, 3:])
    photo, point, image = [], [], []
    for row, (centre, rotation) in enumerate(zip(block.photo_orientation[:, :3], rotations, strict=True)):
        near = places_near(row)
        u = (block.point_start[near] - centre) @ rotation
        front = u[:, 2] < 0.0
        xy = -camera.parameters[0] * u[:, :2] / np.where(front, u[:, 2], -np.inf)[:, None]
        shown = np.flatnonzero(front & (np.abs(xy) <= half).all(axis=1))
        photo.append(np.full(len(shown), row))
        point.append(near[shown])
        image.append(xy[shown])
    photos, points = np.concatenate(photo), np.concatenate(point)
    xy = np.concatenate(image) + camera.parameters[1:3]
    return replace(
        block,
        photo_points=IndexedPhotoPoints(
            photos, points, xy, np.broadcast_to(error, xy.shape).copy(), np.ones(xy.shape, dtype=bool)
        ),
    )


def _nearby(block: Block, half: FloatArray) -> Callable[[int], IntArray]:
    """Return what gives the points that a photo may show: all but those behind the plane through its centre.

    Photos that look down steeply show nothing that is far from below them; of large blocks that is most.
    """
    from scipy.spatial import KDTree

    camera, centres = block.cameras[0], block.photo_orientation[:, :3]
    down = rotation_from_angles(block.photo_orientation[:, 3:])[:, 2, 2]
    widest = np.arctan(np.hypot(*half) / camera.parameters[0])
    steepest = np.arccos(np.clip(down, -1.0, 1.0)) + widest
    depth = centres[:, 2] - block.point_start[:, 2].min()
    if not (steepest < _STEEP).all():
        return lambda _: np.arange(len(block.point_start))
    tree = KDTree(block.point_start[:, :2])
    found = tree.query_ball_point(centres[:, :2], np.maximum(depth, 0.0) * np.tan(steepest), return_sorted=True)
    return lambda row: np.array(found[row], dtype=np.int64)


def _size(camera: Camera) -> FloatArray:
    """Return the size (2,) of the frame, mm."""
    size = camera.sensor.size if camera.sensor is not None else camera.frame
    assert size is not None, "photos are planned with cameras that have one"
    return np.array(size)


_ELEMENTS = slice(len(CAMERA_PARAMETERS), POINT_PARTIALS.start)
"""Of a photo, among the partials of photo points."""

_LEAST_RAYS = 3
"""A point that fewer photos show is hard to find again, and no place for anything."""

_PLACES_OF_DISTANCES = 40
"""Places between which distances are tried, at most: there are n (n - 1) / 2 of them."""

_RAYS_OF_PHOTO = 60
"""Rays of a candidate photo that count, at most: they are spread over it."""

_FEWEST_RAYS = 6
_TILT = np.radians(50.0)
"""A further photo looks where an existing one does, within this angle."""

_DIRECTIONS, _CENTRES = 96, 12
_FARTHER = (1.0, 1.3)
"""Distances, as parts of that of the photos that are there."""


class Network(Struct, frozen=True):
    """A network that has been solved, and what is known of some of its unknowns.

    Parameters
    ----------
    rows : array (n,) of int
        Points that are judged, and between or at which something can be observed.
    columns : array (k,) of int
        Their unknowns and those of the cameras, in ascending order.
    covariance : array (k, k)
        Of these unknowns, with sigma0 = 1.
    """

    solved: SolvedBlock
    rows: IntArray
    columns: IntArray
    covariance: FloatArray

    @property
    def block(self) -> Block:
        """Return the block that was solved."""
        return self.solved.block

    @property
    def points(self) -> FloatArray:
        """Return the coordinates (n, 3) of the points, local."""
        return np.asarray(self.solved.state.points[self.rows])

    @property
    def names(self) -> list[str]:
        """Return the names of the points."""
        return [self.block.point_names[row] for row in self.rows.tolist()]

    @property
    def of_points(self) -> IntArray:
        """Return the places (n, 3) of the points' unknowns in the covariance matrix."""
        return np.searchsorted(self.columns, self.solved.problem.unknowns.points[self.rows])

    def of_camera(self, camera: int, parameter: str) -> int | None:
        """Return the place of a camera's parameter in the covariance matrix; None where it is not estimated."""
        column = int(self.solved.problem.unknowns.cameras[camera, CAMERA_PARAMETERS.index(parameter)])
        return int(np.searchsorted(self.columns, column)) if column in self.columns else None


def network_of(solved: SolvedBlock, most: int, *, tied: bool) -> Network:
    """Return a solved block as a network with about so many of its points, spread over it.

    Parameters
    ----------
    tied : bool
        Only points without control coordinates.
    """
    block, unknowns, removed = solved.block, solved.problem.unknowns, solved.normals.removed
    rays = np.bincount(block.photo_points.point, minlength=len(block.point_names))
    free = (unknowns.points != CONSTANT).all(axis=1)
    free &= ~removed[unknowns.points].any(axis=1) & (rays >= _LEAST_RAYS)
    if tied:
        given = {point.name for point in block.control_points}
        free &= np.array([name not in given for name in block.point_names], dtype=bool)
    rows = np.flatnonzero(free)
    rows = rows[spread(solved.state.points[rows], most)]
    cameras = np.unique(np.concatenate([unknowns.cameras.ravel(), unknowns.additional.ravel()]))
    cameras = cameras[(cameras != CONSTANT)]
    cameras = cameras[~removed[cameras]]
    columns = np.unique(np.concatenate([cameras, unknowns.points[rows].ravel()]))
    return Network(solved, rows, columns, solved.normals.inverse_at(columns))


def spread(points: FloatArray, most: int) -> IntArray:
    """Return which (k,) of many points (n, 3) to keep: the first in each cell of a coarser grid."""
    if len(points) <= most:
        return np.arange(len(points))
    extent = np.sort(np.ptp(points, axis=0))[::-1]
    plane = np.argsort(-np.ptp(points, axis=0), kind="stable")[:2]
    step = float(np.sqrt(max(extent[0] * extent[1], 1e-12) / most))
    cell = np.floor((points[:, plane] - points[:, plane].min(axis=0)) / step).astype(np.int64)
    _, first = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_index=True)
    return np.sort(first)


def control_candidates(network: Network, error: float) -> list[Candidate]:
    """Return a control point with the a-priori error `error` at each of the points."""
    variance = np.full(3, error**2)
    return [
        Candidate(name, places, np.eye(3), variance)
        for name, places in zip(network.names, network.of_points, strict=True)
    ]


def distance_candidates(network: Network, error: float, longest: float | None) -> tuple[list[Candidate], IntArray]:
    """Return spatial distances between points, and the two points (n, 2) of each.

    Parameters
    ----------
    error : float
        A-priori, ground unit.
    longest : float or None
        Of a bar, for example.
    """
    some = spread(network.points, _PLACES_OF_DISTANCES)
    pairs = np.array(list(combinations(some.tolist(), 2)), dtype=np.int64).reshape(-1, 2)
    difference = network.points[pairs[:, 1]] - network.points[pairs[:, 0]]
    length = np.linalg.norm(difference, axis=1)
    kept = (length > 0.0) & (length <= (np.inf if longest is None else longest))
    pairs, along = pairs[kept], difference[kept] / length[kept, None]
    places, names = network.of_points, network.names
    found = [
        Candidate(
            f"{names[start]}-{names[end]}",
            np.concatenate([places[start], places[end]]),
            np.concatenate([-unit, unit])[None],
            np.array([error**2]),
        )
        for (start, end), unit in zip(pairs.tolist(), along, strict=True)
    ]
    return found, pairs


def photo_candidates(network: Network, camera: int, most: int) -> tuple[list[Candidate], FloatArray]:
    """Return photos that could be added, and the orientation (n, 6) of each, local and radians.

    They look at places of the network as its photos do, from about as far away and a third farther, with the camera
    upright and turned by a right angle.

    Parameters
    ----------
    camera : int
        Place of the camera in the block.
    most : int
        So many are tried at most.
    """
    orientation = _viewpoints(network)
    orientation = orientation[np.unique(np.linspace(0, len(orientation) - 1, most).round().astype(np.int64))]
    sub = _photographed(network, camera, orientation)
    rays = sub.photo_points
    equations = observe_photo_points(sub, number_unknowns(sub, frozenset()))
    partials = equations.linearise_with_partials(starting_state(sub)).partials / rays.error.reshape(-1, 1)
    unknowns = network.solved.problem.unknowns
    of_camera = np.concatenate([unknowns.cameras[camera], unknowns.additional[camera]])
    place = np.searchsorted(network.columns, of_camera)
    known = np.flatnonzero(np.isin(of_camera, network.columns))
    by_camera = np.hstack([partials[:, : _ELEMENTS.start], partials[:, POINT_PARTIALS.stop :]])[:, known]
    found, kept = [], []
    for photo in range(len(orientation)):
        shown = np.flatnonzero(rays.photo == photo)
        if len(shown) < _FEWEST_RAYS:
            continue
        shown = shown[np.unique(np.linspace(0, len(shown) - 1, _RAYS_OF_PHOTO).round().astype(np.int64))]
        rows = (2 * shown[:, None] + np.arange(2)).ravel()
        by_points = np.zeros((len(rows), 3 * len(shown)))
        for number in range(len(shown)):
            by_points[2 * number : 2 * number + 2, 3 * number : 3 * number + 3] = partials[
                rows[2 * number : 2 * number + 2], POINT_PARTIALS
            ]
        left = np.linalg.qr(partials[rows, _ELEMENTS], mode="complete")[0][:, 6:]
        columns = np.concatenate([place[known], network.of_points[rays.point[shown]].ravel()])
        design = left.T @ np.hstack([by_camera[rows], by_points])
        found.append(Candidate(sub.photos[photo].name, columns, design, np.ones(len(design))))
        kept.append(photo)
    return found, orientation[kept]


def _viewpoints(network: Network) -> FloatArray:
    """Return orientations (n, 6) from which further photos could be taken."""
    state, rays = network.solved.state, network.block.photo_points
    looking = -state.rotations[:, :, 2]
    depth = np.einsum("ij,ij->i", state.points[rays.point] - state.centres[rays.photo], looking[rays.photo])
    distance = float(np.median(depth[depth > 0.0]))
    points = network.points
    is_compact = float(np.ptp(points, axis=0).max()) < 1.5 * distance
    centres = points.mean(axis=0)[None] if is_compact else points[spread(points, _CENTRES)]
    found = []
    for direction in _directions():
        if (looking @ direction).max() < np.cos(_TILT):
            continue
        for roll in (0.0, 0.5 * np.pi):
            angles = angles_from_rotation(looking_along(direction, roll)[None])[0]
            for farther in _FARTHER:
                found += [np.concatenate([centre - farther * distance * direction, angles]) for centre in centres]
    return np.array(found).reshape(-1, 6)


def _directions() -> FloatArray:
    """Return directions (n, 3) spread evenly over the sphere, straight down among them (Fibonacci's spiral)."""
    number = np.arange(_DIRECTIONS)
    z = -1.0 + 2.0 * number / (_DIRECTIONS - 1)
    turn = number * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def _photographed(network: Network, camera: int, orientation: FloatArray) -> Block:
    """Return the block of the candidate photos alone, with the network's points in all that show them."""
    block, state = network.block, network.solved.state
    record = replace(block.cameras[camera], parameters=tuple(state.cameras[camera].tolist()))
    photos = tuple(Photo(f"N{number + 1}", record.name) for number in range(len(orientation)))
    empty = Block(
        definition=block.definition,
        cameras=(record,),
        photos=photos,
        photo_camera=np.zeros(len(photos), dtype=np.int64),
        photo_orientation=orientation,
        point_names=tuple(network.names),
        point_start=network.points,
        photo_points=block.photo_points.of(np.zeros(0, dtype=np.int64)),
        constant_points=np.zeros((len(network.rows), 3), dtype=bool),
        ground=block.ground,
        ground_unit=block.ground_unit,
    )
    return with_rays(empty, _usual_error(block, camera))


def _usual_error(block: Block, camera: int) -> FloatArray:
    """Return the median a-priori error (2,) of the photo coordinates of a camera, mm."""
    mine = block.photo_camera[block.photo_points.photo] == camera
    return np.asarray(np.median(block.photo_points.error[mine], axis=0))
