"""The project definition that the records of an orip.toml make up; what is to be checked has been checked."""

from __future__ import annotations

from orip.files.project.source import Located, ProjectSource
from orip.files.project.tables import ProjectTable
from orip.records.names import record_key
from orip.records.project.camera import with_shared_lenses
from orip.records.project.definition import BundleDefinition, ProjectDefinition, StereoModel
from orip.records.project.photo import Template
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
        crs=project.crs,
        cameras=with_shared_lenses(camera.record for camera in source.cameras),
        temticks=tuple(temtick.record for temtick in source.temticks),
        templates=tuple(_with_photos(template.record, photo_names, photos_of) for template in source.templates),
        photos=tuple(replace(p.record, template=template_of.get(record_key(p.record.name))) for p in source.photos),
        bundles=tuple(_with_models(bundle, source.models) for bundle in source.bundles),
        gates=source.check.gates,
        test_level=source.check.test_level,
        report=source.report,
        antennas=tuple(antenna.record for antenna in source.antennas),
        output_folder=project.output_folder,
    )


def _with_photos(template: Template, photo_names: dict[str, str], photos_of: dict[str, list[str]]) -> Template:
    """Return a template with its photos: those that it lists, then those that name it, as the photos spell them."""
    listed = [photo_names[record_key(photo)] for photo in template.photos]
    return replace(template, photos=tuple(dict.fromkeys([*listed, *photos_of.get(template.name, [])])))


def _with_models(bundle: Located[BundleDefinition], models: list[Located[StereoModel]]) -> BundleDefinition:
    return replace(bundle.record, models=tuple(model.record for model in models if model.place[:2] == bundle.place))
