"""The definition that the records of orip.toml make up, and the way back to their text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec.structs import asdict

from orip.files.project.source import Located, ProjectSource
from orip.files.project.tables import RECORD_SECTIONS, SINGLE_SECTIONS, ProjectTable
from orip.files.project.toml_text import TomlTable, toml_of, toml_table
from orip.records.camera import Camera, with_shared_lenses, without_lens, without_radial_distortion
from orip.records.definition import BundleDefinition, ProjectDefinition, ReportDetails, StereoModel
from orip.records.names import record_key
from orip.records.photo import Template
from orip.records.rig import Rigs
from orip.structs import replace


def project_definition(source: ProjectSource, project: ProjectTable) -> ProjectDefinition:
    """Return the definition with defaults filled in, and photos and templates naming each other."""
    template_names = {record_key(template.record.name): template.record.name for template in source.templates}
    photo_names = {record_key(photo.record.name): photo.record.name for photo in source.photos}
    template_of = {
        record_key(photo): template.record.name for template in source.templates for photo in template.record.photos
    }
    for photo in source.photos:
        if photo.record.template is not None:
            template_of[record_key(photo.record.name)] = template_names[record_key(photo.record.template)]
    photos_of: dict[str, list[str]] = {}
    for key, name in photo_names.items():
        photos_of.setdefault(template_of.get(key, ""), []).append(name)
    return ProjectDefinition(
        name=project.name,
        user=project.user,
        camera_file=project.camera_file,
        temtick_file=project.temtick_file,
        project_files=project.name if project.project_files is None else project.project_files,
        control_files=project.name if project.control_files is None else project.control_files,
        measurement_files=project.measurement_files,
        ground_unit=project.ground_unit,
        angle_unit=project.angle_unit,
        crs=project.crs,
        cameras=with_shared_lenses(camera.record for camera in source.cameras),
        temticks=tuple(temtick.record for temtick in source.temticks),
        templates=tuple(_with_photos(template.record, photo_names, photos_of) for template in source.templates),
        photos=tuple(replace(p.record, template=template_of.get(record_key(p.record.name))) for p in source.photos),
        bundles=tuple(_with_models(bundle, source.models) for bundle in source.bundles),
        gates=source.check.gates,
        test_level=source.check.test_level,
        report=source.report,
        plan=source.plan,
        gnss=source.gnss,
        gnss_network=source.gnss_network,
        imu=source.imu,
        antennas=tuple(antenna.record for antenna in source.antennas),
        terrains=tuple(terrain.record for terrain in source.terrains),
        rigs=Rigs(tuple(rig.record for rig in source.rigs), tuple(found.record for found in source.exposures)),
        output_folder=project.output_folder,
    )


def _with_photos(template: Template, photo_names: dict[str, str], photos_of: dict[str, list[str]]) -> Template:
    """Return a template with its photos: those that it lists, then those that name it, as the photos spell them."""
    listed = [photo_names[record_key(photo)] for photo in template.photos]
    return replace(template, photos=tuple(dict.fromkeys([*listed, *photos_of.get(template.name, [])])))


def _with_models(bundle: Located[BundleDefinition], models: list[Located[StereoModel]]) -> BundleDefinition:
    return replace(bundle.record, models=tuple(model.record for model in models if model.place[:2] == bundle.place))


def project_document(definition: ProjectDefinition) -> TomlTable:
    """Return a definition as the document that orip.toml would be.

    A distortion keeps the form that it was given in. Templates list their photos, and photos name their template.
    """
    project = {
        "name": definition.name,
        "user": definition.user,
        "camera_file": definition.camera_file,
        "temtick_file": definition.temtick_file,
        "project_files": definition.project_files,
        "control_files": definition.control_files,
        "measurement_files": list(definition.measurement_files),
        "output_folder": definition.output_folder,
        "ground_unit": definition.ground_unit,
        "angle_unit": None if definition.angle_unit == "degrees" else definition.angle_unit,
        "crs": definition.crs,
    }
    return {
        "project": {key: value for key, value in project.items() if value is not None},
        "check": _check_table(definition),
        "report": _report_table(definition.report),
        "plan": {} if definition.plan is None else toml_of(definition.plan),
        "gnss": {} if definition.gnss is None else toml_of(definition.gnss),
        "gnss_network": {} if definition.gnss_network is None else toml_of(definition.gnss_network),
        "imu": {} if definition.imu is None else toml_of(definition.imu),
        "camera": [camera_table(camera) for camera in definition.cameras],
        "temtick": [toml_of(temtick) for temtick in definition.temticks],
        "template": [toml_of(template) for template in definition.templates],
        "photo": [toml_of(photo) for photo in definition.photos],
        "antenna": [toml_of(antenna) for antenna in definition.antennas],
        "terrain": [toml_of(terrain) for terrain in definition.terrains],
        "rig": [toml_of(rig) for rig in definition.rigs.rigs],
        "exposure": [toml_of(exposure) for exposure in definition.rigs.exposures],
        "bundle": [toml_of(bundle) for bundle in definition.bundles],
    }


def project_text(document: Mapping[str, Any]) -> str:
    """Return a document as text, each record below a header of its own."""
    return "\n".join(
        [
            *(toml_table(f"[{section}]", document[section]) for section in SINGLE_SECTIONS if document[section]),
            *(record_text(section, table) for section in RECORD_SECTIONS for table in document[section]),
        ]
    )


def _check_table(definition: ProjectDefinition) -> TomlTable:
    gates = {"gates": list(definition.gates)} if definition.gates else {}
    return gates if definition.test_level is None else {**gates, "test_level": definition.test_level}


def _report_table(details: ReportDetails) -> TomlTable:
    given = {key: value for key, value in asdict(details).items() if value}
    return given | ({"remarks": list(details.remarks)} if details.remarks else {})


def record_text(section: str, table: Mapping[str, Any]) -> str:
    """Return a record as text; the models of a bundle follow below headers of their own."""
    if section != "bundle":
        return toml_table(f"[[{section}]]", table)
    own = {key: value for key, value in table.items() if key != "model"}
    models = (toml_table("[[bundle.model]]", model) for model in table.get("model", ()))
    return "\n".join([toml_table("[[bundle]]", own), *models])


def camera_table(camera: Camera) -> TomlTable:
    """Return a camera as a table of orip.toml; its radial distortion is written in the form that it was given in.

    Of a camera with the lens of another one it has what is its own.
    """
    if camera.same_lens_as is not None:
        table = toml_of(without_lens(camera))
        return {key: value for key, value in table.items() if key not in ("c", "distortion_at")}
    if camera.distortion_isp is None and camera.distortion_curve is None:
        return toml_of(camera)
    return toml_of(without_radial_distortion(camera))
