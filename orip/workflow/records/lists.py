"""`list` and `show` of the record commands, and the distortion curve of a camera."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import ProjectWarning, UsageError
from orip.files.project.toml_text import TomlTable
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.stores.digest import record_digest
from orip.files.text.shown import visible
from orip.files.text.table import Column, table_lines
from orip.interior.distortion import curve_from_polynomial, isp_from_polynomial
from orip.interior.mounting import frame_corners
from orip.records.camera import CAMERA_PARAMETERS, RADIAL_PARAMETERS, RADIAL_PLACES, Camera
from orip.records.definition import RECORD_TYPES
from orip.records.fields import headings_of
from orip.records.names import near_names, record_key
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import PROJECT_FILE, ProjectFolder
from orip.workflow.project.images import image_warnings
from orip.workflow.project.state import ProjectState
from orip.workflow.records.changes import RecordValue, shown_value, values_of
from orip.workflow.records.document import DocumentRecord, RecordKind, records_of, referents, stored_document
from orip.workflow.records.edits import RecordName, bundle_of_models, find
from orip.workflow.records.reconcile import with_polynomial

DistortionForm = Literal["polynomial", "isp", "curve"]

_RADII = 61


class DistortionCurve(Struct, frozen=True):
    """Radial distortion of a camera.

    Parameters
    ----------
    form : {"polynomial", "isp", "curve"}
        How it was given.
    bundle : str
        The bundle whose last adjustment the polynomial comes from; empty: as the store has it.
    coefficients : (A1, A3, A5, A7, A9)
    isp : (R0, A1, A2, A3) or None
        The same curve in the form of the ISP regulations; None where it has none.
    radius, distortion : arrays (n,)
        The polynomial, mm.
    given_radius, given : arrays (k,)
        Points of the curve that it was given as, mm; none in other forms.
    residual : array (k,)
        Polynomial minus given, mm.
    """

    camera: str
    form: DistortionForm
    bundle: str
    coefficients: tuple[float, ...]
    isp: tuple[float, float, float, float] | None
    radius: FloatArray
    distortion: FloatArray
    given_radius: FloatArray
    given: FloatArray
    residual: FloatArray


def distortion_curve(
    state: ProjectState, name: str, largest_radius: float | None = None, *, is_stored: bool = False
) -> DistortionCurve:
    """Return the distortion curve of a camera: adjusted, if it was, or as its store has it.

    Parameters
    ----------
    state : ProjectState
        With definitions and solutions.
    largest_radius : float or None
        mm; None: to the corner of the frame that is farthest from the principal point, and to all given points.
    is_stored : bool
        Even if it was adjusted, as the store has it.

    Raises
    ------
    InputError
        If the project has no stores yet.
    UsageError
        If there is no such camera, or nothing tells how far its photos reach.
    """
    state.require_initialised()
    cameras = state.records.cameras
    camera = cameras.get(record_key(name))
    if camera is None:
        message = f"there is no camera {name}; {near_names(name, (camera.name for camera in cameras.values()))}"
        raise UsageError(message)
    bundle, coefficients = "", camera.parameters[RADIAL_PLACES]
    if not is_stored:
        bundle, coefficients = _adjusted(state, camera) or (bundle, coefficients)
    points = np.array(camera.distortion_curve or (), dtype=np.float64).reshape(-1, 2)
    reach = largest_radius if largest_radius is not None else _reach(camera, points[:, 0])
    if not 0.0 < reach < np.inf:
        message = f"the extent of photos of camera {camera.name} is not known; give the radius in mm with --radius"
        raise UsageError(message)
    radius = np.linspace(0.0, reach, _RADII)
    form: DistortionForm = "isp" if camera.distortion_isp else "curve" if camera.distortion_curve else "polynomial"
    return DistortionCurve(
        camera.name, form, bundle, coefficients, (not bundle and camera.distortion_isp) or _isp(coefficients),
        radius, curve_from_polynomial(coefficients, radius),
        points[:, 0], points[:, 1], curve_from_polynomial(coefficients, points[:, 0]) - points[:, 1],
    )  # fmt: skip


def _adjusted(state: ProjectState, camera: Camera) -> tuple[str, tuple[float, ...]] | None:
    """Return the bundle that adjusted a camera's radial distortion, the last one of several, and the polynomial."""
    for bundle in reversed(state.bundles):
        solution = state.solution(bundle)
        if solution is None or solution.status not in {"converged", "doubtful"}:
            continue
        for row, name in enumerate(solution.cameras.names):
            if (
                record_key(name) == record_key(camera.name)
                and np.isfinite(solution.cameras.sd[row, RADIAL_PLACES]).any()
            ):
                return bundle, tuple(solution.cameras.values[row, RADIAL_PLACES].tolist())
    return None


def _isp(coefficients: Sequence[float]) -> tuple[float, float, float, float] | None:
    try:
        return isp_from_polynomial(coefficients)
    except ValueError:
        return None


def _reach(camera: Camera, given: FloatArray) -> float:
    """Return the largest radius (mm) on the frame, or of the points of the curve; 0 where there is neither."""
    largest = float(given.max(initial=0.0))
    corners = frame_corners(camera)
    if corners is not None:
        farthest = np.maximum(*(np.abs(corner - camera.parameters[1:3]) for corner in corners))
        largest = max(largest, float(np.hypot(*farthest)))
    return largest


class RecordRow(Struct, frozen=True):
    """A record: its bundle (of a model), its name, its table of orip.toml, and where it came from."""

    bundle: str
    name: str
    table: TomlTable
    source: str


class RecordList(Struct, frozen=True):
    """The records of a kind, also as text, and what is wrong with the images of photos."""

    rows: tuple[RecordRow, ...]
    text: str
    warnings: tuple[ProjectWarning, ...] = ()


class ShownRecord(Struct, frozen=True):
    """A record with all its values, and what names it."""

    row: RecordRow
    values: tuple[RecordValue, ...]
    named_by: tuple[str, ...]
    text: str


def list_records(state: ProjectState, kind: RecordKind, bundle: str | None = None) -> RecordList:
    """Return the records of a kind in the order of their store; models of one bundle, or of all.

    Parameters
    ----------
    state : ProjectState
        With definitions.

    Raises
    ------
    UsageError
        If there is no such bundle.
    """
    project, stored = state.project, state.definitions
    document = stored_document(project, stored)
    chosen = bundle_of_models(document, bundle)["name"] if bundle is not None else None
    places = [place for place in records_of(document, kind) if chosen in {None, place.bundle}]
    rows = tuple(_row(project, stored, place) for place in places)
    columns = [Column("Name", [row.name for row in rows], align="left")]
    for heading, key, counted in headings_of(RECORD_TYPES[kind]):
        columns.append(Column(heading, [_cell(row.table, key, counted=counted) for row in rows], align="left"))
    if kind == "model":
        columns.insert(0, Column("Bundle", [row.bundle for row in rows], align="left"))
    warnings: tuple[ProjectWarning, ...] = ()
    if kind == "photo" and any("image" in row.table for row in rows):
        columns.append(Column("Image", [str(row.table.get("image", "-")) for row in rows], align="left"))
        warnings = image_warnings(project.folder, state.records.photos.values(), state.records.cameras)
    columns.append(Column("From", [row.source for row in rows], align="left"))
    return RecordList(rows, "\n".join(table_lines(columns)) + "\n", warnings)


def show_record(state: ProjectState, record: RecordName) -> ShownRecord:
    """Return a record with all its values; raises what `list_records` does."""
    project, stored = state.project, state.definitions
    document = stored_document(project, stored)
    place = find(document, record)
    row = _row(project, stored, place)
    values = tuple(values_of(record.kind, place.table, project.definition.ground_unit))
    named_by = tuple(
        f"{referent.kind} {referent.name}" for referent in referents(document, record.kind, place.table["name"])
    )
    lines = [f"{record.kind} {place.name}", *_value_lines(values), ""]
    if record.kind == "camera":
        lines += _polynomial_lines(state.definitions.cameras, place.table)
    lines.append(f"  from      {row.source}")
    lines.append(f"  named by  {', '.join(named_by) or 'no record'}")
    return ShownRecord(row, values, named_by, "\n".join(lines) + "\n")


def _polynomial_lines(cameras: Sequence[StoredRecord[Camera]], table: TomlTable) -> list[str]:
    """Return the coefficients with which a camera computes whose radial distortion is given in another form."""
    form = next((form for form in ("distortion_isp", "distortion_curve") if form in table), None)
    if form is None:
        return []
    camera = next(stored.record for stored in cameras if record_key(stored.record.name) == record_key(table["name"]))
    known = dict(zip(CAMERA_PARAMETERS, camera.parameters, strict=True))
    shown = ", ".join(f"{name} {known[name]:.6g}" for name in RADIAL_PARAMETERS if known[name])
    return [f"  radial    {shown or 'no distortion'} (from {form})"]


def _value_lines(values: Iterable[RecordValue]) -> list[str]:
    listed = list(values)
    columns = [
        Column("Key", [value.key for value in listed], align="left"),
        Column("Value", [value.text for value in listed], align="left"),
        Column("Unit", [value.unit for value in listed], align="left"),
    ]
    return table_lines(columns)


def _cell(table: Mapping[str, Any], key: str, *, counted: bool) -> str:
    if key == "distortion":
        forms = {"distortion_isp": "ISP", "distortion_curve": "curve", "distortion": "polynomial"}
        return next((forms[key] for key in forms if key in table), "none")
    if key == "fiducials" and "sensor" in table:
        return "sensor"
    return str(len(table.get(key, ()))) if counted else shown_value(table.get(key))


def _row(project: ProjectFolder, stored: StoredDefinitions, place: DocumentRecord) -> RecordRow:
    kind, name = ("bundle", place.bundle) if place.kind == "model" else (place.kind, place.table["name"])
    known: tuple[StoredRecord[NamedRecord], ...] = getattr(stored, f"{kind}s")
    record = next(candidate for candidate in known if record_key(candidate.record.name) == record_key(name))
    return RecordRow(place.bundle, place.table["name"], place.table, _source(project, kind, record))


def _source(project: ProjectFolder, kind: str, stored: StoredRecord[NamedRecord]) -> str:
    """Say where a record came from, and whether it or the text has changed since."""
    if stored.text_digest is None:
        return "no text"
    kept, key = record_digest(stored.record), record_key(stored.record.name)
    changed = ["in the store"] if kept != stored.text_digest else []
    line = project.lines.get((kind, key))
    if stored.origin != project.definition.name:
        place = f"project {visible(stored.origin or '')}"
    elif line is None:
        place = f"{PROJECT_FILE} as it was"
    else:
        place = f"{PROJECT_FILE}:{line}"
        records: tuple[NamedRecord, ...] = getattr(project.definition, f"{kind}s")
        text: Any = next(record for record in records if record_key(record.name) == key)
        now = record_digest(with_polynomial(text) if kind == "camera" else text)
        changed += ["in the text"] if now != stored.text_digest else []
        if now == kept:
            return place
    return f"{place}, changed {' and '.join(changed)}" if changed else place
