"""Tie tracks of an OPF project: points of a glTF file, and their matches in the extension OPF_mesh_primitive_matches.

Arrays are in binary files beside it, little-endian and packed. A point's matches are a range: 40 bits of its beginning,
24 bits of its length. glTF has y up; points are taken to z up, the processing system. Pixels count as all of OPF do.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.errors import Complaint
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.json_tree import JsonValue, read_json
from orip.exchange.sources.text import Faults
from orip.exchange.vision.opf_documents import Documents, Ground, checked_version, path_of
from orip.files.text.decimal_numbers import LARGEST_NUMBER
from orip.files.text.lines import read_bytes
from orip.wording import counted

_FLOAT, _UNSIGNED = 5126, 5125
_TYPES = {_FLOAT: "<f4", _UNSIGNED: "<u4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
_MATCHES = "OPF_mesh_primitive_matches"
_BITS = np.uint64(40)
_IDENTITY = tuple(np.eye(4).ravel().tolist())
_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


class Tracks(Struct, frozen=True):
    """Points and their measurements.

    Parameters
    ----------
    coordinates : array (m, 3)
        In the processing system.
    photo, point : arrays (k,) of int
        Places of photos, and of points among these.
    image : array (k, 2)
        Pixels.
    lost : int
        Measurements in photos that are not calibrated.
    """

    coordinates: FloatArray
    photo: IntArray
    point: IntArray
    image: FloatArray
    lost: int


class _Arrays:
    """The arrays of a glTF file."""

    def __init__(self, root: JsonValue, folder: Path, shown: Path, complaints: list[Complaint]) -> None:
        self._root, self._folder, self._shown, self._complaints = root, folder, shown, complaints
        self._buffers: dict[str, bytes | None] = {}

    def part(self, key: str, owner: JsonValue, number: str) -> JsonValue | None:
        """Return the element of an array of the file that a number of `owner` names."""
        place, parts = owner.required(number), self._root.required(key)
        if place is None or parts is None:
            return None
        known = parts.value if isinstance(parts.value, list) else []
        if type(place.value) is int and 0 <= place.value < len(known) and isinstance(known[place.value], dict):
            return JsonValue(known[place.value], parts.source, (*parts.place, place.value))
        place.complain(f"the number of one of {key} should be here; export the project again")
        return None

    def array(self, owner: JsonValue, number: str, component: int, kind: str) -> np.ndarray | None:
        """Return the array (n, width) that a number of `owner` names; None, and a complaint kept, if it is another."""
        accessor = self.part("accessors", owner, number)
        view = None if accessor is None else self.part("bufferViews", accessor, "bufferView")
        buffer = None if view is None else self.part("buffers", view, "buffer")
        uri = None if buffer is None else buffer.text("uri")
        if accessor is None or view is None or uri is None:
            return None
        count, offset = accessor.value.get("count"), view.value.get("byteOffset", 0)
        is_packed = not {"sparse", "byteOffset"} & set(accessor.value) and "byteStride" not in view.value
        is_one = accessor.value.get("componentType") == component and accessor.value.get("type") == kind
        if not (type(count) is int and count >= 0 and type(offset) is int and offset >= 0 and is_packed and is_one):
            accessor.complain(f"a packed array of {kind} of component type {component} should be here")
            return None
        if uri not in self._buffers:
            name = path_of(uri)
            data, complaints = read_bytes(self._folder / name, str(self._shown / name))
            self._complaints += complaints
            self._buffers[uri] = data
        data = self._buffers[uri]
        if data is None:
            return None
        width = _WIDTHS[kind]
        if offset + 4 * width * count > len(data):
            accessor.complain(f"its file has {len(data)} bytes, {offset + 4 * width * count} are needed; copy it again")
            return None
        if count == 0:
            return np.zeros((0, width), dtype=_TYPES[component])
        return np.frombuffer(data, _TYPES[component], count * width, offset).reshape(count, width)

    def numbers(self, owner: JsonValue, number: str, kind: str) -> FloatArray | None:
        """Return an array of finite numbers."""
        found = self.array(owner, number, _FLOAT, kind)
        if found is None:
            return None
        if not (np.isfinite(found).all() and (np.abs(found) <= LARGEST_NUMBER).all()):
            owner.complain(f"{number} has numbers that are not finite; export the project again")
            return None
        return found.astype(np.float64)


def add_tracks(
    documents: Documents,
    ground: Ground,
    place_of_id: Mapping[int, int],
    points: CollectedPoints,
    rays: CollectedRays,
) -> None:
    """Add the tie points of the calibration, which are numbered, with their measurements."""
    coordinates: dict[str, list[float]] = {}
    lost = 0
    for path, shown in documents.tracks():
        for found in read_tracks(path, shown, documents.complaints, place_of_id):
            rays.extend(found.photo, found.point + len(coordinates), found.image)
            lost += found.lost
            placed = ((found.coordinates - ground.shift) / ground.scale[0]).tolist()
            coordinates |= {str(n): place for n, place in enumerate(placed, start=len(coordinates))}
    points.add_tracks(coordinates)
    if not coordinates:
        documents.notes.append("The project has no tie points: only the marks of control and manual tie points.")
    if lost:
        documents.notes.append(f"{counted(lost, 'measurement')} of tie points in photos not calibrated, left out.")


def read_tracks(path: Path, shown: Path, complaints: list[Complaint], places: Mapping[int, int]) -> Iterator[Tracks]:
    """Iterate over the tracks of the nodes of a glTF file.

    Parameters
    ----------
    path, shown : Path
        The file, and as the user would name it.
    complaints : list of Complaint
        What is wrong is added.
    places : mapping of int to int
        Of photos, by the identifiers of their cameras.
    """
    root = read_json(path, Faults(str(shown), complaints))
    asset = None if root is None else root.required("asset")
    extensions = None if asset is None else asset.required("extensions")
    version = None if extensions is None else extensions.required("OPF_asset_version")
    if root is None or version is None or not checked_version(version):
        return
    arrays = _Arrays(root, path.parent, shown.parent, complaints)
    scene = arrays.part("scenes", root, "scene")
    nodes = None if scene is None else scene.required("nodes")
    for place in nodes.items() if nodes is not None else ():
        owner = JsonValue({"nodes": place.value}, place.source, place.place[:-1])
        node = arrays.part("nodes", owner, "nodes")
        mesh = None if node is None else arrays.part("meshes", node, "mesh")
        primitives = None if mesh is None else mesh.required("primitives")
        for primitive in primitives.items() if primitives is not None else ():
            added = primitive.get("extensions")
            matches = None if added is None else added.get(_MATCHES)
            found = None if node is None or matches is None else _tracks(arrays, node, primitive, matches, places)
            if found is not None:
                yield found


def _tracks(
    arrays: _Arrays, node: JsonValue, primitive: JsonValue, matches: JsonValue, places: Mapping[int, int]
) -> Tracks | None:
    attributes, images, known = (
        primitive.required("attributes"),
        matches.required("imagePoints"),
        matches.required("cameraUids"),
    )
    matrix = _IDENTITY if node.get("matrix") is None else node.numbers("matrix", 16)
    if attributes is None or images is None or known is None or matrix is None:
        return None
    coordinates = arrays.numbers(attributes, "POSITION", "VEC3")
    image = arrays.numbers(images, "pixelCoordinates", "VEC2")
    camera = arrays.array(matches, "cameraIds", _UNSIGNED, "SCALAR")
    packed = arrays.array(matches, "pointIndexRanges", _UNSIGNED, "VEC2")
    if coordinates is None or image is None or camera is None or packed is None:
        return None
    photo_of = [places.get(key.value, -1) if type(key.value) is int else -1 for key in known.items()]
    ranges = packed[:, 0].astype(np.uint64) | packed[:, 1].astype(np.uint64) << np.uint64(32)
    first, count = (ranges & ((np.uint64(1) << _BITS) - np.uint64(1))).astype(np.int64), (ranges >> _BITS).astype(int)
    if (
        len(first) != len(coordinates)
        or len(camera) != len(image)
        or int(count.sum()) > len(image)
        or ((first + count > len(image)) & (count > 0)).any()
        or (camera >= len(photo_of)).any()
    ):
        matches.complain("points, ranges of matches, matches and cameras do not fit one another; export again")
        return None
    point = np.repeat(np.arange(len(count)), count)
    match = np.arange(len(point)) + np.repeat(first - (np.cumsum(count) - count), count)
    photo = np.array(photo_of, dtype=np.int64)[camera[match, 0]] if len(match) else np.zeros(0, dtype=np.int64)
    kept = photo >= 0
    placed = np.reshape(matrix, (4, 4), order="F")[:3]
    coordinates = (coordinates @ placed[:, :3].T + placed[:, 3]) @ _TO_Z_UP.T
    return Tracks(coordinates, photo[kept], point[kept], image[match[kept]], int((~kept).sum()))
