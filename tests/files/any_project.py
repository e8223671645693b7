"""Hypothesis strategies for project definitions that orip.toml can say."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from orip.files.project.file_names import file_name_fault
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark, Sensor, with_lens_of
from orip.records.definition import BundleDefinition, Precision, ProjectDefinition, StereoModel
from orip.records.names import name_fault, record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo, Scan, Template, Temtick
from orip.structs import replace

letters = st.characters(codec="utf-8", categories=("L", "N", "P", "S"))
names = (
    st.sampled_from(["1", "07", "P1", "Ö#1", 'q"uo\\te', "a,b", "x.y", "[z]"])
    | st.text(letters, min_size=1, max_size=6)
).filter(lambda name: name_fault(name) is None)
file_names = names.filter(lambda name: file_name_fault(name) is None and record_key(name) not in {"INTERIOR", "PRELIM"})
numbers = st.floats(allow_nan=False, allow_infinity=False).map(lambda value: value + 0.0)
positive = st.floats(min_value=1e-9, max_value=1e9)
angles = st.floats(-360.0, 360.0).map(lambda value: value + 0.0)
distances = st.floats(1e-9, 1e5)
printed = st.text(st.characters(codec="ascii", min_codepoint=33, max_codepoint=126), max_size=20)


GROUND = ("m", None), ("US survey foot", None), ("m", "EPSG:2056"), ("US survey foot", "EPSG:2263")
"""Units of the ground, each with a crs that has it, or none."""


def some(strategy: Any) -> Any:
    return st.none() | strategy


def unique(strategy: Any, **limits: int) -> Any:
    return st.lists(strategy, unique_by=record_key, **limits)


def some_of(given: tuple[str, ...]) -> Any:
    return st.lists(st.sampled_from(given), unique=True).map(tuple)


marks = st.lists(st.builds(Mark, names, numbers, numbers), unique_by=lambda mark: mark.name, max_size=4).map(tuple)
scans = st.builds(Scan, st.tuples(positive, positive), st.sampled_from(["corner", "centre"]))
stages = some(st.sampled_from(["UPPER", "LOWER"]))


@st.composite
def cameras(draw: Any, name: str) -> Camera:
    form = draw(st.sampled_from(["polynomial", "isp", "curve"]))
    coefficients = st.just(0.0) | numbers
    radial = draw(st.tuples(*[coefficients] * 5)) if form == "polynomial" else (0.0,) * 5
    polynomial = (*radial, *draw(st.tuples(*[coefficients] * 4)))
    radii = (
        draw(st.lists(st.integers(1, 150).map(float), unique=True, min_size=4, max_size=6)) if form == "curve" else []
    )
    small = st.floats(-1.0, 1.0)
    camera = Camera(
        name,
        (draw(distances), draw(numbers), draw(numbers), *polynomial, 0.0),
        draw(st.sampled_from(["ideal", "measured"])),
        draw(st.tuples(*[st.floats(-1e3, 1e3)] * 4)) if form == "isp" else None,
        tuple((radius, draw(small)) for radius in radii) if form == "curve" else None,
        draw(some(st.tuples(positive, positive))),
        unknown=draw(some_of(CAMERA_PARAMETERS[:12])),
        additional_set=draw(some(st.sampled_from(["EBNER", "GRUEN"]))),
        projection=draw(st.sampled_from(["perspective", "equidistant"])),
        readout_direction=draw(st.sampled_from(["down", "up", "right", "left"])),
    )
    if draw(st.booleans()):
        sizes = st.integers(1, 100_000)
        return replace(camera, sensor=Sensor(draw(sizes), draw(sizes), draw(positive), draw(positive)))
    return replace(camera, fiducials=draw(marks))


@st.composite
def bundles(draw: Any, name: str, photos: list[str]) -> BundleDefinition:
    iterations = draw(st.integers(2, 100))
    datum = draw(st.sampled_from(["control", "free"]))
    models = []
    if len(photos) > 1:
        for index, model in enumerate(draw(unique(names, max_size=3))):
            left, right = draw(st.permutations(photos))[:2]
            models.append(StereoModel(model, left, right, index // 2 + 1, index % 2 + 1))
    return BundleDefinition(
        name,
        Precision(draw(st.floats(1e-6, 1e3))),  # pixels would need a sensor or scan in every photo
        draw(positive),
        iterations,
        draw(st.integers(2, iterations)),
        draw(positive),
        draw(st.floats(5.0, 13.0)),
        datum,
        tuple(draw(st.lists(names, unique=True, max_size=3))) if datum == "free" else (),
        tuple(models),
        draw(st.sampled_from(["replace", "mean"])),
    )


@st.composite
def project_definitions(draw: Any) -> ProjectDefinition:
    """Return definitions as a text is read: distortions of another form have a polynomial of 0."""
    camera_records = [draw(cameras(name)) for name in draw(unique(names, max_size=3))]
    if len(camera_records) > 1 and draw(st.booleans()):
        lens, other = (replace(camera, additional_set=None) for camera in camera_records[:2])
        camera_records[:2] = lens, with_lens_of(replace(other, same_lens_as=lens.name), lens)
    temticks = [Temtick(name, draw(marks)) for name in draw(unique(names, max_size=2))]
    template_names = draw(unique(names, max_size=2)) if temticks else []
    photos = [
        draw(_photo(name, camera_records, template_names)) for name in draw(unique(names, max_size=4)) if camera_records
    ]
    templates = [
        Template(
            name,
            draw(st.sampled_from(temticks)).name,
            draw(stages),
            tuple(draw(st.permutations([photo.name for photo in photos if photo.template == name]))),
            draw(some(scans)),
        )
        for name in template_names
    ]
    bundle_names = draw(unique(file_names, max_size=2))
    ground_unit, crs = draw(st.sampled_from(GROUND))
    return ProjectDefinition(
        name="P" + draw(st.text("AZ09_-", max_size=19)),
        user=draw(printed),
        camera_file="C.CAM",
        temtick_file="T.TIK",
        project_files=draw(file_names),
        control_files=draw(file_names),
        measurement_files=("*.MEA",),
        ground_unit=ground_unit,
        crs=crs,
        cameras=tuple(camera_records),
        temticks=tuple(temticks),
        templates=tuple(templates),
        photos=tuple(_with_scan_of_template(photo, templates) for photo in photos),
        bundles=tuple(draw(bundles(name, [photo.name for photo in photos])) for name in bundle_names),
        gates=draw(st.sampled_from([(), ("sigma0<=1.5",)])),
    )


@st.composite
def _photo(draw: Any, name: str, camera_records: list[Camera], templates: list[str]) -> Photo:
    camera = draw(st.sampled_from(camera_records))
    template = draw(some(st.sampled_from(templates))) if templates and camera.sensor is None else None
    return Photo(
        name,
        camera.name,
        template,
        draw(stages) if template is None else None,
        draw(st.tuples(*[some(numbers)] * 3, *[some(angles)] * 3)),
        draw(some_of(PHOTO_PARAMETERS)),
        draw(some(scans)) if camera.sensor is None else None,
    )


def _with_scan_of_template(photo: Photo, templates: list[Template]) -> Photo:
    """Return the photo with no other scan than its template has."""
    on = next((template for template in templates if template.name == photo.template), None)
    return photo if on is None or on.scan is None else replace(photo, scan=None)
