"""A project of Metashape: exported cameras and markers (XML), or the project itself with its tie points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.errors import Complaint
from orip.exchange.metashape.chunk import LEAST_RADIUS, ChunkReader, Marker, chunk_of
from orip.exchange.metashape.project_files import TieCloud, is_project, read_project_chunk
from orip.exchange.metashape.references import reference_tables_beside, with_references
from orip.exchange.metashape.rigs import exposures_of_cameras, is_rolling, rigs_of_sensors
from orip.exchange.metashape.sensors import read_sensor
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import XmlElement, XmlFields, is_true, read_xml
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed, shown_token
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, PoseReading
from orip.structs import replace
from orip.wording import counted, counted_names

Vertices = np.ndarray[Any, Any]
"""Array (n,) whose fields are the properties of the vertices."""

_TYPES = {
    "char": "<i1", "int8": "<i1", "uchar": "<u1", "uint8": "<u1",
    "short": "<i2", "int16": "<i2", "ushort": "<u2", "uint16": "<u2",
    "int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4",
    "float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8",
}  # fmt: skip

_LONGEST_HEAD = 4096
_END = b"end_header\n"


def read_vertices(data: bytes, needed: tuple[str, ...], faults: Faults) -> Vertices | None:
    """Return the vertices of a file.

    Parameters
    ----------
    data : bytes
        The file.
    needed : tuple of str
        Properties that have to be there.
    faults : Faults
        Takes the complaints; None is returned with them.
    """
    length = data.find(_END, 0, _LONGEST_HEAD)
    if not data.startswith(b"ply") or length < 0:
        faults.complain("this is not a PLY file; save the project again", 1)
        return None
    found = _layout(data[:length].decode("ascii", errors="replace").splitlines(), faults)
    if found is None:
        return None
    count, properties = found
    missing = [name for name in needed if name not in dict(properties)]
    if missing or len(dict(properties)) < len(properties):
        said = f"no property {missing[0]}" if missing else "a property twice"
        faults.complain(f"the vertices have {said}; this layout is not known", 1)
        return None
    layout = np.dtype(properties)
    begin = length + len(_END)
    if count * layout.itemsize > len(data) - begin:
        room = (len(data) - begin) // layout.itemsize
        faults.complain(
            f"{count} vertices are announced, and there is room for {room} after byte {begin}: the file is cut off "
            "or its head is wrong; save the project again",
            1,
        )
        return None
    return np.frombuffer(data, dtype=layout, count=count, offset=begin)


def _layout(head: list[str], faults: Faults) -> tuple[int, list[tuple[str, str]]] | None:
    """Return the number of vertices, the first element, and names and types of their properties."""
    if "format binary_little_endian 1.0" not in head:
        faults.complain("only binary PLY files (little endian) are read; save the project again", 2)
        return None
    count, properties = None, []
    for number, line in enumerate(head, start=1):
        words = line.split()
        if words[:1] == ["element"]:
            if count is not None:
                break
            is_vertex = len(words) == 3 and words[1] == "vertex"
            count = faults.whole(words[2], "number of vertices", number) if is_vertex else None
            if count is None:
                faults.complain("the first element has to be 'element vertex' and its number", number)
                return None
        elif words[:1] == ["property"] and count is not None:
            if len(words) != 3 or words[1] not in _TYPES:
                faults.complain(f"the property '{shown_token(line)}' is of no known type", number)
                return None
            properties.append((words[2], _TYPES[words[1]]))
    if count is None or not properties:
        faults.complain("there are no vertices in the head of the file; save the project again", 1)
        return None
    return count, properties


# A vertex has the number of its track. Coordinates are those of the chunk, projections are pixels from the outer
# corner.

_POINT, _PROJECTION = ("x", "y", "z", "id"), ("x", "y", "id")


def add_ties(
    cloud: TieCloud, chunk: ChunkReader, photos: Mapping[int, int], points: CollectedPoints, rays: CollectedRays
) -> list[str]:
    """Add the tie points that have coordinates, with their projections; return notes on what is left out.

    Parameters
    ----------
    chunk : ChunkReader
        Takes coordinates to the ground.
    photos : mapping of int to int
        Places of the photos by the ids of their cameras.
    """
    tracks, places = _added_points(cloud, chunk, points)
    lost = 0
    for element in cloud.element.all("projections"):
        key = cloud.fields.attribute_whole(element, "camera_id")
        vertices = _vertices(cloud, element, _PROJECTION)
        if vertices is None or key is None or key not in photos:
            continue
        track = vertices["id"].astype(np.int64)
        row = np.minimum(np.searchsorted(tracks, track), max(0, len(tracks) - 1))
        is_known = tracks[row] == track if len(tracks) else np.zeros(len(track), dtype=np.bool_)
        lost += int((~is_known).sum())
        image = _coordinates(vertices, ("x", "y"))[is_known]
        rays.extend(np.full(len(image), photos[key], dtype=np.int64), places[row[is_known]], image)
    return [f"{counted(lost, 'projection')} of tracks without a point, left out."] if lost else []


def _added_points(cloud: TieCloud, chunk: ChunkReader, points: CollectedPoints) -> tuple[IntArray, IntArray]:
    """Add points; return their tracks in ascending order, and their places."""
    tracks, places = [], []
    for element in cloud.element.all("points"):
        vertices = _vertices(cloud, element, _POINT)
        if vertices is None:
            continue
        transform = chunk.transform(element.attributes.get("component_id"))
        with np.errstate(all="ignore"):  # coordinates of a damaged file may be of any size; those not finite are lost
            ground = transform.points(_coordinates(vertices, _POINT[:3]))
        for track, place in zip(vertices["id"].tolist(), _valid(ground), strict=True):
            tracks.append(int(track))
            places.append(points.add(str(int(track)), place, is_track=True))
    found, first = np.unique(np.array(tracks, dtype=np.int64), return_index=True)
    return found, np.array(places, dtype=np.int64)[first]


def _valid(ground: FloatArray) -> Iterator[tuple[float, ...] | None]:
    for place in ground.tolist():
        yield tuple(place) if all(value - value == 0.0 for value in place) else None  # neither infinite nor NaN


def _coordinates(vertices: Vertices, names: tuple[str, ...]) -> FloatArray:
    return np.stack([vertices[name].astype(np.float64) for name in names], axis=1)


def _vertices(cloud: TieCloud, element: XmlElement, needed: tuple[str, ...]) -> Vertices | None:
    name = cloud.fields.attribute(element, "path")
    data = None if name is None else cloud.members.read(name)
    return None if data is None or name is None else read_vertices(data, needed, cloud.members.of_member(name))


READING = PoseReading("y_down", "to_ground", "matrix", "radian", "centre")

_MARKERS = "markers.xml"
_BEGINNING = 2000


def is_metashape(source: Path) -> bool:
    """Return whether a file is a project or begins as an exported document does, or a folder has cameras.xml."""
    path = source / "cameras.xml" if source.is_dir() else source
    if is_project(path):
        return True
    text = beginning(path, _BEGINNING) if path.suffix.lower() == ".xml" else ""
    return "<document" in text and "<chunk" in text


class Document(Struct, frozen=True):
    """The chunk of a document, read.

    Parameters
    ----------
    frames : tuple of (XmlElement, XmlFields)
        With the measurements of markers, and the document that each of them is in.
    """

    chunk: ChunkReader
    element: XmlElement
    fields: XmlFields
    frames: tuple[tuple[XmlElement, XmlFields], ...]
    ties: TieCloud | None = None
    notes: tuple[str, ...] = ()


def read_document(path: Path, faults: Faults) -> Document | None:
    """Return the chunk of a document; None, and complaints kept, if it has none."""
    root = read_xml(path, faults)
    fields = XmlFields(faults)
    element = None if root is None else chunk_of(root, fields)
    if element is None:
        return None
    frames = tuple((frame, fields) for frame in element.within("frame"))
    return Document(ChunkReader(element, fields), element, fields, frames)


def read_project(path: Path, faults: Faults) -> Document | None:
    """Return the chunk of a project, `.psx` or `.psz`; None, and complaints kept, if it cannot be read."""
    found = read_project_chunk(path, faults)
    if found is None:
        return None
    frames = () if found.frame is None else (found.frame,)
    chunk = ChunkReader(found.element, found.fields)
    return Document(chunk, found.element, found.fields, frames, found.ties, found.notes)


def read_metashape(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a project (`.psx`, `.psz`), or cameras (``Export Cameras``, Agisoft XML) with markers.

    Markers are in the document of the cameras, or in ``markers.xml`` beside it. References in tables (CSV) beside it
    count before those in the documents.
    """
    path = source / "cameras.xml" if source.is_dir() else source
    named = f"{shown}/cameras.xml" if source.is_dir() else shown
    complaints: list[Complaint] = []
    read = read_project if is_project(path) else read_document
    document = read(path, Faults(named, complaints))
    if document is None:
        return Parsed(None, tuple(complaints))
    beside = path.with_name(_MARKERS)
    other = None
    if read is read_document and not any(document.element.within("marker")) and beside.is_file() and beside != path:
        other = read_document(beside, Faults(str(Path(named).with_name(_MARKERS)), complaints))
    project = project_of(document, other or document)
    if project is None and not complaints:
        complaints.append(Complaint("no camera of the chunk is aligned and calibrated; align the photos first", named))
    elif project is not None and read is read_document:
        for table in reference_tables_beside(path):
            referenced = with_references(project, table, str(Path(named).with_name(table.name)))
            project = referenced.value
            complaints += referenced.complaints
    return Parsed(None if complaints else project, tuple(complaints))


def project_of(document: Document, markers: Document) -> ExchangedProject | None:
    """Return the project of a document and of one with its markers; None if no photo of it is oriented."""
    chunk = document.chunk
    notes = list(document.notes)
    cameras, places = _cameras(document, notes)
    photos, keys = _photos(document, places, notes)
    if not photos:
        return None
    points, rays = CollectedPoints(), CollectedRays()
    found = markers.chunk.markers()
    _add_markers(markers, found, keys, points, rays, notes)
    if document.ties is not None:
        notes += add_ties(document.ties, chunk, keys, points, rays)
    distances, lost = markers.chunk.distances({str(marker.key): marker.name for marker in found})
    if lost:
        notes.append(f"{counted(lost, 'scale bar')} between other things than two markers, left out.")
    used = {photo.name for photo in photos}
    stations = [station for camera in chunk.cameras() if (station := chunk.station(camera)) is not None]
    control = tuple(marker.control for marker in found if marker.control is not None)
    frame = chunk.frame
    is_geocentric = frame.kind == "geocentric"
    is_known = bool(chunk.crs) or all(math.hypot(*station.position) > LEAST_RADIUS for station in stations)
    is_referenced = chunk.is_on_the_ground and (is_known or not is_geocentric)
    if not chunk.is_on_the_ground and (control or stations):
        notes.append(
            "The chunk has no transform to the ground: positions of cameras and markers are in another system."
        )
    elif stations and not is_referenced:
        notes.append(
            f"The chunk is on the earth and names no system: positions of {counted(len(stations), 'camera')} "
            "left out; export the cameras with it."
        )
    elif not chunk.crs and (control or stations):
        notes.append(
            "The chunk names no coordinate system: positions of cameras and markers are taken to be in that of its "
            "transform."
        )
    stations = [station for station in stations if station.photo in used and is_referenced]
    return ExchangedProject(
        name=document.element.attributes.get("label", ""),
        cameras=cameras,
        photos=photos,
        points=points.points(),
        rays=rays.rays(),
        readings=(READING,),
        control=control,
        checks=frozenset(marker.name for marker in found if not marker.is_enabled),
        control_crs=markers.chunk.crs if is_geocentric else "",
        stations=tuple(stations),
        station_reference=replace(chunk.station_reference(), navigation=any(one.has_angles for one in stations)),
        distances=tuple(distances),
        ground_unit="m" if chunk.is_on_the_ground else "unit",
        frame=frame,
        precision=chunk.accuracies.ties or 1.0,
        rigs=rigs_of_sensors(tuple(chunk.sensors()), places),
        exposures=exposures_of_cameras(chunk.cameras(), {str(key): place for key, place in keys.items()}),
        notes=tuple(notes),
    )


def _cameras(document: Document, notes: list[str]) -> tuple[tuple[ExchangedCamera, ...], dict[str, int]]:
    cameras: list[ExchangedCamera] = []
    rolling: list[str] = []
    places: dict[str, int] = {}
    for key, element in document.chunk.sensors():
        camera = read_sensor(element, document.fields)
        if camera is not None:
            places[key] = len(cameras)
            cameras.append(camera)
            if is_rolling(element):
                rolling.append(camera.name)
    if rolling:
        notes.append(
            f"Metashape compensates the rolling shutter of {counted_names('sensor', rolling)}, and the file has no "
            "times: photos are oriented as Metashape has them. To have it in orip, give stations with times, and the "
            "camera its readout."
        )
    return tuple(cameras), places


def _photos(
    document: Document, places: dict[str, int], notes: list[str]
) -> tuple[tuple[ExchangedPhoto, ...], dict[int, int]]:
    """Return the oriented photos, and their places by id."""
    photos: list[ExchangedPhoto] = []
    keys: dict[int, int] = {}
    left_out = 0
    for element in document.chunk.cameras():
        photo = document.chunk.photo(element, places)
        if photo is None or not photo.rotation or not is_true(element.attributes.get("enabled"), missing=True):
            left_out += 1
            continue
        keys[photo.key] = len(photos)
        photos.append(photo)
    if left_out:
        notes.append(f"{counted(left_out, 'camera')} not aligned, not enabled or not calibrated, left out.")
    return tuple(photos), keys


def _add_markers(
    document: Document,
    markers: Sequence[Marker],
    keys: dict[int, int],
    points: CollectedPoints,
    rays: CollectedRays,
    notes: list[str],
) -> None:
    """Add the projections of markers that were placed or confirmed by hand."""
    names = {marker.key: marker.name for marker in markers}
    deviation = document.chunk.accuracies.projections or float("nan")
    left_out = 0
    for frame, fields in document.frames:
        for element in frame.within("marker"):
            key = fields.attribute_whole(element, "marker_id") if "marker_id" in element.attributes else None
            if key is None or key not in names:
                continue
            for location in element.all("location"):
                photo = fields.attribute_whole(location, "camera_id")
                is_valid = is_true(location.attributes.get("valid"), missing=True)
                if not is_valid or photo not in keys:
                    continue
                if not is_true(location.attributes.get("pinned"), missing=True):
                    left_out += 1
                    continue
                x, y = fields.attribute_decimal(location, "x"), fields.attribute_decimal(location, "y")
                if x is not None and y is not None and photo is not None:
                    rays.add(keys[photo], points.add(names[key]), (x, y), deviation)
    if left_out:
        notes.append(f"{counted(left_out, 'projection')} of markers not confirmed by hand (not pinned), left out.")
