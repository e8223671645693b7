"""Tie points of a project of Metashape: points, and their projections in each camera, as binary PLY files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.exchange.metashape.chunk import ChunkReader
from orip.exchange.metashape.project_files import TieCloud
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import XmlElement
from orip.files.text.shown import shown_token
from orip.wording import counted

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
    cloud : TieCloud
    chunk : ChunkReader
        Takes coordinates to the ground.
    photos : mapping of int to int
        Places of the photos by the ids of their cameras.
    points, rays : CollectedPoints, CollectedRays
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
