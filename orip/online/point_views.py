"""Where the photos of a session show a point, and what a ray of one photo is in the others."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.geometry.plane import PlaneTransformation
from orip.geometry.projection import PROJECTIONS, projected_with_partials
from orip.geometry.rotation import rotation_from_angles
from orip.images.matching.one_point import Transfer
from orip.interior.image_coordinates import ImageEquation
from orip.interior.mounting import frame_corners
from orip.online.advice import given_places, predicted_covariances
from orip.online.block.online_block import OnlineBlock
from orip.records.camera import READOUT, Camera
from orip.records.names import record_key

_NEIGHBOURS = 5
"""Measured points next to a place in a photo, whose median tells how far the ground is there."""

_REACH = 1.5
"""Times that distance up to which the image of a ray is drawn, and its inverse from which on."""

_WIDER = 1.3
"""Times the angle of a frame's corners in which is looked for what a photo shows: principal point and distortion."""

_PLACES = 33
"""Of the image of a ray: distortion bends it."""


class PhotoGeometry(Struct, frozen=True):
    """An oriented photo: from local coordinates to those of a measurement file, and back.

    Parameters
    ----------
    parameters : tuple of float
        Of the camera, as measuring goes on with.
    centre : array (3,)
    rotation : array (3, 3)
        From photo to local axes.
    to_log : PlaneTransformation
        From photo millimetres to coordinates of a measurement file.
    """

    camera: Camera
    parameters: tuple[float, ...]
    centre: FloatArray
    rotation: FloatArray
    to_log: PlaneTransformation

    @property
    def equation(self) -> ImageEquation:
        """Return the image equation of the camera."""
        _, x0, y0, *coefficients = self.parameters[:READOUT]
        return ImageEquation(x0, y0, tuple(coefficients), self.camera.distortion_at == "measured", None)

    def millimetres(self, places: FloatArray) -> FloatArray:
        """Return the photo coordinates (n, 2), mm, of local places (n, 3); NaN where the photo does not show them."""
        image = projected_with_partials(
            places - self.centre,
            np.broadcast_to(self.rotation, (len(places), 3, 3)),
            np.full(len(places), self.parameters[0]),
            np.full(len(places), self.camera.projection == "equidistant"),
        )
        with np.errstate(all="ignore"):  # far outside of the photo it may overflow
            xy = np.stack(self.equation.measured(*image.xy.T), axis=1)
        xy[~image.in_front] = np.nan
        return xy

    def images(self, places: FloatArray) -> FloatArray:
        """Return the coordinates (n, 2) of a measurement file of local places (n, 3); NaN where they are not shown."""
        return self.to_log.apply(self.millimetres(places))

    def directions(self, log: FloatArray) -> FloatArray:
        """Return unit vectors (n, 3), local, of the rays of places (n, 2) as in a measurement file; NaN without one."""
        x, y = self.to_log.inverse().apply(log).T
        ideal = self.equation.ideal(x, y)
        vectors = np.stack(PROJECTIONS[self.camera.projection].image_vector(self.parameters[0], *ideal), axis=1)
        return np.asarray(vectors @ self.rotation.T / np.linalg.norm(vectors, axis=1)[:, None])

    def shows(self, places: FloatArray) -> BoolArray:
        """Tell which local places (n, 3) are within the frame."""
        xy, corners = self.millimetres(places), frame_corners(self.camera)
        if corners is None:
            return np.asarray(np.isfinite(xy).all(axis=1))
        return np.asarray((xy >= corners[0]).all(axis=1) & (xy <= corners[1]).all(axis=1))

    def upwards(self) -> FloatArray:
        """Return the direction (2,), mm of the photo, of what is up in it: heights, else north where it looks down."""
        up = self.rotation.T @ np.array([0.0, 0.0, 1.0])
        if np.hypot(up[0], up[1]) < 0.5:
            up = self.rotation.T @ np.array([0.0, 1.0, 0.0])
        return np.asarray(up[:2] / max(float(np.hypot(up[0], up[1])), 1e-9))


class View(Struct, frozen=True):
    """Where a photo shows a point.

    Parameters
    ----------
    expected : array (2,) or None
        As in a measurement file; None where it cannot be told.
    covariance : array (2, 2) or None
        Of the expected place, in the same units.
    measured : array (2,) or None
    scale : float
        Units of a measurement file for one of the ground, less towards the corners of the frame.
    """

    photo: str
    expected: FloatArray | None
    covariance: FloatArray | None
    measured: FloatArray | None
    scale: float


class SeenBlock(Struct, frozen=True):
    """A block at its solution.

    Parameters
    ----------
    photos : dict of PhotoGeometry
        Those that are oriented, by name.
    points : mapping of array (3,)
        Those that are placed, by name, local coordinates.
    looks : array (photos, 2, 3)
        Their centres and the directions in which they look.
    least_along : array (photos,)
        Cosines of angles to these within which all is that they show.
    """

    block: OnlineBlock
    photos: dict[str, PhotoGeometry]
    points: Mapping[str, FloatArray]
    looks: FloatArray
    least_along: FloatArray

    def place_of(self, point: str) -> FloatArray | None:
        """Return the local coordinates (3,) of a point that is placed or has all of them by control; else None."""
        placed = self.points.get(point)
        return placed if placed is not None else given_places(self.block, [point]).get(point)

    def showing(self, place: FloatArray) -> list[str]:
        """Return the photos that show a local place (3,): looked at closely are those that look towards it."""
        names = list(self.photos)
        off = place - self.looks[:, 0]
        along = np.einsum("nk,nk->n", off, self.looks[:, 1]) / np.maximum(np.linalg.norm(off, axis=1), 1e-300)
        towards = np.flatnonzero(along > self.least_along)
        return [name for row in towards if self.photos[name := names[row]].shows(place[None])[0]]


def seen(block: OnlineBlock, to_log: Mapping[str, PlaneTransformation]) -> SeenBlock:
    """Return a block at its solution.

    Parameters
    ----------
    to_log : mapping by `record_key`
        From stored coordinates to those of a measurement file.
    """
    inputs, (orientations, points) = block.measurements.inputs, block.at_solution()
    found = {}
    for name, elements in orientations.items():
        key = record_key(name)
        camera = inputs.records.camera_of(inputs.records.photos[key])
        found[name] = PhotoGeometry(
            camera,
            tuple(block.values.cameras.get(camera.name, camera.parameters)),
            elements[:3],
            rotation_from_angles(elements[None, 3:])[0],
            to_log[key].after(inputs.interior.to_photo[key].inverse()),
        )
    looks = np.array([[photo.centre, -photo.rotation[:, 2]] for photo in found.values()]).reshape(-1, 2, 3)
    return SeenBlock(block, found, points, looks, np.array([_least_along(photo) for photo in found.values()]))


def _least_along(photo: PhotoGeometry) -> float:
    """Return the cosine of an angle to the axis that no ray of the frame has, whatever its distortion."""
    corners = frame_corners(photo.camera)
    if corners is None:
        return -1.0
    radius, c = float(np.abs(corners).max(axis=0) @ [1.0, 1.0]), photo.parameters[0]
    angle = radius / c if photo.camera.projection == "equidistant" else math.atan(radius / c)
    return math.cos(min(_WIDER * angle, math.pi))


def views_of(view: SeenBlock, point: str) -> list[View]:
    """Return where all photos show a point that show it, those that show it best first."""
    place, photos = view.place_of(point), view.photos
    measurements, found = view.block.measurements, []
    showing = [] if place is None else view.showing(place)
    covariances = predicted_covariances(view.block, showing, point)
    for name in dict.fromkeys([*showing, *measurements.photos_of(point)]):
        stored, photo = measurements.at(name, point), photos.get(name)
        measured = expected = covariance = None
        scale = 0.0
        if photo is not None:
            to_photo = measurements.inputs.interior.to_photo[record_key(name)]
            measured = None if stored is None else photo.to_log.apply(to_photo.apply(np.array([stored])))[0]
            if place is not None:
                expected, scale = photo.images(place[None])[0], _scale(photo, place)
            if name in covariances:
                covariance = photo.to_log.matrix @ covariances[name] @ photo.to_log.matrix.T
        found.append(View(name, expected, covariance, measured, scale))
    return sorted(found, key=lambda view: -view.scale)


def control_difference(view: SeenBlock, point: str) -> list[float | None] | None:
    """Return the coordinates of a point less those that control gives, ground units; None where nothing is compared.

    In a local system, and before the point is placed, nothing is.
    """
    given = next((one for one in view.block.project.control.points.get(point, ()) if not one.rejected), None)
    placed = view.points.get(point)
    if given is None or placed is None or view.block.local is not None:
        return None
    found = view.block.ground.to_project(placed[None])[0].tolist()
    return [None if old is None else new - old for new, old in zip(found, given.coordinates, strict=True)]


def _scale(photo: PhotoGeometry, place: FloatArray) -> float:
    corners = frame_corners(photo.camera)
    scale = photo.parameters[0] * float(np.linalg.norm(photo.to_log.matrix[0])) / np.linalg.norm(place - photo.centre)
    if corners is None:
        return float(scale)
    off = np.linalg.norm(photo.millimetres(place[None])[0]) / np.linalg.norm(corners[1])
    return float(scale / (1.0 + off * off))


def distance_along(view: SeenBlock, photo: str, log: FloatArray, point: str) -> float | None:
    """Return how far the ground is along the ray of a place (2,) in a photo; None where nothing tells.

    A point with coordinates is as far as these are, else as far as the measured points next to the place.
    """
    here = view.photos[photo]
    direction, place = here.directions(log[None])[0], view.place_of(point)
    if place is not None:
        along = float(direction @ (place - here.centre))
        return along if along > 0.0 else None
    points = view.points
    names = [name for name in view.block.measurements.points_in(photo) if name in points]
    if not names:
        return None
    places = np.array([points[name] for name in names])
    apart = np.linalg.norm(here.images(places) - log, axis=1)
    near = np.argsort(np.where(np.isfinite(apart), apart, np.inf))[:_NEIGHBOURS]
    distances = (places[near] - here.centre) @ direction
    return float(np.median(distances)) if np.median(distances) > 0.0 else None


def transferred(view: SeenBlock, photo: str, log: FloatArray, distance: float, ray_error: float) -> list[Transfer]:
    """Return where other photos show what is at a place (2,) of a photo, at a distance along its ray.

    The surface is taken for a plane that faces both photos alike; `ray_error` is in radians.
    """
    here, found = view.photos[photo], []
    direction = here.directions(log[None])[0]
    place = here.centre + distance * direction
    for name in view.showing(place):
        if name == photo:
            continue
        there = view.photos[name]
        normal = -direction + (there.centre - place) / np.linalg.norm(there.centre - place)
        around = log + 4.0 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.0, 0.0]])
        rays = here.directions(around)
        on_plane = here.centre + rays * (((place - here.centre) @ normal) / (rays @ normal))[:, None]
        right, left, down, up, middle = there.images(on_plane)
        affine = np.column_stack([right - left, down - up]) / 8.0
        beyond = there.images((here.centre + 1.001 * distance * direction)[None])[0] - middle
        length = float(np.linalg.norm(beyond))
        if np.isfinite(affine).all() and abs(np.linalg.det(affine)) > 1e-3 and np.isfinite(length):
            along = beyond / length if length > 0.0 else np.array([1.0, 0.0])
            scale = math.sqrt(abs(float(np.linalg.det(there.to_log.matrix))))
            found.append(Transfer(name, middle, affine, along, ray_error * there.parameters[0] * scale))
    return found


def ray_images(
    photos: Mapping[str, PhotoGeometry], photo: str, log: FloatArray, distance: float
) -> Iterator[tuple[str, Sequence[Sequence[float]]]]:
    """Yield for each other photo the line in which it shows the ray of a place (2,) of a photo, near a distance."""
    here = photos[photo]
    steps = distance * np.geomspace(1.0 / _REACH, _REACH, _PLACES)
    places = here.centre + steps[:, None] * here.directions(log[None])[0]
    for name, there in photos.items():
        if name != photo:
            line = there.images(places)
            inside: BoolArray = np.isfinite(line).all(axis=1) & there.shows(places)
            if inside.any():
                wide = inside | np.roll(inside, 1) | np.roll(inside, -1)
                yield name, line[wide & np.isfinite(line).all(axis=1)].round(2).tolist()
