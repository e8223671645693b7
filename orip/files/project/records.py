"""From the tables of orip.toml to the records of the model; what is to be checked has been checked."""

from __future__ import annotations

from orip.files.project.source import Located, ProjectSource
from orip.files.project.tables import (
    BundleTable,
    CameraTable,
    MarkTable,
    ModelTable,
    PhotoTable,
    ProjectTable,
    ScanTable,
    TemplateTable,
)
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark, Sensor
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo, Scan, Template, Temtick
from orip.records.project import BundleDefinition, ProjectDefinition, StereoModel


def project_definition(source: ProjectSource, project: ProjectTable) -> ProjectDefinition:
    """Return the definition with defaults filled in, and photos and templates naming each other."""
    template_names = {record_key(template.table.name): template.table.name for template in source.templates}
    photo_names = {record_key(photo.table.name): photo.table.name for photo in source.photos}
    template_of = {
        record_key(photo): template.table.name for template in source.templates for photo in template.table.photos
    }
    for photo in source.photos:
        if photo.table.template is not None:
            template_of[record_key(photo.table.name)] = template_names[record_key(photo.table.template)]
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
        measurement_files=tuple(project.measurement_files),
        ground_unit=project.ground_unit,
        crs=project.crs,
        cameras=tuple(_camera(camera.table) for camera in source.cameras),
        temticks=tuple(Temtick(t.table.name, _marks(t.table.ticks)) for t in source.temticks),
        templates=tuple(_template(t.table, photo_names, photos_of) for t in source.templates),
        photos=tuple(_photo(p.table, template_of.get(record_key(p.table.name))) for p in source.photos),
        bundles=tuple(_bundle(bundle, source.models) for bundle in source.bundles),
        gates=tuple(source.check.gates),
    )


def _marks(marks: list[MarkTable]) -> tuple[Mark, ...]:
    return tuple(Mark(mark.name, mark.x, mark.y) for mark in marks)


def _scan(scan: ScanTable | None) -> Scan | None:
    return None if scan is None else Scan(scan.pixel, scan.origin)


def _camera(table: CameraTable) -> Camera:
    values = dict.fromkeys(CAMERA_PARAMETERS, 0.0)
    values["C"] = table.c
    values["DX"], values["DY"] = table.principal_point
    if table.distortion is not None:
        values.update(table.distortion.model_dump())
    isp, curve, sensor = table.distortion_isp, table.distortion_curve, table.sensor
    return Camera(
        name=table.name,
        parameters=tuple(float(values[name]) for name in CAMERA_PARAMETERS),
        distortion_at=table.distortion_at,
        distortion_isp=None if isp is None else (isp.R0, isp.A1, isp.A2, isp.A3),
        distortion_curve=None if curve is None else tuple((radius, distortion) for radius, distortion in curve),
        frame=None if table.frame is None else (table.frame[0], table.frame[1]),
        fiducials=_marks(table.fiducials),
        sensor=None if sensor is None else Sensor(sensor.columns, sensor.rows, sensor.width, sensor.height),
        unknown=tuple(table.unknown),
        additional_set=table.additional_set,
    )


def _template(table: TemplateTable, photo_names: dict[str, str], photos_of: dict[str, list[str]]) -> Template:
    """Return a template with its photos: those that it lists, then those that name it, as the photos spell them."""
    listed = [photo_names[record_key(photo)] for photo in table.photos]
    return Template(
        name=table.name,
        temtick=table.temtick,
        stage=table.stage,
        photos=tuple(dict.fromkeys([*listed, *photos_of.get(table.name, [])])),
        scan=_scan(table.scan),
    )


def _photo(table: PhotoTable, template: str | None) -> Photo:
    return Photo(
        name=table.name,
        camera=table.camera,
        template=template,
        stage=table.stage,
        orientation=tuple(getattr(table, parameter) for parameter in PHOTO_PARAMETERS),
        constant=tuple(table.constant),
        scan=_scan(table.scan),
    )


def _bundle(bundle: Located[BundleTable], models: list[Located[ModelTable]]) -> BundleDefinition:
    table = bundle.table
    return BundleDefinition(
        name=table.name,
        measurement_precision=table.measurement_precision,
        enp_stop=table.enp_stop,
        max_iterations=table.max_iterations,
        start_down_weight=table.start_down_weight,
        max_standard_residual=table.max_standard_residual,
        max_lost_digits=table.max_lost_digits,
        datum=table.datum,
        datum_points=tuple(table.datum_points),
        models=tuple(_model(model.table) for model in models if model.place[:2] == bundle.place),
    )


def _model(table: ModelTable) -> StereoModel:
    return StereoModel(table.name, table.left, table.right, table.row, table.column)
