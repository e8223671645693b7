"""All tables of orip.toml that are valid by themselves, each with its place in the text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Generic, TypeVar, cast

from msgspec import Struct, field

from orip.files.project.forms import Finding
from orip.files.project.tables import SECTIONS, CheckTable, Fault, ProjectTable, table_faults, table_of, unknown_key
from orip.files.project.toml_lines import KeyPath
from orip.files.project.toml_text import record_of
from orip.files.text.shown import shown_token
from orip.records.camera import Camera
from orip.records.definition import Antenna, BundleDefinition, ReportDetails, StereoModel
from orip.records.figures import Terrain
from orip.records.photo import Photo, Template, Temtick
from orip.records.plan import PlanSettings
from orip.records.receivers import GnssSettings, ImuSettings, NetworkSettings
from orip.records.rig import Rig, RigExposure

Record = TypeVar("Record")


class Located(Struct, Generic[Record], frozen=True):
    """A record as its own table says it, the keys and indices that lead to that table, and the keys that it has."""

    place: KeyPath
    record: Record
    keys: frozenset[str]


class NamePlace(Struct, frozen=True):
    """A record's name and the place of the record; also of a record that has other faults."""

    name: str
    place: KeyPath


class ProjectSource(Struct):
    """The tables of one orip.toml.

    Records with faults of their own are left out, so that the rest can still be checked; `names` has those of all
    records by section (models under ``model``), so that a reference to a faulty record is not reported as undefined.
    """

    project: ProjectTable | None = None
    check: CheckTable = field(default_factory=CheckTable)
    report: ReportDetails = field(default_factory=ReportDetails)
    plan: PlanSettings | None = None
    gnss: GnssSettings | None = None
    gnss_network: NetworkSettings | None = None
    imu: ImuSettings | None = None
    cameras: list[Located[Camera]] = field(default_factory=list)
    temticks: list[Located[Temtick]] = field(default_factory=list)
    templates: list[Located[Template]] = field(default_factory=list)
    photos: list[Located[Photo]] = field(default_factory=list)
    antennas: list[Located[Antenna]] = field(default_factory=list)
    terrains: list[Located[Terrain]] = field(default_factory=list)
    rigs: list[Located[Rig]] = field(default_factory=list)
    exposures: list[Located[RigExposure]] = field(default_factory=list)
    bundles: list[Located[BundleDefinition]] = field(default_factory=list)
    models: list[Located[StereoModel]] = field(default_factory=list)
    names: dict[str, list[NamePlace]] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)


def project_source(document: Mapping[str, Any]) -> ProjectSource:
    """Validate each table of a TOML document by itself; the faults are in the result."""
    source = ProjectSource()
    for key in document:
        if key not in SECTIONS:
            source.faults.append(((key,), unknown_key(key, "the project", SECTIONS)))
    source.project = _project(document, source)
    source.check = _single(document, "check", CheckTable, source) or CheckTable()
    source.report = _single(document, "report", ReportDetails, source) or ReportDetails()
    source.plan = _single(document, "plan", PlanSettings, source) if "plan" in document else None
    source.gnss = _single(document, "gnss", GnssSettings, source) if "gnss" in document else None
    if "gnss_network" in document:
        source.gnss_network = _single(document, "gnss_network", NetworkSettings, source)
    source.imu = _single(document, "imu", ImuSettings, source) if "imu" in document else None
    source.cameras = _records(document, "camera", Camera, source)
    source.temticks = _records(document, "temtick", Temtick, source)
    source.templates = _records(document, "template", Template, source)
    source.photos = _records(document, "photo", Photo, source)
    source.antennas = _records(document, "antenna", Antenna, source)
    source.terrains = _records(document, "terrain", Terrain, source)
    source.rigs = _records(document, "rig", Rig, source)
    source.exposures = _records(document, "exposure", RigExposure, source)
    _bundles(document, source)
    return source


def _project(document: Mapping[str, Any], source: ProjectSource) -> ProjectTable | None:
    if "project" not in document:
        message = 'there is no [project] table; write [project] and below it for example name = "ZURICH"'
        source.faults.append(((), message))
        return None
    raw = document["project"]
    project = _single(document, "project", ProjectTable, source)
    if project is None and isinstance(raw, dict):
        # What is right is still checked: the keys of this table do not depend on each other.
        faulty = {place[1] for place, _ in source.faults if place[:1] == ("project",) and len(place) > 1}
        right = {"project": {key: raw[key] for key in raw if key not in faulty}}
        return _single(right, "project", ProjectTable, ProjectSource())
    return project


def _single(document: Mapping[str, Any], section: str, kind: type[Record], source: ProjectSource) -> Record | None:
    """Return a table that comes once; None if it has faults."""
    values = _table(document.get(section, {}), kind, f"[{section}]", (section,), source)
    return None if values is None else record_of(kind, values)


def _records(
    document: Mapping[str, Any], section: str, kind: type[Record], source: ProjectSource
) -> list[Located[Record]]:
    found = []
    for index, raw in _elements(document, section, (section,), source):
        found += _record(raw, kind, section, _title(section, index, raw), (section, index), source)
    return found


def _record(
    raw: Any, kind: type[Record], section: str, title: str, place: KeyPath, source: ProjectSource
) -> list[Located[Record]]:
    """Return the record, or nothing if it has faults; its name is kept."""
    values = _table(raw, kind, title, place, source)
    name = raw.get("name") if isinstance(raw, dict) else None
    if isinstance(name, str):
        source.names.setdefault(section, []).append(NamePlace(name, place))
    return [] if values is None else [Located(place, record_of(kind, values), frozenset(values))]


def _bundles(document: Mapping[str, Any], source: ProjectSource) -> None:
    """Read bundles and, apart from them, their models: a fault in one hides nothing in the others."""
    for index, raw in _elements(document, "bundle", ("bundle",), source):
        place: KeyPath = ("bundle", index)
        title = _title("bundle", index, raw)
        settings = {key: value for key, value in raw.items() if key != "model"} if isinstance(raw, dict) else raw
        source.bundles += _record(settings, BundleDefinition, "bundle", title, place, source)
        if isinstance(raw, dict):
            _models(raw, title, place, source)


def _models(bundle: Mapping[str, Any], bundle_title: str, bundle_place: KeyPath, source: ProjectSource) -> None:
    for index, raw in _elements(bundle, "model", (*bundle_place, "model"), source):
        place = (*bundle_place, "model", index)
        title = f"{_title('model', index, raw)} of {bundle_title}"
        source.models += _record(raw, StereoModel, "model", title, place, source)


def _elements(around: Mapping[str, Any], key: str, place: KeyPath, source: ProjectSource) -> Iterator[tuple[int, Any]]:
    value = around.get(key, [])
    if isinstance(value, list):
        yield from enumerate(value)
        return
    header = "bundle.model" if key == "model" else key
    message = f"{key} is one table or value, but may come several times; write each as [[{header}]]"
    source.faults.append((place, message))
    if isinstance(value, dict):  # what is right in it is not reported as missing elsewhere
        yield 0, value


def _table(raw: Any, kind: type[Record], title: str, place: KeyPath, source: ProjectSource) -> dict[str, Any] | None:
    """Return the values of the table of a kind of record; None if it has faults."""
    table, findings = table_of(cast(type, kind)), list[Finding]()
    values: dict[str, Any] = table.read(raw, (), findings)
    source.faults += table_faults(findings, table, title, place)
    return None if findings else values


def _title(section: str, index: int, raw: Any) -> str:
    name = raw.get("name") if isinstance(raw, dict) else None
    return f"{section} '{shown_token(name)}'" if isinstance(name, str) and name else f"{section} number {index + 1}"
