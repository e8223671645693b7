"""Assembling a block: photo coordinates, control and starting values from the records of a project."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from orip.errors import Complaint, ProjectWarning
from orip.geometry.plane import PlaneTransformation
from orip.geometry.rays import intersect_rays
from orip.geometry.rotation import rotation_from_angles
from orip.interior.distortion import correction_with_partials, remove_distortion
from orip.model.block import Block, PhotoPoints
from orip.model.camera import CAMERA_PARAMETERS, Camera
from orip.model.control import Control, ControlElement, ControlPoint, PreliminaryPoint
from orip.model.measurement import PhotoObservations
from orip.model.names import look_alikes, record_key
from orip.model.photo import PHOTO_PARAMETERS, Photo
from orip.model.project import BundleDefinition
from orip.units import RADIANS_PER_DEGREE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Ingredients:
    """What a block is made of.

    Parameters
    ----------
    definition : BundleDefinition
    cameras, photos : mappings by `record_key`
    to_photo : mapping by `record_key` of the photo
        Stored coordinates to photo millimetres, for photos with an interior orientation.
    pixel_sizes : mapping by `record_key` of the photo
        mm in x and y, for photos with a sensor or scan.
    observations : PhotoObservations
    control : Control
    preliminary : sequence of PreliminaryPoint
    """

    definition: BundleDefinition
    cameras: Mapping[str, Camera]
    photos: Mapping[str, Photo]
    to_photo: Mapping[str, PlaneTransformation]
    pixel_sizes: Mapping[str, tuple[float, float]]
    observations: PhotoObservations
    control: Control
    preliminary: Sequence[PreliminaryPoint]


@dataclass(frozen=True, slots=True)
class Assembled:
    """A block with what its making gave rise to; with complaints there is no block."""

    block: Block | None
    complaints: tuple[Complaint, ...]
    warnings: tuple[ProjectWarning, ...]


def assemble(ingredients: Ingredients) -> Assembled:
    """Assemble the block of one bundle adjustment.

    Returns
    -------
    Assembled
        Every fault is a complaint, all of them at once.
    """
    observations = ingredients.observations
    keys = tuple(dict.fromkeys(record_key(name) for name in observations.photos))
    complaints = _photo_complaints(keys, ingredients)
    if not keys:
        complaints.append(
            Complaint(
                f"bundle {ingredients.definition.name} has no photo points; measure some "
                f"(POINTS {ingredients.definition.name} photo ... in a .MEA file, then orip measure)"
            )
        )
    if complaints:
        return Assembled(None, tuple(complaints), ())
    photos, cameras = _with_constant_elements(keys, ingredients)
    point_names = tuple(dict.fromkeys(observations.points))
    control_points = _control_points(point_names, ingredients.control)
    photo_points = _photo_points(keys, point_names, ingredients)
    camera_keys = [record_key(camera.name) for camera in cameras]
    camera_of = np.array([camera_keys.index(record_key(photo.camera)) for photo in photos])
    orientation = np.array([photo.orientation for photo in photos], dtype=np.float64)
    orientation[:, 3:] *= RADIANS_PER_DEGREE
    block = Block(
        definition=ingredients.definition,
        cameras=cameras,
        photos=photos,
        photo_camera=camera_of,
        photo_orientation=orientation,
        point_names=point_names,
        point_start=np.full((len(point_names), 3), np.nan),
        photo_points=photo_points,
        control_points=control_points,
    )
    block, start_warnings = _with_starting_points(block, ingredients.preliminary)
    return Assembled(block, (), tuple(_name_warnings(block, ingredients) + start_warnings))


def _photo_complaints(keys: Sequence[str], ingredients: Ingredients) -> list[Complaint]:
    complaints = []
    for key in keys:
        photo = ingredients.photos.get(key)
        if photo is None:
            text = f"photo {key} has photo points but is not defined any more; run 'orip measure', or define it again"
            complaints.append(Complaint(text))
            continue
        if key not in ingredients.to_photo:
            text = (
                f"photo {photo.name} has photo points but no interior orientation; measure its fiducial marks "
                f"(PHOTO {photo.name} A ... in a .MEA file)"
            )
            complaints.append(Complaint(text))
        elements = [
            f"{element.kind}" for element in ingredients.control.elements
            if element.group == "PHOTO" and record_key(element.name) == key and element.error >= 0.0
        ]  # fmt: skip
        missing = [
            kind for kind, value in zip(PHOTO_PARAMETERS, photo.orientation, strict=True)
            if value is None and kind not in elements
        ]  # fmt: skip
        if missing:
            text = (
                f"photo {photo.name} has no preliminary value of {', '.join(missing)}; give it in orip.toml "
                f"(keys {' '.join(PHOTO_PARAMETERS)} of [[photo]])"
            )
            complaints.append(Complaint(text))
        if ingredients.definition.measurement_precision.unit == "px" and key not in ingredients.pixel_sizes:
            text = f"measurement_precision is in px, but photo {photo.name} has neither sensor nor scan; give it in mm"
            complaints.append(Complaint(text))
    return complaints


def _with_constant_elements(
    keys: Sequence[str], ingredients: Ingredients
) -> tuple[tuple[Photo, ...], tuple[Camera, ...]]:
    """Return photos and their cameras with observed elements as starting values, constant where the error is 0."""
    photos = tuple(_photo_with_elements(ingredients.photos[key], ingredients.control.elements) for key in keys)
    camera_keys = dict.fromkeys(record_key(photo.camera) for photo in photos)
    cameras = tuple(
        _camera_with_elements(ingredients.cameras[key], ingredients.control.elements) for key in camera_keys
    )
    return photos, cameras


def _photo_with_elements(photo: Photo, elements: Sequence[ControlElement]) -> Photo:
    values, constant = list(photo.orientation), set(photo.constant)
    for element in elements:
        if element.group == "PHOTO" and record_key(element.name) == record_key(photo.name) and element.error >= 0.0:
            place = PHOTO_PARAMETERS.index(element.kind)
            if element.error == 0.0:
                constant.add(element.kind)
            if element.error == 0.0 or values[place] is None:
                values[place] = element.value
    held = tuple(kind for kind in PHOTO_PARAMETERS if kind in constant)
    return replace(photo, orientation=tuple(values), constant=held)


def _camera_with_elements(camera: Camera, elements: Sequence[ControlElement]) -> Camera:
    values, unknown = list(camera.parameters), set(camera.unknown)
    for element in elements:
        if element.group == "CAMERA" and record_key(element.name) == record_key(camera.name) and element.error == 0.0:
            values[CAMERA_PARAMETERS.index(element.kind)] = element.value
            unknown.discard(element.kind)
    free = tuple(kind for kind in CAMERA_PARAMETERS if kind in unknown)
    return replace(camera, parameters=tuple(values), unknown=free)


def _control_points(point_names: Sequence[str], control: Control) -> tuple[ControlPoint, ...]:
    """Return the control of measured points, with coordinates that an element of group POINT holds."""
    measured = set(point_names)
    return tuple(point for point in control.points if point.name in measured)


def _photo_points(keys: Sequence[str], point_names: Sequence[str], ingredients: Ingredients) -> PhotoPoints:
    observations = ingredients.observations
    photo_place = {key: place for place, key in enumerate(keys)}
    point_place = {name: place for place, name in enumerate(point_names)}
    photo = np.array([photo_place[record_key(name)] for name in observations.photos])
    point = np.array([point_place[name] for name in observations.points])
    xy = np.empty_like(observations.measured)
    default = np.empty_like(observations.measured)
    precision = ingredients.definition.measurement_precision
    for place, key in enumerate(keys):
        rows = photo == place
        xy[rows] = ingredients.to_photo[key].apply(observations.measured[rows])
        unit = np.array(ingredients.pixel_sizes[key]) if precision.unit == "px" else np.ones(2)
        default[rows] = precision.value * unit
    own = ~np.isnan(observations.errors)
    error = np.where(own, np.abs(observations.errors), default)
    used = ~observations.disregarded[:, None] & ~(own & (observations.errors < 0.0))
    return PhotoPoints(photo, point, xy, error, used)


def _with_starting_points(block: Block, preliminary: Sequence[PreliminaryPoint]) -> tuple[Block, list[ProjectWarning]]:
    """Return the block with starting coordinates: .PRE, else .PNT, else the intersection of rays; control as given."""
    start = block.point_start.copy()
    place = {name: index for index, name in enumerate(block.point_names)}
    for point in block.control_points:
        if None not in point.coordinates:
            start[place[point.name]] = point.coordinates
    for given in preliminary:
        if given.name in place:
            start[place[given.name]] = given.coordinates
    missing = np.isnan(start).any(axis=1)
    if missing.any():
        start[missing] = _intersections(block)[missing]
    warnings = []
    single: NDArray[np.bool_] = np.asarray(np.isnan(start).any(axis=1))
    if single.any():
        start[single] = _points_on_first_ray(block, start, single)
        warnings = [
            ProjectWarning(
                "one-ray", f"point {block.point_names[index]}",
                "is seen by one ray and has no preliminary coordinates: its distance from the photo is a guess",
            )
            for index in np.flatnonzero(single)
        ]  # fmt: skip
    for point in block.control_points:
        for coordinate, (value, error) in enumerate(zip(point.coordinates, point.errors, strict=True)):
            if not point.rejected and error == 0.0 and value is not None:
                start[place[point.name], coordinate] = value
    return replace(block, point_start=start), warnings


def _rays(block: Block) -> tuple[FloatArray, FloatArray]:
    """Return origins and directions (n, 3) of the rays of all photo points."""
    points = block.photo_points
    parameters = np.array([camera.parameters for camera in block.cameras])[block.photo_camera[points.photo]]
    reduced = points.xy - parameters[:, 1:3]
    at_measured = np.array([camera.distortion_at == "measured" for camera in block.cameras])
    measured = at_measured[block.photo_camera[points.photo]][:, None]
    ideal = np.where(
        measured,
        correction_with_partials(reduced, parameters[:, 3:]).value,
        remove_distortion(reduced, parameters[:, 3:]),
    )
    image = np.column_stack([ideal, -parameters[:, 0]])
    rotation = rotation_from_angles(block.photo_orientation[points.photo, 3:])
    return block.photo_orientation[points.photo, :3], (rotation @ image[:, :, None])[:, :, 0]


def _intersections(block: Block) -> FloatArray:
    origins, directions = _rays(block)
    seen = block.photo_points.used.all(axis=1) & np.isfinite(directions).all(axis=1)
    return intersect_rays(origins[seen], directions[seen], block.photo_points.point[seen], len(block.point_names))


def _points_on_first_ray(block: Block, start: FloatArray, wanted: NDArray[np.bool_]) -> FloatArray:
    """Return positions on the first ray of points that nothing places, as far away as the other points are."""
    origins, directions = _rays(block)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    distances = np.linalg.norm(start[block.photo_points.point] - origins, axis=1)
    typical = float(np.nanmedian(distances)) if np.isfinite(distances).any() else 1.0
    indices, first = np.unique(block.photo_points.point, return_index=True)
    position = np.full_like(start, np.nan)
    position[indices] = (origins + typical * directions)[first]
    return np.asarray(position[wanted])


def _name_warnings(block: Block, ingredients: Ingredients) -> list[ProjectWarning]:
    measured = set(block.point_names)
    warnings = [
        ProjectWarning("unused-control", f"control point {point.name}", "is not measured in any photo")
        for point in ingredients.control.points
        if point.name not in measured
    ]
    warnings += [
        ProjectWarning("unused-preliminary", f"preliminary point {given.name}", "is not measured in any photo")
        for given in ingredients.preliminary
        if given.name not in measured
    ]
    names = [*block.point_names, *(point.name for point in ingredients.control.points)]
    for group in look_alikes(names):
        text = f"{', '.join(group)} differ only in case or leading zeros: are they one point?"
        warnings.append(ProjectWarning("look-alike-names", f"point {group[0]}", text))
    return warnings
