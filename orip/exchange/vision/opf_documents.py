"""The documents of an OPF project (Open Photogrammetry Format 1.x): files, identifiers, scene reference frame."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from msgspec import Struct

from orip.errors import Complaint, InputError
from orip.exchange.sources.json_tree import JsonValue, read_json
from orip.exchange.sources.text import Faults
from orip.files.text.shown import shown_token
from orip.geometry.ground_crs import known_crs
from orip.units import METRES_PER_GROUND_UNIT

_VERSION = re.compile(r"1\.\d{1,3}")
_LARGEST_ID = (1 << 64) - 1
_SAME_UNIT = 1e-9
_FORMAT = "application/opf-{}+json"
_GLTF = "model/gltf+json"

Vector = tuple[float, float, float]


class Ground(Struct, frozen=True):
    """The scene reference frame: how coordinates of the processing system, and of its base, become orip's.

    Parameters
    ----------
    crs : str or None
        None: an arbitrary or plain system.
    definition : str
        Of the base system, as the file has it.
    swaps : bool
        Processing coordinates are swap(scale * base) + shift.
    """

    crs: str | None = None
    unit: str = "unit"
    definition: str = ""
    shift: Vector = (0.0, 0.0, 0.0)
    scale: Vector = (1.0, 1.0, 1.0)
    swaps: bool = False

    def place(self, processing: Sequence[float]) -> Vector:
        """Return X, Y, Z of coordinates in the processing system."""
        x, y, z = ((value - shift) / self.scale[0] for value, shift in zip(processing, self.shift, strict=True))
        return x, y, z

    def length(self, processing: float) -> float:
        """Return a length, or a standard deviation, of the processing system."""
        return processing / self.scale[0]

    def lengths(self, processing: Sequence[float]) -> Vector:
        """Return the lengths, or standard deviations, along X, Y and Z."""
        x, y, z = map(self.length, processing)
        return x, y, z

    def of_base(self, base: Sequence[float]) -> Vector:
        """Return X, Y, Z, or their standard deviations, of such in the base system."""
        x, y, z = (value * scale / self.scale[0] for value, scale in zip(base, self.scale, strict=True))
        return (y, x, z) if self.swaps else (x, y, z)


class Documents:
    """The documents of a project, read when they are asked for; and what is wrong with them."""

    def __init__(self, path: Path, shown: Path) -> None:
        self.complaints: list[Complaint] = []
        self.notes: list[str] = []
        self._folder, self._shown = path.parent, shown.parent
        self._resources: dict[str, list[JsonValue]] = {}
        self._read: dict[str, tuple[JsonValue, ...]] = {}
        self.root = self._checked(path, shown, "project")
        items = None if self.root is None else self.root.required("items")
        for item in items.items() if items is not None else ():
            kind, resources = item.text("type"), item.required("resources")
            is_extension = kind is None or kind.startswith("ext_")
            for resource in resources.items() if resources is not None and not is_extension else ():
                form = resource.text("format")
                if form is not None and (form != _GLTF or kind == "calibration"):  # else a dense cloud
                    self._resources.setdefault(form, []).append(resource)

    def tracks(self) -> list[tuple[Path, Path]]:
        """Return the glTF files of the calibration, and as the user would name them."""
        uris = (resource.text("uri") for resource in self._resources.get(_GLTF, ()))
        names = [path_of(uri.partition("#")[0]) for uri in uris if uri is not None]
        return [(self._folder / name, self._shown / name) for name in names]

    def of(self, kind: str, *, is_needed: bool = False, has_many: bool = False) -> tuple[JsonValue, ...]:
        """Return the documents of a kind; the first one alone, and a note kept, unless there may be many."""
        if kind not in self._read:
            found = self._resources.get(_FORMAT.format(kind), [])
            if is_needed and not found and self.root is not None:
                self.root.complain(f"the project has no {kind.replace('-', '_')}; calibrate it, and export it again")
            if len(found) > 1 and not has_many:
                self.notes.append(f"Of {len(found)} {kind.replace('-', '_')} of the project the first is read.")
            uris = (resource.text("uri") for resource in (found if has_many else found[:1]))
            names = [path_of(uri.partition("#")[0]) for uri in uris if uri is not None]
            read = [self._checked(self._folder / name, self._shown / name, kind) for name in names]
            self._read[kind] = tuple(document for document in read if document is not None)
        return self._read[kind]

    def parts(self, kind: str, key: str, *, is_needed: bool = False, has_many: bool = False) -> Iterator[JsonValue]:
        """Iterate over the elements of an array of the documents of a kind."""
        for document in self.of(kind, is_needed=is_needed, has_many=has_many):
            found = document.required(key)
            yield from found.items() if found is not None else ()

    def _checked(self, path: Path, shown: Path, kind: str) -> JsonValue | None:
        document = read_json(path, Faults(str(shown), self.complaints))
        form = None if document is None else document.text("format")
        if document is None or form is None or not checked_version(document):
            return None
        if form != _FORMAT.format(kind):
            document.complain(f"format {_FORMAT.format(kind)} should be here, not '{shown_token(form)}'")
            return None
        return document


def checked_version(value: JsonValue) -> bool:
    """Return whether a document has a version that is read; a complaint is kept if it has not."""
    version = value.text("version")
    if version is not None and not _VERSION.fullmatch(version):
        value.complain(
            f"version '{shown_token(version)}' is not read, 1.0 is; convert the project with opf_convert of pyopf"
        )
        return False
    return version is not None


def path_of(uri: str) -> str:
    """Return the path of a URI reference: relative, or of a file of this machine."""
    path = unquote(uri)
    if path.lower().startswith("file://"):
        path = path[len("file://") :].removeprefix("localhost")
        path = path[1:] if re.match(r"/[A-Za-z]:", path) else path
    return path


def identity(value: JsonValue, key: str) -> int | None:
    """Return an identifier; None, and a complaint kept, if there is none."""
    found = value.required(key)
    if found is None:
        return None
    if type(found.value) is int and 0 <= found.value <= _LARGEST_ID:
        return found.value
    found.complain(f"a whole number from 0 to {_LARGEST_ID} should be here; correct it")
    return None


def by_id(values: Iterable[JsonValue]) -> Iterator[tuple[int, JsonValue]]:
    """Iterate over parts with their identifiers; a complaint is kept of one that is there twice."""
    taken = set()
    for value in values:
        key = identity(value, "id")
        if key in taken:
            value.complain(f"id {key} is there twice; export the project again")
        elif key is not None:
            taken.add(key)
            yield key, value


def vector(value: JsonValue, key: str) -> Vector | None:
    """Return three numbers; None, and a complaint kept, if there are none."""
    found = value.numbers(key, 3)
    return None if found is None else (found[0], found[1], found[2])


def read_ground(documents: Documents) -> Ground:
    """Return the scene reference frame; that of an arbitrary system where there is none."""
    document = next(iter(documents.of("scene-reference-frame")), None)
    system, change = (None if document is None else document.required(key) for key in ("crs", "base_to_canonical"))
    definition = None if system is None else system.text("definition")
    if system is None or change is None or definition is None:
        return Ground()
    shift, scale, swaps = vector(change, "shift"), vector(change, "scale"), change.required("swap_xy")
    if shift is None or scale is None or swaps is None:
        return Ground()
    if min(scale) <= 0.0 or abs(scale[0] - scale[1]) > _SAME_UNIT * scale[0] or type(swaps.value) is not bool:
        change.complain("two equal scales of X and Y, and one of Z, above 0, and true or false should be here")
        return Ground()
    try:
        found = known_crs(definition)
    except InputError as error:
        system.complain(error.complaints[0].message)
        return Ground()
    if found.is_geographic or found.is_geocentric:
        system.complain("the scene is in longitude and latitude, or geocentric; export it in a projected system")
    height = system.get("geoid_height")
    if height is not None:
        documents.notes.append(
            f"Heights are above a geoid of the constant height {shown_token(str(height.value))}: crs does not say it."
        )
    metres = found.axis_info[0].unit_conversion_factor if found.axis_info else 0.0
    units = (name for name, size in METRES_PER_GROUND_UNIT.items() if abs(metres / size - 1.0) < _SAME_UNIT)
    crs = definition if found.is_projected else None
    return Ground(crs, next(units, "unit"), definition, shift, scale, swaps.value)
