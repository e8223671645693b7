"""What is measured in a session, found by photo and by point, and gathered as blocks as small as a single ray.

A block of everything would have to be gathered again for every measurement. Values and equations of a new ray need the
rays of its point, or of its photo, and what control observes of these; they are gathered alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

import numpy as np
from msgspec import Struct

from orip.bundle.antennas import NONE, antenna_of, is_shifted
from orip.bundle.assemble import BlockInput, gather
from orip.bundle.local_frame import ground_system
from orip.errors import ProjectWarning
from orip.records.block import Block
from orip.records.control import Control, ControlDistance, ControlElement, ControlPoint, Station
from orip.records.ground import GroundSystem
from orip.records.measurement import PhotoObservations, no_observations
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.rig import Rigs
from orip.structs import replace
from orip.wording import counted_names

Pair = tuple[float, float]

Measurement = tuple[str, str, Pair]
"""Photo, point and stored coordinates; see `PhotoObservations.measured`."""

RayName = tuple[str, str]
"""Photo, as it is defined, and point."""

_NO_ERRORS = (np.nan, np.nan)


class _Ray(Struct, frozen=True):
    """Stored coordinates of a photo point and its own a-priori errors, NaN for those of the bundle."""

    xy: Pair
    errors: Pair = _NO_ERRORS


_HELD = 1e-3
"""Part of what photo points are good to on the ground that coordinates are known to which are as good as held: the
solution differs by a millionth of a standard deviation from that with constants, and the equations are the same."""


def _testable(inputs: BlockInput, part: float = 1.0) -> Control:
    """Return the control with held coordinates as observations that are as precise as photo points are on the ground.

    Only what is observed can be tested: control that is held would make what is measured near to a wrong point suspect.

    Parameters
    ----------
    part : float
        Of that precision, what they are given.
    """
    control = inputs.control
    known = [point.coordinates for point in control.points if None not in point.coordinates]
    if inputs.definition.datum == "free" or len(known) < 2:
        return control
    error = part * ray_error(inputs) * float(np.ptp(np.array(known, dtype=np.float64), axis=0).max())

    def observed(point: ControlPoint) -> ControlPoint:
        x, y, z = (error if given == 0.0 else given for given in point.errors)
        return replace(point, errors=(x, y, z)) if point.kind == "control" and error > 0.0 else point

    return replace(control, points=tuple(map(observed, control.points)))


def _steady_stations(inputs: BlockInput) -> tuple[Station, ...]:
    """Return the exposure stations without an unknown shift or drift."""

    def is_steady(station: Station) -> bool:
        photo = inputs.records.photos.get(record_key(station.photo))
        row = NONE if photo is None else antenna_of(inputs.antennas, photo.camera)
        return row == NONE or not is_shifted(inputs.antennas[row], station.strip)

    return tuple(filter(is_steady, inputs.control.stations))


def ray_error(inputs: BlockInput) -> float:
    """Return the a-priori error of the direction of a ray, radians: that of photo coordinates over the typical C."""
    precision = inputs.definition.measurement_precision
    sizes = [size for pair in inputs.interior.pixel_sizes.values() for size in pair]
    pixel = float(np.median(sizes)) if precision.unit == "px" and sizes else 1.0
    distances = [camera.parameters[0] for camera in inputs.records.cameras.values() if camera.parameters[0] > 0.0]
    return precision.value * pixel / float(np.median(distances)) if distances else 0.0


class _ControlByName:
    """All control of a project, found by the points and photos that it is about."""

    def __init__(self, control: Control) -> None:
        self.points: dict[str, list[ControlPoint]] = {}
        for point in control.points:
            self.points.setdefault(point.name, []).append(point)
        self.distances: dict[str, list[ControlDistance]] = {}
        for distance in control.distances:
            for name in (distance.start, distance.end):
                self.distances.setdefault(name, []).append(distance)
        self._of_cameras = [element for element in control.elements if element.group == "CAMERA"]
        self._elements: dict[str, list[ControlElement]] = {}
        for element in control.elements:
            name = record_key(element.name) if element.group == "PHOTO" else element.name
            self._elements.setdefault(f"{element.group} {name}", []).append(element)
        self._stations: dict[str, list[Station]] = {}
        for station in control.stations:
            self._stations.setdefault(record_key(station.photo), []).append(station)

    def about(self, photos: Collection[str], points: Collection[str]) -> Control:
        """Return what is observed of some photos and points; directions are left to the adjustment."""
        keys = [record_key(photo) for photo in photos]
        of_records = [f"PHOTO {key}" for key in keys] + [f"POINT {name}" for name in points]
        distances = {id(line): line for name in points for line in self.distances.get(name, ())}
        return Control(
            tuple(point for name in points for point in self.points.get(name, ())),
            (*self._of_cameras, *(element for name in of_records for element in self._elements.get(name, ()))),
            tuple(distances.values()),
            (),
            tuple(station for key in keys for station in self._stations.get(key, ())),
        )

    def has_coordinates(self, name: str) -> bool:
        """Return whether control gives all coordinates of a point; preliminary ones may be far off."""
        given = {
            place
            for point in self.points.get(name, ())
            if point.kind == "control"
            for place in range(3)
            if point.coordinates[place] is not None
        }
        constant = {
            "XYZ".index(element.kind) for element in self._elements.get(f"POINT {name}", ()) if element.error == 0.0
        }
        return len(given | constant) == 3

    def is_about(self, name: str) -> bool:
        """Return whether anything is known of a point: coordinates, or a distance to another one."""
        return name in self.points or name in self.distances or f"POINT {name}" in self._elements

    def elements_of(self, photo: str) -> frozenset[str]:
        """Return which elements of the orientation of a photo are observed."""
        return frozenset(element.kind for element in self._elements.get(f"PHOTO {record_key(photo)}", ()))

    def tied_to(self, points: Iterable[str]) -> set[str]:
        """Return the points that distances tie to some points, with these themselves where any does."""
        return {
            name
            for point in points
            for line in self.distances.get(point, ())
            for name in (line.start, line.end)
        }  # fmt: skip


class Measurements:
    """The rays of a session.

    Additional parameters, directions, and exposure stations with an unknown shift or drift are left to the adjustment
    of the whole block.

    Parameters
    ----------
    inputs : BlockInput
        Its observations are those that there are at the beginning; none is needed.

    Raises
    ------
    InputError
        If what is measured cannot be gathered, or nothing tells where a block with a crs lies.
    """

    def __init__(self, inputs: BlockInput) -> None:
        # one point's errors may be left out without changing the equations of others
        control = replace(inputs.control, stations=_steady_stations(inputs), correlations=())
        self._inputs = replace(inputs, control=control, terrains=())
        # what is known of points and photos does not depend on which one counts
        self._testable, self._held = (
            _ControlByName(_testable(self._inputs)),
            _ControlByName(_testable(self._inputs, _HELD)),
        )
        self.control = self._testable
        self._antennas = tuple(replace(antenna, unknown=(), shift="none", drift="none") for antenna in inputs.antennas)
        self._of_photo: dict[str, dict[str, _Ray]] = {}
        self._of_point: dict[str, dict[str, _Ray]] = {}
        self._count = 0
        self._whole: Block | None = None
        self._ground = ground_system(inputs.crs, inputs.ground_unit, inputs.control.points, self._known_centres())
        given = inputs.measured.observations.get(record_key(inputs.definition.name))
        if given is not None:
            rows = zip(given.photos, given.points, given.measured.tolist(), given.errors.tolist(), strict=True)
            for photo, point, (x, y), errors in rows:
                self._set(self.name_of(photo), point, _Ray((x, y), tuple(errors)))

    def _known_centres(self) -> np.ndarray:
        nothing = (np.nan,) * 3
        known = [
            [np.nan if value is None else value for value in photo.orientation[:3]]
            for photo in self._inputs.records.photos.values()
        ]
        observed = [station.position for station in self._inputs.control.stations]
        return np.array([*known, *observed, nothing], dtype=np.float64).reshape(-1, 3)

    def __len__(self) -> int:
        return self._count

    @property
    def photos(self) -> tuple[str, ...]:
        """Return the photos in which something is measured, in the order of their first points."""
        return tuple(self._of_photo)

    @property
    def points(self) -> tuple[str, ...]:
        """Return the points that are measured, in the order of their first rays."""
        return tuple(self._of_point)

    @property
    def observations(self) -> PhotoObservations:
        """Return all rays as observations of the bundle."""
        return self._as_observations((photo, point, ray) for photo, point, ray in self._all())

    @property
    def ground(self) -> GroundSystem:
        """Return the system in which the blocks of the session are computed."""
        return self._ground

    @property
    def inputs(self) -> BlockInput:
        """Return what the session was begun with."""
        return self._inputs

    @property
    def softens_control(self) -> bool:
        """Return whether control that the project holds is observed now, so that it can be tested."""
        return self.control is self._testable and self._testable.points != self._held.points

    def hold_control(self, *, held: bool) -> None:
        """Let held control be as good as held, or be observed again."""
        self.control = self._held if held else self._testable
        self._whole = None

    def has_orientation(self, photo: str) -> bool:
        """Return whether all six elements of a photo are observed or constant: others are at most approximate."""
        record = self._inputs.records.photos.get(record_key(photo))
        constant = frozenset[str]() if record is None else frozenset(record.constant)
        return len(constant | self.control.elements_of(photo)) == len(PHOTO_PARAMETERS)

    def name_of(self, photo: str) -> str:
        """Return the name of a photo as it is defined."""
        record = self._inputs.records.photos.get(record_key(photo))
        return photo if record is None else record.name

    def points_in(self, photo: str) -> Collection[str]:
        """Return the points that are measured in a photo."""
        return self._of_photo.get(photo, {}).keys()

    def photos_of(self, point: str) -> Collection[str]:
        """Return the photos in which a point is measured."""
        return self._of_point.get(point, {}).keys()

    def sharing(self, points: Iterable[str]) -> set[str]:
        """Return the photos that show some of the points."""
        return {photo for point in points for photo in self._of_point.get(point, ())}

    def at(self, photo: str, point: str) -> Pair | None:
        """Return the stored coordinates of a photo point; None if it is not measured."""
        ray = self._of_photo.get(photo, {}).get(point)
        return None if ray is None else ray.xy

    def put(self, measurement: Measurement) -> bool:
        """Add a photo point, or replace what was measured of it; return whether it was measured before.

        Raises
        ------
        InputError
            If the photo is not defined or has no interior orientation; nothing has changed then.
        """
        photo, point, xy = measurement
        before = self._of_photo.get(photo, {}).get(point)
        if photo not in self._of_photo:
            self._gathered([(photo, point, _Ray(xy))])
        self._set(photo, point, _Ray(xy) if before is None else replace(before, xy=xy))
        return before is not None

    def remove(self, photo: str, point: str) -> None:
        """Delete a photo point.

        Raises
        ------
        KeyError
            If it is not measured.
        """
        del self._of_photo[photo][point], self._of_point[point][photo]
        if not self._of_photo[photo]:
            del self._of_photo[photo]
        if not self._of_point[point]:
            del self._of_point[point]
        self._count -= 1
        self._whole = None

    def part(self, rays: Iterable[RayName]) -> Block | None:
        """Return the block of some rays, and what control observes of their photos and points; None without rays."""
        chosen = [(photo, point, self._of_photo[photo][point]) for photo, point in dict.fromkeys(rays)]
        return self._gathered(chosen) if chosen else None

    def as_if(self, measured: Iterable[Measurement]) -> Block | None:
        """Return the block of rays that are not measured, with the coordinates that they would have."""
        chosen = [(photo, point, _Ray(xy)) for photo, point, xy in measured]
        return self._gathered(chosen) if chosen else None

    def whole(self) -> Block | None:
        """Return the block of all rays; None if there are none."""
        if self._whole is None and self._count:
            self._whole = self._gathered(list(self._all()))
        return self._whole

    def _all(self) -> Iterator[tuple[str, str, _Ray]]:
        return ((photo, point, ray) for photo, rays in self._of_photo.items() for point, ray in rays.items())

    def _set(self, photo: str, point: str, ray: _Ray) -> None:
        self._count += point not in self._of_photo.setdefault(photo, {})
        self._of_photo[photo][point] = self._of_point.setdefault(point, {})[photo] = ray
        self._whole = None

    def _as_observations(self, rays: Iterable[tuple[str, str, _Ray]]) -> PhotoObservations:
        chosen, bundle = list(rays), self._inputs.definition.name
        if not chosen:
            return no_observations(bundle)
        photos, points, values = zip(*chosen, strict=True)
        return PhotoObservations(
            bundle,
            photos,
            points,
            np.array([ray.xy for ray in values], dtype=np.float64),
            np.array([ray.errors for ray in values], dtype=np.float64),
            np.zeros(len(chosen), dtype=bool),
        )

    def _gathered(self, rays: list[tuple[str, str, _Ray]]) -> Block:
        photos, points = dict.fromkeys(photo for photo, _, _ in rays), dict.fromkeys(point for _, point, _ in rays)
        observations: Mapping[str, PhotoObservations] = {
            record_key(self._inputs.definition.name): self._as_observations(rays)
        }
        ends = self.control.tied_to(points)
        inputs = replace(
            self._inputs,
            measured=replace(self._inputs.measured, observations=dict(observations)),
            control=self.control.about(photos, [*points, *sorted(ends - points.keys())]),
            preliminary=(),
            antennas=self._antennas,
            rigs=Rigs(),  # photos of an exposure are measured one after the other
            warnings=(),
        )
        block = gather(inputs, self._ground)
        return replace(block, cameras=tuple(replace(camera, additional_set=None) for camera in block.cameras))


def places_of(observations: PhotoObservations) -> dict[tuple[str, str], tuple[tuple[float, float], bool]]:
    """Return by photo and point what is measured, and whether it is disregarded."""
    measured, disregarded = observations.measured.tolist(), observations.disregarded.tolist()
    rows = zip(observations.photos, observations.points, measured, disregarded, strict=True)
    return {(photo, point): ((x, y), is_disregarded) for photo, point, (x, y), is_disregarded in rows}


def left_to_the_adjustment(rigs: Rigs, control: Control) -> tuple[ProjectWarning, ...]:
    """Return what a session does not know of rigs and control: photos and points are tested one by one."""
    found = []
    if rigs.exposures:
        text = (
            "a session tests the photos of an exposure one by one, without the mountings of their cameras: it finds "
            "less, and tells larger standard deviations than 'orip solve', which adjusts them as rigs"
        )
        names = counted_names("rig", [rig.name for rig in rigs.rigs])
        found.append(ProjectWarning("rigs-while-measuring", names, text))
    if control.correlations:
        text = (
            "a session takes each control point with its own covariances alone; 'orip solve' takes those between "
            "points, too"
        )
        names = counted_names("point", sorted({pair.first for pair in control.correlations}))
        found.append(ProjectWarning("covariances-while-measuring", names, text))
    return tuple(found)
