"""Rules between the records of orip.toml: names, references, templates and photos, models, antennas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

from orip.files.project.file_names import image_path_fault
from orip.files.project.record_checks import parameter_names
from orip.files.project.source import Located, NamePlace, ProjectSource
from orip.files.project.tables import Fault, unknown_name
from orip.files.project.toml_lines import KeyPath
from orip.files.text.shown import shown_token
from orip.records.camera import CAMERA_PARAMETERS, DISTORTION_PARAMETERS, OWN_PARAMETERS, Camera
from orip.records.definition import ANTENNA_PARAMETERS, BundleDefinition, StereoModel
from orip.records.names import name_fault, record_key
from orip.records.photo import Photo, Template

LineOf = Callable[[KeyPath], int]
_Item = TypeVar("_Item")


def check_names(source: ProjectSource, line_of: LineOf) -> Iterator[Fault]:
    """Check that the names of records are fit for use and stand for one record each."""
    for section, found in source.names.items():
        if section != "model":
            yield from _record_names(section, found, line_of)
    for models in _by_bundle(source.names.get("model", []), lambda model: model.place).values():
        yield from _record_names("model", models, line_of)


def _record_names(kind: str, found: Sequence[NamePlace], line_of: LineOf) -> Iterator[Fault]:
    first: dict[str, NamePlace] = {}
    for record in found:
        place = (*record.place, "name")
        shown = shown_token(record.name)
        fault = name_fault(record.name)
        if fault is not None:
            yield place, f"{kind} name: {fault}; write one word"
        known = first.setdefault(record_key(record.name), record)
        if known is record:
            continue
        line = line_of((*known.place, "name"))
        if known.name == record.name:
            yield place, f"{kind} '{shown}' is already defined on line {line}; rename or remove one of them"
        else:
            twin = f"{kind} '{shown}' differs from '{shown_token(known.name)}' on line {line} only in case"
            yield place, f"{twin}, which does not count in record names; rename one of them"


def _by_bundle(items: Iterable[_Item], place_of: Callable[[_Item], KeyPath]) -> dict[KeyPath, list[_Item]]:
    grouped: dict[KeyPath, list[_Item]] = {}
    for item in items:
        grouped.setdefault(place_of(item)[:2], []).append(item)
    return grouped


def check_lenses(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check cameras with the lens of another one: which that is, and that they give nothing that it determines."""
    for camera in source.cameras:
        lens_name, where = camera.record.same_lens_as, f"camera '{camera.record.name}'"
        if lens_name is None:
            continue
        place, shown = (*camera.place, "same_lens_as"), shown_token(lens_name)
        yield from ((place, text) for text in references.check("camera", lens_name, f"same_lens_as of {where}"))
        lens = references.cameras.get(record_key(lens_name))
        if record_key(lens_name) == record_key(camera.record.name):
            yield place, f"same_lens_as of {where} names the camera itself; name another one or remove it"
        elif lens is not None and lens.same_lens_as is not None:
            other = shown_token(lens.same_lens_as)
            text = f"same_lens_as of {where} names camera '{shown}', which has the lens of '{other}'; name '{other}'"
            yield place, text
        for key, what in _of_the_lens(camera.record):
            yield (*camera.place, key), f"{where} has {what}, but its lens is that of camera '{shown}'; give it there"
        if camera.record.additional_set is not None or (lens is not None and lens.additional_set is not None):
            message = f"{where} has the lens of camera '{shown}', and a set cannot be adjusted for both; remove the set"
            yield place, message


def _of_the_lens(camera: Camera) -> Iterator[tuple[str, str]]:
    """Yield the keys of a camera that its lens determines, and what each of them is."""
    parameters = dict(zip(CAMERA_PARAMETERS, camera.parameters, strict=True))
    if not math.isnan(parameters["C"]):
        yield "c", "c"
    given = [name for name in DISTORTION_PARAMETERS if parameters[name] != 0.0]
    if given:
        yield "distortion", f"{', '.join(given)} of distortion"
    if camera.distortion_isp is not None:
        yield "distortion_isp", "distortion_isp"
    if camera.distortion_curve is not None:
        yield "distortion_curve", "distortion_curve"
    if camera.distortion_at != "ideal":
        yield "distortion_at", "distortion_at"
    if camera.projection != "perspective":
        yield "projection", "projection"
    unknown = [name for name in camera.unknown if name not in OWN_PARAMETERS]
    if unknown:
        yield "unknown", f"{', '.join(unknown)} unknown"


class References:
    """The records that names lead to, and which photo is on which template."""

    def __init__(self, source: ProjectSource) -> None:
        self.known = {
            section: {record_key(found.name): found.name for found in source.names.get(section, [])}
            for section in ("camera", "temtick", "template", "photo", "bundle")
        }
        self.cameras = {record_key(camera.record.name): camera.record for camera in source.cameras}
        self.templates = {record_key(template.record.name): template for template in source.templates}
        self.photos = {record_key(photo.record.name): photo for photo in source.photos}
        self.template_of = _template_of_photos(source)

    def check(self, kind: str, name: str, where: str) -> Iterator[str]:
        """Give a message if no record of that kind has the name."""
        if record_key(name) not in self.known[kind]:
            yield unknown_name(name, kind, where, list(self.known[kind].values()))

    def template(self, photo: str) -> Located[Template] | None:
        """Return the template that a photo is on, if any."""
        return self.templates.get(record_key(self.template_of.get(record_key(photo), "")))

    def camera(self, photo: Photo) -> Camera | None:
        """Return the camera of a photo, if it is there."""
        return self.cameras.get(record_key(photo.camera))


def _template_of_photos(source: ProjectSource) -> dict[str, str]:
    """Return the template's name by the photo's key; the first statement counts, `check_templates` looks at others."""
    found: dict[str, str] = {}
    for photo in source.photos:
        if photo.record.template is not None:
            found.setdefault(record_key(photo.record.name), photo.record.template)
    for template in source.templates:
        for name in template.record.photos:
            found.setdefault(record_key(name), template.record.name)
    return found


def check_templates(source: ProjectSource, references: References, line_of: LineOf) -> Iterator[Fault]:
    """Check temticks and photos of templates; a photo's template and a template's photos must agree."""
    listed: dict[str, tuple[str, KeyPath]] = {}
    for template in source.templates:
        table, where = template.record, f"template '{template.record.name}'"
        for message in references.check("temtick", table.temtick, where):
            yield (*template.place, "temtick"), message
        for index, name in enumerate(table.photos):
            place = (*template.place, "photos", index)
            for message in references.check("photo", name, where):
                yield place, message
            other, other_place = listed.setdefault(record_key(name), (table.name, place))
            if other_place != place:
                again = f"photo '{name}' is listed by template '{other}' on line {line_of(other_place)} already"
                yield place, f"{again}; a photo is on one template, once"
            yield from _disagreement(references, table, name, place, line_of)


def _disagreement(
    references: References, table: Template, name: str, place: KeyPath, line_of: LineOf
) -> Iterator[Fault]:
    photo = references.photos.get(record_key(name))
    if photo is None or photo.record.template is None:
        return
    if record_key(photo.record.template) != record_key(table.name):
        line = line_of((*photo.place, "template"))
        message = (
            f"template '{table.name}' lists photo '{name}', but on line {line} the photo is on template "
            f"'{photo.record.template}'; correct one of them"
        )
        yield place, message


def check_photos(source: ProjectSource, references: References, line_of: LineOf) -> Iterator[Fault]:
    """Check camera and template of photos, and that stage and scan are given once."""
    for photo in source.photos:
        where = f"photo '{photo.record.name}'"
        for message in references.check("camera", photo.record.camera, where):
            yield (*photo.place, "camera"), message
        if photo.record.template is not None:
            for message in references.check("template", photo.record.template, where):
                yield (*photo.place, "template"), message
        if photo.record.image is not None and (fault := image_path_fault(photo.record.image)):
            yield (*photo.place, "image"), f"image '{shown_token(photo.record.image)}' of {where} {fault}"
        camera = references.camera(photo.record)
        if camera is not None and camera.sensor is not None and photo.record.scan is not None:
            message = f"{where} has a scan, but its camera '{camera.name}' has a sensor; remove one of the two"
            yield (*photo.place, "scan"), message
        template = references.template(photo.record.name)
        if template is not None:
            yield from _on_template(photo, template, camera, line_of)


def _on_template(
    photo: Located[Photo], template: Located[Template], camera: Camera | None, line_of: LineOf
) -> Iterator[Fault]:
    where = f"photo '{photo.record.name}'"
    on = f"template '{template.record.name}'"
    if photo.record.stage is not None:
        yield (*photo.place, "stage"), f"{where} has a stage but is on {on}, which has its own; set it there"
    if camera is not None and camera.sensor is not None:
        message = f"{where} is on {on}, but its camera '{camera.name}' has a sensor; only film is on a template"
        yield (*photo.place, "template"), message
    own, shared = photo.record.scan, template.record.scan
    if own is not None and shared is not None and own != shared:
        line = line_of((*template.place, "scan"))
        message = f"{where} has another scan than its {on} on line {line}; remove the photo's scan or make them equal"
        yield (*photo.place, "scan"), message


def check_precision(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check that a measurement precision in pixels means something in all photos."""
    without = [photo.record.name for photo in source.photos if not _has_pixels(photo.record, references)]
    if not without:
        return
    first = f"photo '{without[0]}'"
    which = f"{first} has" if len(without) == 1 else f"{first} and {len(without) - 1} more have"
    for bundle in source.bundles:
        if bundle.record.measurement_precision.unit == "px":
            message = (
                f"bundle '{bundle.record.name}' has its measurement_precision in pixels, but {which} "
                "neither scan nor a camera with a sensor; write it in mm or give those photos a scan"
            )
            yield (*bundle.place, "measurement_precision"), message


def _has_pixels(photo: Photo, references: References) -> bool:
    camera, template = references.camera(photo), references.template(photo.name)
    # A camera that is missing or faulty is complained of elsewhere; what it would have had is not known.
    return (
        photo.scan is not None
        or camera is None
        or camera.sensor is not None
        or (template is not None and template.record.scan is not None)
    )


def check_models(source: ProjectSource, references: References, line_of: LineOf) -> Iterator[Fault]:
    """Check the photos of models and that no two models of a bundle have the same place in the block."""
    for models in _by_bundle(source.models, lambda model: model.place).values():
        seen: dict[tuple[int, int], Located[StereoModel]] = {}
        for model in models:
            table, where = model.record, f"model '{model.record.name}'"
            for key, name in (("left", table.left), ("right", table.right)):
                for message in references.check("photo", name, where):
                    yield (*model.place, key), message
            if record_key(table.left) == record_key(table.right):
                message = f"{where} has photo '{table.left}' both left and right; name two photos"
                yield (*model.place, "right"), message
            first = seen.setdefault((table.row, table.column), model)
            if first is not model:
                at = f"row {table.row}, column {table.column}"
                line = line_of((*first.place, "row"))
                message = f"{where} is at {at} like model '{first.record.name}' on line {line}; give it its own place"
                yield (*model.place, "row"), message


def check_shared(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check bundles with the photo points of another one, and the cameras that photos have in a bundle."""
    bundles = {record_key(bundle.record.name): bundle.record for bundle in source.bundles}
    for bundle in source.bundles:
        where = f"bundle '{shown_token(bundle.record.name)}'"
        if bundle.record.points_of is not None:
            place, of = (*bundle.place, "points_of"), f"points_of of {where}"
            yield from ((place, text) for text in references.check("bundle", bundle.record.points_of, of))
            other = bundles.get(record_key(bundle.record.points_of))
            if other is not None and other.points_of is not None:
                is_itself = record_key(other.name) == record_key(bundle.record.name)
                remedy = "name another bundle, or remove it" if is_itself else f"name '{shown_token(other.points_of)}'"
                yield place, f"{of}: '{shown_token(other.name)}' has no photo points of its own; {remedy}"
        yield from _cameras_in_place(bundle, references, f"cameras of {where}")


def _cameras_in_place(bundle: Located[BundleDefinition], references: References, of: str) -> Iterator[Fault]:
    seen = set[str]()
    for index, (name, in_place) in enumerate(bundle.record.cameras):
        place = (*bundle.place, "cameras", index)
        yield from ((place, text) for one in (name, in_place) for text in references.check("camera", one, of))
        if record_key(name) in seen:
            yield place, f"{of}: camera '{shown_token(name)}' comes twice; name one camera in its place"
        seen.add(record_key(name))
        camera, other = (references.cameras.get(record_key(one)) for one in (name, in_place))
        if camera and other and (camera.sensor, camera.fiducials) != (other.sensor, other.fiducials):
            message = (
                f"{of}: '{shown_token(in_place)}' has another sensor or other fiducials than '{shown_token(name)}', "
                "in whose photos points were measured; give it the same"
            )
            yield place, message


_EVERY = ""
"""Key of an antenna for all cameras."""


def check_antennas(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check that the cameras of antennas are defined and have one each, and the names of unknown parameters."""
    taken: dict[str, str] = {}
    for antenna in source.antennas:
        record, where = antenna.record, f"antenna '{shown_token(antenna.record.name)}'"
        place = (*antenna.place, "cameras")
        for index, camera in enumerate(record.cameras):
            for message in references.check("camera", camera, where):
                yield (*place, index), message
        for key in map(record_key, record.cameras or (_EVERY,)):
            other = taken.get(key, taken.get(_EVERY) if key != _EVERY else next(iter(taken.values()), None))
            if other is not None:
                cameras = f"camera {key}" if key else "all cameras"
                yield place, f"{where} is for {cameras}, but antenna '{other}' too; give each its own cameras = [...]"
            taken.setdefault(key, shown_token(record.name))
        unknown = (*antenna.place, "unknown")
        yield from parameter_names(unknown, record.unknown, ANTENNA_PARAMETERS, f"unknown of {where}")
