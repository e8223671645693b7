"""A session without control: a local system from the first two photos, and from there to the ground."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.bundle.antennas import part_of_block
from orip.bundle.assemble import BlockInput
from orip.bundle.points.starting import given_coordinates, with_starting_points
from orip.errors import NotSolvableError, ProjectWarning
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.geometry.similarity import Similarity
from orip.online.block.current_values import orientation_to_first
from orip.online.block.first_photos import FirstValues
from orip.online.block.measurements import Measurements
from orip.prelim.resection.known_points import image_configuration
from orip.prelim.similarity.absolute_orientation import fit_to_control
from orip.prelim.similarity.adjustment import CommonPoints
from orip.records.block import Block
from orip.records.control import Control
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.preliminary import PreliminaryValues
from orip.solving.starting_values import StartedBlock
from orip.structs import replace

# Nothing is known of the ground: the six elements of one photo are held, and the largest coordinate of the base of the
# second one, which gives the scale. The network is held by as little as can be; what is tested does not depend on it.

IN_LOCAL_SYSTEM = "local system, no control yet"
NOT_ENOUGH = "local system, not enough control yet"

_PLANE, _HEIGHTS = 2, 3
"""Points known in X and Y, and in Z, that determine a similarity at the least."""

_STATIONS = 3
"""Exposure stations that do."""

_BENT = 1e-3
"""Part of the distance of points from the photos that a block without control may be bent by."""


class LocalSystem(Struct, frozen=True):
    """The system of a session without control.

    Parameters
    ----------
    project : Measurements
        Those with all that the project knows of the ground.
    first, second : str
        Photos that hold the system.
    orientation : array (6,)
        Of the second photo in the axes of the first, radians; its base is 1.
    """

    project: Measurements
    first: str
    second: str
    orientation: FloatArray

    @property
    def inputs(self) -> BlockInput:
        """Return what a block in the local system is begun with."""
        given, held = self.project.inputs, PHOTO_PARAMETERS[int(np.argmax(np.abs(self.orientation[:3])))]
        photos = {
            key: replace(photo, orientation=(None,) * 6, constant=()) for key, photo in given.records.photos.items()
        }
        at = np.concatenate([self.orientation[:3], np.degrees(self.orientation[3:])])
        for name, values, constant in (
            (self.first, np.zeros(6), PHOTO_PARAMETERS),
            (self.second, at, (held,)),
        ):
            key = record_key(name)
            photos[key] = replace(photos[key], orientation=tuple(values.tolist()), constant=constant)
        of_cameras = tuple(element for element in given.control.elements if element.group == "CAMERA")
        return replace(
            given,
            definition=replace(given.definition, datum="control", datum_points=()),
            records=replace(given.records, photos=photos),
            control=Control(elements=of_cameras),
            preliminary=(),
            crs=None,
            antennas=(),
        )

    @property
    def first_values(self) -> FirstValues:
        """Return how the first two photos are oriented."""
        return FirstValues(_no_chain, known=self._started)

    def _started(self, block: Block) -> StartedBlock:
        names = [photo.name for photo in block.photos]
        orientation = np.full((len(names), 6), np.nan)
        orientation[names.index(self.first)] = 0.0
        orientation[names.index(self.second)] = self.orientation
        return _started_with(block, orientation)

    def description(self, measurements: Measurements) -> str:
        """Return in words that there is no control, or not enough of it."""
        known = self._known(measurements)
        return NOT_ENOUGH if known.points or known.stations or known.elements else IN_LOCAL_SYSTEM

    def may_leave(self, measurements: Measurements) -> bool:
        """Return whether what is known of the ground may determine where the photos are."""
        known = self._known(measurements)
        given = np.array([[value is not None for value in point.coordinates] for point in known.points], dtype=bool)
        x, y, z = given.sum(axis=0).tolist() if len(given) else (0, 0, 0)
        return (
            (min(x, y) >= _PLANE and z >= _HEIGHTS)
            or len(known.stations) >= _STATIONS
            or len({element.name for element in known.elements}) > 0
            or any(map(self.project.has_orientation, measurements.photos))
        )

    def _known(self, measurements: Measurements) -> Control:
        """Return what is known of the photos and points that are measured."""
        found = self.project.control.about(measurements.photos, measurements.points)
        return replace(
            found,
            points=tuple(point for point in found.points if point.kind == "control"),
            elements=tuple(element for element in found.elements if element.group != "CAMERA"),
        )

    def shown(
        self, photos: Sequence[str], orientations: Mapping[str, FloatArray], points: Mapping[str, FloatArray]
    ) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return values as they are shown: the first measured photo at the origin, the base to the next as given, or 1.

        They do not depend on which photos hold the system meanwhile.

        Parameters
        ----------
        photos : sequence of str
            Oriented ones, in the order in which they are measured.
        orientations, points : mappings of arrays (6,) and (3,)
        """
        first, second = photos[:2]
        turn = rotation_from_angles(orientations[first][None, 3:])[0].T
        base = np.linalg.norm(orientations[second][:3] - orientations[first][:3])
        scale = float(self._given_base(first, second) / base)
        to_shown = Similarity(scale, turn, -scale * (turn @ orientations[first][:3]))
        return (
            {name: _moved(value, to_shown) for name, value in orientations.items()},
            {name: to_shown.apply(value) for name, value in points.items()},
        )

    def _given_base(self, first: str, second: str) -> float:
        """Return the distance of two photos by their approximate orientations or stations; 1 if there is none."""
        stations = {record_key(one.photo): one.position for one in self.project.inputs.control.stations}
        records = self.project.inputs.records.photos
        places = []
        for key in map(record_key, (first, second)):
            given = [np.nan if value is None else value for value in records[key].orientation[:3]]
            observed = np.array(stations.get(key, given), dtype=np.float64)
            places.append(observed if np.isfinite(observed).all() else np.array(given, dtype=np.float64))
        if not np.isfinite(places).all():
            return 1.0
        start, end = self.project.ground.to_local(np.array(places))
        return float(np.linalg.norm(end - start)) or 1.0


def local_system(project: Measurements) -> LocalSystem | None:
    """Return the local system of the first two photos that can be oriented to each other; None if there are none."""
    for first, second in _pairs(project):
        mine = project.points_in(second)
        # in the order of measuring, as relative orientation draws samples of them
        common = [point for point in project.points_in(first) if point in mine]
        part = project.part((photo, point) for photo in (first, second) for point in common)
        if part is None or _is_poor(part):
            continue
        if (orientation := orientation_to_first(part)) is not None:
            return LocalSystem(project, first, second, orientation)
    return None


def _pairs(project: Measurements) -> Iterator[tuple[str, str]]:
    for row, second in enumerate(project.photos):
        for first in project.photos[:row]:
            yield first, second


def _is_poor(pair: Block) -> bool:
    """Return whether common points lie too closely together, or on a line, in the first photo."""
    xy = pair.photo_points.xy[pair.photo_points.photo == 0]
    frame = pair.cameras[0].frame
    return frame is not None and image_configuration(xy, frame, xy).shortcoming is not None


def on_ground(
    values: FirstValues, orientations: Mapping[str, FloatArray], points: Mapping[str, FloatArray]
) -> FirstValues:
    """Return how photos are oriented on the ground that have values in a local system: by a similarity first."""

    def started(block: Block) -> StartedBlock:
        to_ground = _similarity(block, orientations, points)
        nothing = np.full(6, np.nan)
        moved = [
            _moved(orientations[photo.name], to_ground) if photo.name in orientations else nothing
            for photo in block.photos
        ]
        constant = np.array([[kind in photo.constant for kind in PHOTO_PARAMETERS] for photo in block.photos])
        return _started_with(block, np.where(constant, block.photo_orientation, np.array(moved)))

    return replace(values, known=started)


def _similarity(block: Block, orientations: Mapping[str, FloatArray], points: Mapping[str, FloatArray]) -> Similarity:
    """Return the similarity from local values to the ground, by control points that are known in both."""
    observed = {point.name for point in block.control_points if point.kind == "control"}
    given = given_coordinates(block)
    rows = [
        row
        for row, name in enumerate(block.point_names)
        if name in points and name in observed and np.isfinite(given[row]).any()
    ]
    target = given[rows]
    full = np.isfinite(target).all(axis=1)
    target[full] = block.ground.to_local(target[full])
    source = np.array([points[block.point_names[row]] for row in rows]).reshape(-1, 3)
    values = np.array(list(orientations.values()))
    distance = float(np.median(np.linalg.norm(np.array(list(points.values())) - values[:, :3].mean(axis=0), axis=1)))
    deviation = np.full_like(source, _BENT * distance)
    common = CommonPoints(source, target, deviation, np.zeros_like(target), np.zeros(len(rows), dtype=bool))
    try:
        return fit_to_control(common, rotation_from_angles(values[:, 3:]), []).similarity
    except ValueError as error:
        raise NotSolvableError(str(error)) from None


def _started_with(block: Block, orientation: FloatArray) -> StartedBlock:
    """Return the photos of a block that are oriented, and the points with coordinates or two of their rays."""
    oriented: BoolArray = np.asarray(np.isfinite(orientation).all(axis=1))
    rays = block.photo_points
    seen = np.bincount(rays.point[oriented[rays.photo]], minlength=len(block.point_names))
    gathered = part_of_block(replace(block, photo_orientation=orientation), oriented, seen > 1)
    left_out = tuple(
        ProjectWarning("not-oriented", f"photo {photo.name}", f"photo {photo.name} waits: it has no values yet")
        for photo, is_oriented in zip(block.photos, oriented.tolist(), strict=True)
        if not is_oriented
    )
    return StartedBlock(with_starting_points(gathered)[0], gathered, left_out)


def _moved(orientation: FloatArray, similarity: Similarity) -> FloatArray:
    rotation = similarity.rotation @ rotation_from_angles(orientation[None, 3:])[0]
    return np.concatenate([similarity.apply(orientation[:3]), angles_from_rotation(rotation[None])[0]])


def _no_chain(_block: Block) -> PreliminaryValues:
    message = "nothing is known of the ground"
    raise NotSolvableError(message)
