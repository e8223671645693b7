"""From the records of the model to the text of orip.toml: the way back of `reader`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec.structs import asdict

from orip.files.project.record_values import TomlTable, toml_of
from orip.files.project.toml_text import toml_table
from orip.records.project.camera import Camera, without_lens, without_radial_distortion
from orip.records.project.definition import ProjectDefinition, ReportDetails

SINGLE_SECTIONS = ("project", "check", "report")
RECORD_SECTIONS = ("camera", "temtick", "template", "photo", "antenna", "bundle")


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
        "crs": definition.crs,
    }
    return {
        "project": {key: value for key, value in project.items() if value is not None},
        "check": _check_table(definition),
        "report": _report_table(definition.report),
        "camera": [camera_table(camera) for camera in definition.cameras],
        "temtick": [toml_of(temtick) for temtick in definition.temticks],
        "template": [toml_of(template) for template in definition.templates],
        "photo": [toml_of(photo) for photo in definition.photos],
        "antenna": [toml_of(antenna) for antenna in definition.antennas],
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
