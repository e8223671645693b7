"""From the records of the model to the tables of orip.toml: the way back of `project_records`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

from orip.files.project.toml_text import toml_table
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark
from orip.records.photo import PHOTO_PARAMETERS, Photo, Scan, Template, Temtick
from orip.records.project import BundleDefinition, ProjectDefinition, StereoModel

TomlTable: TypeAlias = dict[str, Any]
"""A table as the TOML reader gives it; keys without a value are missing."""

RECORD_SECTIONS = ("camera", "temtick", "template", "photo", "bundle")

_ISP_PARAMETERS = ("R0", "A1", "A2", "A3")
_DISTORTION_PARAMETERS = CAMERA_PARAMETERS[CAMERA_PARAMETERS.index("A1") :]


def project_document(definition: ProjectDefinition) -> TomlTable:
    """Return a definition as the document that orip.toml would be.

    A distortion stands in the form that it was given in. Templates list their photos, and photos name their template.
    """
    project = {
        "name": definition.name,
        "user": definition.user,
        "camera_file": definition.camera_file,
        "temtick_file": definition.temtick_file,
        "project_files": definition.project_files,
        "control_files": definition.control_files,
        "measurement_files": list(definition.measurement_files),
        "ground_unit": definition.ground_unit,
        "crs": definition.crs,
    }
    return {
        "project": {key: value for key, value in project.items() if value is not None},
        "check": {"gates": list(definition.gates)} if definition.gates else {},
        "camera": [camera_table(each) for each in definition.cameras],
        "temtick": [temtick_table(each) for each in definition.temticks],
        "template": [template_table(each) for each in definition.templates],
        "photo": [photo_table(each) for each in definition.photos],
        "bundle": [bundle_table(each) for each in definition.bundles],
    }


def project_text(document: Mapping[str, Any]) -> str:
    """Return a document as text, each record below a header of its own."""
    return "\n".join(
        [
            *(toml_table(f"[{section}]", document[section]) for section in ("project", "check") if document[section]),
            *(record_text(section, table) for section in RECORD_SECTIONS for table in document[section]),
        ]
    )


def record_text(section: str, table: Mapping[str, Any]) -> str:
    """Return a record as text; the models of a bundle follow below headers of their own."""
    if section != "bundle":
        return toml_table(f"[[{section}]]", table)
    own = {key: value for key, value in table.items() if key != "model"}
    models = (toml_table("[[bundle.model]]", model) for model in table.get("model", ()))
    return "\n".join([toml_table("[[bundle]]", own), *models])


def camera_table(camera: Camera) -> TomlTable:
    """Return a camera as a table of orip.toml."""
    parameters = dict(zip(CAMERA_PARAMETERS, camera.parameters, strict=True))
    table: TomlTable = {"name": camera.name, "c": parameters["C"]}
    table["principal_point"] = [parameters["DX"], parameters["DY"]]
    if camera.distortion_isp is not None:
        table["distortion_isp"] = dict(zip(_ISP_PARAMETERS, camera.distortion_isp, strict=True))
    elif camera.distortion_curve is not None:
        table["distortion_curve"] = [list(point) for point in camera.distortion_curve]
    elif any(parameters[name] for name in _DISTORTION_PARAMETERS):
        table["distortion"] = {name: parameters[name] for name in _DISTORTION_PARAMETERS if parameters[name]}
    table["distortion_at"] = camera.distortion_at
    if camera.frame is not None:
        table["frame"] = list(camera.frame)
    if camera.fiducials:
        table["fiducials"] = _marks(camera.fiducials)
    if (sensor := camera.sensor) is not None:
        sizes = {"columns": sensor.columns, "rows": sensor.rows, "width": sensor.width, "height": sensor.height}
        table["sensor"] = sizes
    if camera.unknown:
        table["unknown"] = list(camera.unknown)
    if camera.additional_set is not None:
        table["set"] = camera.additional_set
    return table


def temtick_table(temtick: Temtick) -> TomlTable:
    """Return tick marks as a table of orip.toml."""
    return {"name": temtick.name, **({"ticks": _marks(temtick.ticks)} if temtick.ticks else {})}


def template_table(template: Template) -> TomlTable:
    """Return a template as a table of orip.toml."""
    table: TomlTable = {"name": template.name, "temtick": template.temtick}
    if template.stage is not None:
        table["stage"] = template.stage
    if template.photos:
        table["photos"] = list(template.photos)
    return {**table, **_scan(template.scan)}


def photo_table(photo: Photo) -> TomlTable:
    """Return a photo as a table of orip.toml."""
    orientation = zip(PHOTO_PARAMETERS, photo.orientation, strict=True)
    table: TomlTable = {"name": photo.name, "camera": photo.camera}
    if photo.template is not None:
        table["template"] = photo.template
    if photo.stage is not None:
        table["stage"] = photo.stage
    table |= {parameter: value for parameter, value in orientation if value is not None}
    if photo.constant:
        table["constant"] = list(photo.constant)
    return {**table, **_scan(photo.scan)}


def bundle_table(bundle: BundleDefinition) -> TomlTable:
    """Return a bundle adjustment with its models as a table of orip.toml."""
    precision = bundle.measurement_precision
    table: TomlTable = {
        "name": bundle.name,
        "measurement_precision": precision.value if precision.unit == "mm" else f"{precision.value}px",
        "enp_stop": bundle.enp_stop,
        "max_iterations": bundle.max_iterations,
        "start_down_weight": bundle.start_down_weight,
        "max_standard_residual": bundle.max_standard_residual,
        "max_lost_digits": bundle.max_lost_digits,
        "datum": bundle.datum,
    }
    if bundle.datum_points:
        table["datum_points"] = list(bundle.datum_points)
    if bundle.models:
        table["model"] = [model_table(each) for each in bundle.models]
    return table


def model_table(model: StereoModel) -> TomlTable:
    """Return a stereo model as a table of orip.toml."""
    return {"name": model.name, "left": model.left, "right": model.right, "row": model.row, "column": model.column}


def _marks(marks: Iterable[Mark]) -> list[TomlTable]:
    return [{"name": mark.name, "x": mark.x, "y": mark.y} for mark in marks]


def _scan(scan: Scan | None) -> TomlTable:
    return {} if scan is None else {"scan": {"pixel": list(scan.pixel), "origin": scan.origin}}
