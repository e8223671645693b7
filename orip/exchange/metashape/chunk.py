"""The chunk of a Metashape document: photos with their poses and references, markers, and scale bars.

The transform of a camera takes its axes, y down, z forward, to those of the chunk; the transform of its component takes
the chunk to the ground: geocentric coordinates where the chunk has a geographic or projected system, else that system.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.exchange.metashape.rigs import slave_matrix
from orip.exchange.sources.xml_tree import XmlElement, XmlFields, is_true
from orip.files.text.shown import shown_token
from orip.records.control import IN_PROJECT, NOT_GIVEN, ControlDistance, ControlPoint, Station, StationReference
from orip.records.exchanged import ExchangedPhoto, GroundFrame

_NEAR_THE_GROUND = (6.2e6, 6.5e6)
"""Metres from the centre of the earth."""


DEFAULT_POSITION, DEFAULT_ANGLE = 10.0, 2.0
"""Metres and degrees: Metashape's own accuracies of the reference of a camera where nothing else is known."""

_ANGLES = ("roll", "pitch", "yaw")
_ANGLE_ERRORS = (("sroll", "spitch", "syaw"), ("sypr", "sypr", "sypr"))


LEAST_RADIUS = 6e6
"""Metres from the centre of the earth that geocentric coordinates have at least."""


class ChunkTransform(Struct, frozen=True):
    """From a chunk to the ground: X = translation + scale · rotation · x."""

    rotation: FloatArray
    translation: FloatArray
    scale: float

    def pose(self, camera: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotation and projection centre on the ground of a camera's 4 x 4 matrix in the chunk."""
        return self.rotation @ camera[:3, :3], self.points(camera[:3, 3])

    def points(self, points: FloatArray) -> FloatArray:
        """Return points (..., 3) of the chunk on the ground."""
        return np.asarray(self.translation + self.scale * (points @ self.rotation.T))


IN_THE_CHUNK = ChunkTransform(np.eye(3), np.zeros(3), 1.0)


class Accuracies(Struct, frozen=True):
    """Standard deviations of a chunk that hold where a reference has none; None where the chunk has none either.

    Parameters
    ----------
    ties, projections : float or None
        Of tie points and of markers in photos, pixels.
    markers, cameras, scale_bars : float or None
        Of references, metres.
    angles : float or None
        Of references of cameras, degrees.
    """

    ties: float | None = None
    projections: float | None = None
    markers: float | None = None
    cameras: float | None = None
    scale_bars: float | None = None
    angles: float | None = None


class Marker(Struct, frozen=True):
    """A marker; `control` is None for a tie point measured by hand, and only compared where it is not enabled."""

    key: int
    name: str
    control: ControlPoint | None
    is_enabled: bool = True


class ChunkReader:
    """Reads a chunk."""

    def __init__(self, chunk: XmlElement, fields: XmlFields) -> None:
        self._chunk = chunk
        self._fields = fields
        self.crs = _text(chunk, "reference")
        self.accuracies = self._accuracies()
        self._transforms = self._read_transforms()
        self._sensors = dict(self.sensors())
        self._cameras = {camera.attributes.get("id", ""): camera for camera in self.cameras()}

    @property
    def is_on_the_ground(self) -> bool:
        """Return whether the chunk has a transform to the ground."""
        return any(transform is not IN_THE_CHUNK for transform in self._transforms.values())

    @property
    def frame(self) -> GroundFrame:
        """Return the frame of the poses: geocentric unless the chunk's system is local, or there is none."""
        if not self.is_on_the_ground or self.crs.startswith("LOCAL"):
            return GroundFrame()
        distances = [np.linalg.norm(item.translation) for item in self._transforms.values()]
        near = any(_NEAR_THE_GROUND[0] < distance < _NEAR_THE_GROUND[1] for distance in distances)
        return GroundFrame("geocentric") if self.crs or near else GroundFrame()

    def transform(self, component: str | None) -> ChunkTransform:
        """Return the transform of a component to the ground; the only one where a camera names none."""
        found = self._transforms.get(component or "")
        return found or next(iter(self._transforms.values()), IN_THE_CHUNK)

    def sensors(self) -> Iterator[tuple[str, XmlElement]]:
        """Iterate over the sensors with their ids."""
        for sensor in self._part("sensors").all("sensor"):
            yield sensor.attributes.get("id", ""), sensor

    def cameras(self) -> Iterator[XmlElement]:
        """Iterate over the cameras, in groups or not."""
        return self._part("cameras").within("camera")

    def photo(self, camera: XmlElement, sensors: Mapping[str, int]) -> ExchangedPhoto | None:
        """Return a photo; None if its sensor has no calibration."""
        key, label = self._fields.attribute_whole(camera, "id"), self._fields.attribute(camera, "label")
        sensor = sensors.get(camera.attributes.get("sensor_id", ""))
        if key is None or label is None or sensor is None:
            return None
        matrix = self._matrix(camera)
        if matrix is None:
            return ExchangedPhoto(label, sensor, key=key)
        transform = self.transform(camera.attributes.get("component_id"))
        rotation, centre = transform.pose(matrix)
        deviation = self._location_deviation(camera, transform)
        return ExchangedPhoto(
            label, sensor, tuple(rotation.ravel().tolist()), tuple(centre.tolist()), deviation, key=key
        )

    def station(self, camera: XmlElement) -> Station | None:
        """Return the observed position and attitude of a photo; None without a position. A negative error: not used.

        Angles are those of a vehicle on which the camera looks down; Metashape uses them only where it is told to.
        """
        reference = camera.child("reference")
        label = camera.attributes.get("label", "")
        place = None if reference is None else self._place(reference)
        if reference is None or place is None or None in place:
            return None
        errors = self._errors(reference, self.accuracies.cameras or DEFAULT_POSITION)
        if errors is None or None in errors:
            return None
        x, y, z = (float(value or 0.0) for value in place)
        sx, sy, sz = (float(value or 0.0) for value in errors)
        angles, angle_errors = self._angles(reference)
        return Station(label, (x, y, z), (sx, sy, sz), angles, angle_errors, line=camera.line)

    def station_reference(self) -> StationReference:
        """Return what the observed positions refer to: the chunk's system, unless that is the frame of the poses."""
        return StationReference(self.crs) if self.frame.kind == "geocentric" else IN_PROJECT

    def markers(self) -> list[Marker]:
        """Return the markers; labels that repeat are made different by the marker's id."""
        found: list[Marker] = []
        names: set[str] = set()
        for element in self._part("markers").within("marker"):
            key = self._fields.attribute_whole(element, "id")
            if key is None:
                continue
            label = element.attributes.get("label") or f"marker{key}"
            name = f"{label}_{key}" if label in names else label
            names.add(name)
            reference = element.child("reference")
            enabled = None if reference is None else reference.attributes.get("enabled")
            found.append(Marker(key, name, self._control(name, element), is_true(enabled, missing=True)))
        return found

    def distances(self, markers: Mapping[str, str]) -> tuple[list[ControlDistance], int]:
        """Return the scale bars between two markers, names by id, and the number of those that are not understood."""
        found: list[ControlDistance] = []
        lost = 0
        for element in self._part("scalebars").within("scalebar"):
            ends = [markers[key] for key in _end_ids(element) if key in markers]
            reference = element.child("reference")
            if len(ends) != 2 or reference is None or "distance" not in reference.attributes:
                lost += 1
                continue
            length = self._fields.attribute_decimal(reference, "distance")
            accuracy = self.accuracies.scale_bars or _DEFAULT_SCALE_BAR
            if "accuracy" in reference.attributes:
                accuracy = self._fields.attribute_decimal(reference, "accuracy") or accuracy
            if length is not None:
                used = is_true(reference.attributes.get("enabled"), missing=True)
                name = element.attributes.get("label") or f"scalebar{len(found) + 1}"
                error = accuracy if used else -accuracy
                found.append(ControlDistance(name, ends[0], ends[1], "XYZ", length, error, element.line))
        return found, lost

    def _control(self, name: str, element: XmlElement) -> ControlPoint | None:
        reference = element.child("reference")
        place = None if reference is None else self._place(reference)
        if reference is None or place is None:
            return None
        errors = self._errors(reference, self.accuracies.markers) or (None, None, None)
        known = tuple(error if value is not None else None for value, error in zip(place, errors, strict=True))
        return ControlPoint(name, place, (known[0], known[1], known[2]), line=element.line)

    def _place(self, reference: XmlElement) -> tuple[float | None, float | None, float | None] | None:
        """Return the coordinates of a reference; None where it has none of them."""
        values = [
            self._fields.attribute_decimal(reference, name) if name in reference.attributes else None for name in "xyz"
        ]
        x, y, z = values
        return None if x is None and y is None and z is None else (x, y, z)

    def _errors(
        self, reference: XmlElement, default: float | None
    ) -> tuple[float | None, float | None, float | None] | None:
        """Return the accuracies of a reference, negative where it is not enabled."""
        forms = (("sx", "sy", "sz"), ("sxy", "sxy", "sz"), ("sxyz", "sxyz", "sxyz"))
        form = next((names for names in forms if all(name in reference.attributes for name in names)), None)
        values: list[float | None] = [default] * 3
        if form is not None:
            values = [self._fields.attribute_decimal(reference, name) for name in form]
        if None in values:
            return None
        sign = 1.0 if is_true(reference.attributes.get("enabled"), missing=True) else -1.0
        x, y, z = (sign * (value or 0.0) for value in values)
        return x, y, z

    def _angles(self, reference: XmlElement) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return roll, pitch and heading with their errors (radians), negative where they are only compared."""
        given = reference.attributes
        form = next((names for names in _ANGLE_ERRORS if all(name in given for name in names)), None)
        values = [self._fields.attribute_decimal(reference, name) for name in _ANGLES if name in given]
        errors: list[float | None] = [self.accuracies.angles or DEFAULT_ANGLE] * 3
        if form is not None:
            errors = [self._fields.attribute_decimal(reference, name) for name in form]
        if len(values) < 3 or None in values or None in errors:
            return NOT_GIVEN, NOT_GIVEN
        sign = 1.0 if is_true(given.get("rotation_enabled"), missing=False) else -1.0
        roll, pitch, yaw = (math.radians(value or 0.0) for value in values)
        s_roll, s_pitch, s_yaw = (sign * math.radians(value or 0.0) for value in errors)
        return (roll, pitch, yaw), (s_roll, s_pitch, s_yaw)

    def _matrix(self, camera: XmlElement) -> FloatArray | None:
        if camera.child("transform") is None:
            return self._matrix_on_rig(camera)
        values = self._fields.decimals(camera, "transform", 16)
        return None if values is None else np.array(values).reshape(4, 4)

    def _matrix_on_rig(self, camera: XmlElement) -> FloatArray | None:
        """Return the matrix of a slave camera from that of its master."""
        master = self._cameras.get(camera.attributes.get("master_id", ""))
        sensor = self._sensors.get(camera.attributes.get("sensor_id", ""))
        if master is None or sensor is None or master.child("transform") is None:
            return None
        of_master, of_sensor = self._matrix(master), slave_matrix(sensor, self._fields)
        return None if of_master is None or of_sensor is None else of_master @ of_sensor

    def _location_deviation(self, camera: XmlElement, transform: ChunkTransform) -> tuple[float, float, float] | None:
        if camera.child("location_covariance") is None:
            return None
        values = self._fields.decimals(camera, "location_covariance", 9)
        if values is None:
            return None
        turned = transform.rotation @ np.array(values).reshape(3, 3) @ transform.rotation.T
        x, y, z = (transform.scale * math.sqrt(max(float(turned[n, n]), 0.0)) for n in range(3))
        return x, y, z

    def _read_transforms(self) -> dict[str, ChunkTransform]:
        """Return transforms by the id of their component; "" is the chunk's own, of documents before 1.5."""
        found = {
            item.attributes.get("id", ""): self._transform(item) for item in self._part("components").all("component")
        }
        return found or {"": self._transform(self._chunk)}

    def _transform(self, owner: XmlElement) -> ChunkTransform:
        element = owner.child("transform")
        if element is None or element.child("rotation") is None:
            return IN_THE_CHUNK
        rotation = self._fields.decimals(element, "rotation", 9)
        translation = self._fields.decimals(element, "translation", 3)
        scale = self._fields.decimal(element, "scale")
        if rotation is None or translation is None or scale is None:
            return IN_THE_CHUNK
        if scale <= 0:
            self._fields.faults.complain("the scale of a transform has to be above 0; correct it", element.line)
        return ChunkTransform(np.array(rotation).reshape(3, 3), np.array(translation), scale)

    def _accuracies(self) -> Accuracies:
        names = ("tiepoints", "projections", "markers", "cameras", "scalebars", "cameras_ypr")
        settings = {
            item.attributes.get("name", "").removeprefix("accuracy_"): item
            for item in self._part("settings").all("property")
        }
        values = [
            self._fields.attribute_decimal(settings[name], "value") if name in settings else None for name in names
        ]
        return Accuracies(*(value if value is not None and value > 0 else None for value in values))

    def _part(self, tag: str) -> XmlElement:
        found = self._chunk.child(tag)
        return XmlElement(tag, self._chunk.line, {}) if found is None else found


_DEFAULT_SCALE_BAR = 0.001
"""Metres; Metashape's default accuracy of scale bars."""


def chunk_of(root: XmlElement, fields: XmlFields) -> XmlElement | None:
    """Return the chunk of a document, the active or first one; None, and a complaint kept, if there is none."""
    chunk = root if root.tag == "chunk" else next(root.within("chunk"), None)
    if chunk is None:
        fields.faults.complain(
            f"there is no chunk in <{shown_token(root.tag)}>; export the cameras of a chunk", root.line
        )
    return chunk


def _end_ids(element: XmlElement) -> list[str]:
    """Return the ids of markers that a scale bar refers to, in attributes or in elements of its own."""
    own = [value for name, value in element.attributes.items() if name.startswith(("marker", "point")) and "id" in name]
    ends = [*element.within("marker"), *element.within("endpoint"), *element.within("point")]
    return own + [end.attributes.get("marker_id", end.attributes.get("id", "")) for end in ends]


def _text(parent: XmlElement, tag: str) -> str:
    found = parent.child(tag)
    return "" if found is None else found.text.strip()
