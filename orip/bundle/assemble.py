"""Assembling a block: photo coordinates, control and starting values from the records of a project."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray, rows_of_groups
from orip.bundle.antennas import with_orientations_of_stations
from orip.bundle.kinds.terrain_height import with_terrain_heights
from orip.bundle.known_motions import without_motion
from orip.bundle.local_frame import constants_in_frame, frame_complaints, ground_system, photos_in_frame
from orip.bundle.points.starting import with_starting_points
from orip.bundle.rigs.starting import with_photos_on_rigs
from orip.bundle.starting_state import with_determined_figures
from orip.errors import Complaint, InputError, ProjectWarning
from orip.interior.additional_parameters import base_of_camera
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior
from orip.records.block import Block, IndexedPhotoPoints, TheodoliteSet
from orip.records.camera import CAMERA_PARAMETERS, OWN_PARAMETERS, Camera, lens_key
from orip.records.coded_names import coded
from orip.records.control import Control, ControlElement, PreliminaryPoint, Station
from orip.records.definition import Antenna, BundleDefinition
from orip.records.figures import points_that_count
from orip.records.ground import GroundSystem, TerrainModel
from orip.records.measurement import Measured, PhotoObservations
from orip.records.names import places_of_names, record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo
from orip.records.rig import Rigs
from orip.set_aside import set_aside
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE


class BlockInput(Struct, frozen=True):
    """The records and observations that a block is assembled from.

    Parameters
    ----------
    records : Definitions
        All cameras and photos.
    measured : Measured
        With the photo observations of the bundle.
    interior : Interior
        That of the records and measurements.
    control : Control
        All of the project.
    crs : str or None
        The project's coordinate reference system; None: ground coordinates are a plain right-handed system.
    warnings : tuple of ProjectWarning
        What is known to be doubtful already.
    antennas : tuple of Antenna
        All of the project.
    """

    definition: BundleDefinition
    records: Definitions
    measured: Measured
    interior: Interior
    control: Control
    preliminary: tuple[PreliminaryPoint, ...] = ()
    ground_unit: str = "m"
    crs: str | None = None
    warnings: tuple[ProjectWarning, ...] = ()
    antennas: tuple[Antenna, ...] = ()
    rigs: Rigs = Rigs()
    terrains: tuple[TerrainModel, ...] = ()

    @property
    def observations(self) -> PhotoObservations:
        """Return the photo observations of the bundle."""
        return self.measured.observations[record_key(self.definition.name)]


def gather(inputs: BlockInput, ground: GroundSystem | None = None) -> Block:
    """Return the block of what is measured and given, before starting values are computed.

    Parameters
    ----------
    ground : GroundSystem or None
        That of a block which this is a part of; None: its own.

    Returns
    -------
    Block
        In its frame; its points have no starting coordinates, and its photos have NaN for every element that is not
        known.

    Raises
    ------
    InputError
        With every fault of the input.
    """
    observations = inputs.observations
    keys = tuple(dict.fromkeys(map(record_key, coded(observations.photos).occurring())))
    complaints = _photo_complaints(keys, inputs)
    if not keys:
        complaints.append(
            Complaint(
                f"bundle {inputs.definition.name} has no photo points; measure some "
                f"(POINTS {inputs.definition.name} photo ... in a .MEA file, then orip measure)"
            )
        )
    complaints += _set_complaints(keys, inputs)
    if complaints:
        raise InputError(tuple(complaints))
    block = _block_in_project(keys, inputs, ground)
    if complaints := frame_complaints(block):
        raise InputError(tuple(complaints))
    block = replace(block, warnings=(*block.warnings, *without_motion(block), *_without_exposures(block)))
    return with_orientations_of_stations(photos_in_frame(block))


def _without_exposures(block: Block) -> Iterator[ProjectWarning]:
    """Yield a warning of each rig of which several cameras have photos, but no exposure has photos of two."""
    places = block.places_on_rigs()
    together = Counter(photo.exposure for photo in places.photos)
    used = {places.rig_of_exposure[exposure] for exposure, count in together.items() if count > 1}
    cameras = {record_key(photo.camera) for photo in block.photos}
    for rig in block.rigs.rigs:
        if rig.name not in used and sum(record_key(one.name) in cameras for one in rig.cameras) > 1:
            text = (
                "no exposure has photos of two of its cameras, so that all photos are adjusted one by one; write an "
                "[[exposure]] with the photos of each instant"
            )
            yield ProjectWarning("no-exposures", f"rig {rig.name}", text)


def with_starting_values(block: Block) -> tuple[Block, list[ProjectWarning]]:
    """Return a gathered block, whose photos all have an orientation, with the starting values of points."""
    block, warnings = with_starting_points(with_photos_on_rigs(block))
    block, of_figures = with_determined_figures(block)
    block, of_terrain = with_terrain_heights(block)
    block = replace(block, theodolites=theodolite_sets(block))
    return constants_in_frame(block), [*warnings, *of_figures, *of_terrain]


def _block_in_project(keys: Sequence[str], inputs: BlockInput, system: GroundSystem | None) -> Block:
    """Return the block without starting points, its photos and constants still in the project's coordinates.

    Raises
    ------
    InputError
        If the coordinate reference system cannot be used.
    """
    photos, cameras = _with_constant_elements(keys, inputs)
    point_names = _point_names(inputs)
    ground = _ground_observations(point_names, photos, cameras, inputs)
    photo_points = _photo_points(keys, point_names, inputs)
    camera_keys = [record_key(camera.name) for camera in cameras]
    camera_of = np.array([camera_keys.index(record_key(photo.camera)) for photo in photos])
    orientation = np.array([photo.orientation for photo in photos], dtype=np.float64)
    orientation[:, 3:] *= RADIANS_PER_DEGREE
    return Block(
        definition=inputs.definition,
        cameras=cameras,
        photos=photos,
        photo_camera=camera_of,
        photo_orientation=orientation,
        point_names=point_names,
        point_start=np.broadcast_to(np.nan, (len(point_names), 3)),
        photo_points=photo_points,
        constant_points=_constant_points(point_names, ground, inputs.definition),
        control_points=ground.points,
        elements=ground.elements,
        distances=ground.distances,
        directions=ground.directions,
        figure_points=ground.figure_points,
        given_directions=ground.given_directions,
        terrains=inputs.terrains,
        stations=ground.stations,
        differences=ground.differences,
        antennas=inputs.antennas,
        rigs=inputs.rigs,
        ground=system
        or ground_system(inputs.crs, inputs.ground_unit, ground.points, _places(orientation, ground.stations)),
        preliminary=inputs.preliminary,
        ground_unit=inputs.ground_unit,
        defined_cameras=tuple(inputs.records.cameras.values()),
        control_correlations=ground.correlations,
        warnings=inputs.warnings,
    )


def _places(orientation: FloatArray, stations: Sequence[Station]) -> FloatArray:
    """Return where photos were taken (n, 3), in the project."""
    observed = [station.position for station in stations]
    return np.vstack([orientation[:, :3], np.array(observed, dtype=np.float64).reshape(-1, 3)])


def _photo_complaints(keys: Sequence[str], inputs: BlockInput) -> list[Complaint]:
    complaints = []
    for key in keys:
        photo = inputs.records.photos.get(key)
        if photo is None:
            text = f"photo {key} has photo points but is not defined any more; run 'orip measure', or define it again"
            complaints.append(Complaint(text))
            continue
        if key not in inputs.interior.to_photo:
            text = (
                f"photo {photo.name} has photo points but no interior orientation; measure its fiducial marks "
                f"(PHOTO {photo.name} A ... in a .MEA file)"
            )
            complaints.append(Complaint(text))
        given = _photo_with_elements(photo, inputs.control.elements)
        unplaced = [kind for kind in given.constant if given.orientation[PHOTO_PARAMETERS.index(kind)] is None]
        if unplaced:
            text = f"photo {photo.name} has {', '.join(unplaced)} constant, but without a value; give it in orip.toml"
            complaints.append(Complaint(text))
        if inputs.definition.measurement_precision.unit == "px" and key not in inputs.interior.pixel_sizes:
            text = f"measurement_precision is in px, but photo {photo.name} has neither sensor nor scan; give it in mm"
            complaints.append(Complaint(text))
    return complaints


def _set_complaints(keys: Sequence[str], inputs: BlockInput) -> list[Complaint]:
    """Return a complaint for each camera whose parameter set cannot be scaled, since it has no frame."""
    photos = [inputs.records.photos[key] for key in keys if key in inputs.records.photos]
    cameras = (inputs.records.cameras[key] for key in dict.fromkeys(record_key(photo.camera) for photo in photos))
    return [
        Complaint(
            f"camera {camera.name} has set = {camera.additional_set} but no frame to scale it to; "
            "give frame = [x, y] (mm) in its [[camera]]"
        )
        for camera in cameras
        if camera.additional_set is not None and base_of_camera(camera) <= 0.0
    ]


def _with_constant_elements(keys: Sequence[str], inputs: BlockInput) -> tuple[tuple[Photo, ...], tuple[Camera, ...]]:
    """Return photos and their cameras with observed elements as starting values, constant where the error is 0."""
    photos = tuple(_photo_with_elements(inputs.records.photos[key], inputs.control.elements) for key in keys)
    camera_keys = dict.fromkeys(record_key(photo.camera) for photo in photos)
    lenses = {key: lens_key(camera) for key, camera in inputs.records.cameras.items()}
    cameras = tuple(
        _camera_with_elements(inputs.records.cameras[key], inputs.control.elements, lenses) for key in camera_keys
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


def _camera_with_elements(camera: Camera, elements: Sequence[ControlElement], lenses: Mapping[str, str]) -> Camera:
    """Return a camera with its constant elements, and those of its lens that are given with another camera."""
    values, unknown = list(camera.parameters), set(camera.unknown)
    for element in elements:
        if element.group != "CAMERA" or element.error != 0.0:
            continue
        of_lens = element.kind not in OWN_PARAMETERS and lenses.get(record_key(element.name)) == lens_key(camera)
        if of_lens or record_key(element.name) == record_key(camera.name):
            values[CAMERA_PARAMETERS.index(element.kind)] = element.value
            unknown.discard(element.kind)
    free = tuple(kind for kind in CAMERA_PARAMETERS if kind in unknown)
    return replace(camera, parameters=tuple(values), unknown=free)


def _point_names(inputs: BlockInput) -> tuple[str, ...]:
    """Return the measured points, then those of distances, directions and figures that have starting coordinates."""
    control = inputs.control
    placed = {point.name for point in control.points if None not in point.coordinates}
    placed |= {point.name for point in inputs.preliminary}
    ends = [name for distance in control.distances for name in (distance.start, distance.end)]
    ends += [name for direction in control.directions for name in (direction.station, direction.target)]
    ends += [name for line in control.given_directions for name in (line.start, line.end)]
    ends += [point.point for point in control.figure_points]
    measured, further = coded(inputs.observations.points).occurring(), [name for name in ends if name in placed]
    return tuple(dict.fromkeys([*measured, *further])) if further else measured


def _ground_observations(
    point_names: tuple[str, ...], photos: Sequence[Photo], cameras: Sequence[Camera], inputs: BlockInput
) -> Control:
    """Return the control whose points, photos and cameras are all in the block."""
    control = inputs.control
    points = places_of_names(point_names).keys()
    records = {
        "PHOTO": {record_key(photo.name) for photo in photos},
        "CAMERA": {record_key(camera.name) for camera in cameras},
    }
    directions = tuple(direction for direction in control.directions if {direction.station, direction.target} <= points)
    sets = {direction.set for direction in directions}

    def has(element: ControlElement) -> bool:
        if element.group in records:
            return record_key(element.name) in records[element.group]
        return element.name in (points if element.group == "POINT" else sets)

    return Control(
        tuple(point for point in control.points if point.name in points),
        tuple(element for element in control.elements if has(element)),
        tuple(distance for distance in control.distances if {distance.start, distance.end} <= points),
        directions,
        tuple(station for station in control.stations if record_key(station.photo) in records["PHOTO"]),
        correlations=tuple(pair for pair in control.correlations if {pair.first, pair.second} <= points),
        differences=tuple(
            line
            for line in control.differences
            if {record_key(line.first), record_key(line.second)} <= records["PHOTO"]
        ),
        figure_points=points_that_count(control.figure_points, points),
        given_directions=tuple(line for line in control.given_directions if {line.start, line.end} <= points),
    )


def _constant_points(point_names: tuple[str, ...], ground: Control, definition: BundleDefinition) -> NDArray[np.bool_]:
    """Return which coordinates (number of points, 3) control holds; in a free network it holds none."""
    constant = np.zeros((len(point_names), 3), dtype=bool)
    if definition.datum == "free":
        return constant
    place = places_of_names(point_names)
    for point in ground.points:
        if not point.rejected:
            constant[place[point.name]] = [error == 0.0 for error in point.errors]
    for element in ground.elements:
        if element.group == "POINT" and element.error == 0.0:
            constant[place[element.name], "XYZ".index(element.kind)] = True
    return constant


def theodolite_sets(block: Block) -> tuple[TheodoliteSet, ...]:
    """Return the theodolite sets with preliminary zero directions: the mean of azimuth less direction."""
    place = block.point_index()
    held = {
        element.name: element for element in block.elements if element.group == "THEODOLITE" and element.error == 0.0
    }
    sets = []
    for name in dict.fromkeys(direction.set for direction in block.directions):
        if name in held:
            sets.append(TheodoliteSet(name, held[name].value * RADIANS_PER_DEGREE, constant=True))
            continue
        mine = [direction for direction in block.directions if direction.set == name]
        station = block.point_start[[place[direction.station] for direction in mine]]
        offset = block.point_start[[place[direction.target] for direction in mine]] - station
        offset = (block.ground.axes_at(block.ground.to_project(station)) @ offset[:, :, None])[:, :, 0]
        turned = np.arctan2(offset[:, 0], offset[:, 1])
        turned -= np.array([direction.direction for direction in mine]) * RADIANS_PER_DEGREE
        sets.append(TheodoliteSet(name, float(np.arctan2(np.sin(turned).mean(), np.cos(turned).mean()))))
    return tuple(sets)


def _photo_points(keys: Sequence[str], point_names: tuple[str, ...], inputs: BlockInput) -> IndexedPhotoPoints:
    observations = inputs.observations
    key_place = {key: place for place, key in enumerate(keys)}
    photo = coded(observations.photos).numbers(lambda name: key_place.get(record_key(name), -1))
    point = coded(observations.points).places_among(point_names)
    photo, point = set_aside(photo), set_aside(point)
    xy = np.empty(observations.measured.shape)
    for rows, key in zip(_rows_by_photo(photo, len(keys)), keys, strict=True):
        xy[rows] = inputs.interior.to_photo[key].apply(observations.measured[rows])
    xy = set_aside(xy)
    precision = inputs.definition.measurement_precision
    sizes = inputs.interior.pixel_sizes
    units = [sizes[key] if precision.unit == "px" else (1.0, 1.0) for key in keys]
    default = (precision.value * np.array(units, dtype=np.float64).reshape(-1, 2))[photo]
    own = ~np.isnan(observations.errors)
    used = ~observations.disregarded[:, None] & ~(own & (observations.errors < 0.0))
    error = set_aside(np.where(own, np.abs(observations.errors), default))
    return IndexedPhotoPoints(photo, point, xy, error, set_aside(used))


def _rows_by_photo(photo: IntArray, count: int) -> Sequence[slice | IntArray]:
    """Return the rows of each photo; `photo` (n,) is that of each row."""
    if (photo[1:] >= photo[:-1]).all():  # as they are stored: what lies together need not be gathered
        ends = np.cumsum(np.bincount(photo, minlength=count)).tolist()
        return [slice(start, end) for start, end in pairwise([0, *ends])]
    return rows_of_groups(photo, count)
