"""A project as cameras XML of Metashape with its markers: a new document, or one in which the adjusted numbers are put.

Tie points have no place in these documents. Metashape finds cameras and sensors by their labels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

from orip.exchange.metashape.copy import copied_document, document_file
from orip.exchange.metashape.reference_writer import reference_files
from orip.exchange.metashape.sensors import PARAMETERS
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject
from orip.records.observations.control import ControlPoint

_NAME = "cameras.xml"
_LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]]]'
_IDENTITY = "1 0 0 0 1 0 0 0 1"


def write_metashape(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:
    """Return the document of cameras and markers, a copy of the original where that is one, and reference tables.

    Raises
    ------
    InputError
        If the original is damaged or gone, or if labels in it do not tell its cameras from one another.
    """
    path = None if original is None else document_file(original)
    if path is not None:
        return {path.name: copied_document(project, path), **reference_files(project)}
    return {_NAME: "\n".join([*_document(project), ""]).encode(), **reference_files(project)}


def _document(project: ExchangedProject) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n<document version="1.5.0">'
    yield f'<chunk label={quoteattr(project.name or "Chunk 1")} enabled="true">\n<sensors>'
    for number, camera in enumerate(project.cameras):
        yield from _sensor(number, camera)
    yield '</sensors>\n<components>\n<component id="0" label="Component 1"><transform>'
    yield f"<rotation>{_IDENTITY}</rotation><translation>0 0 0</translation><scale>1</scale>"
    yield "</transform></component>\n</components>\n<cameras>"
    for number, photo in enumerate(project.photos):
        yield from _camera(number, photo)
    yield "</cameras>\n<markers>"
    control = {point.name: point for point in project.control}
    marks = project.points.marks
    for number, name in enumerate(marks):
        yield f'<marker id="{number}" label={quoteattr(name)}>{_reference(control.get(name))}</marker>'
    yield '</markers>\n<frames>\n<frame id="0">\n<markers>'
    yield from _locations(project, list(marks.values()))
    yield f"</markers>\n</frame>\n</frames>\n<reference>{_LOCAL}</reference>\n</chunk>\n</document>"


def _sensor(number: int, camera: ExchangedCamera) -> Iterator[str]:
    kind = "fisheye" if camera.lens == "agisoft_fisheye" else "frame"
    size = f'width="{camera.columns}" height="{camera.rows}"'
    yield f'<sensor id="{number}" label={quoteattr(camera.name)} type="{kind}">\n<resolution {size}/>'
    if camera.sensor_mm is not None:
        # of square pixels: b1 says how much wider they are
        pixel = camera.sensor_mm[1] / camera.rows
        yield "".join(f'<property name="pixel_{side}" value="{pixel!r}"/>' for side in ("width", "height"))
    yield f'<calibration type="{kind}" class="adjusted">\n<resolution {size}/>'
    values = sensor_parameters(camera)
    yield "".join(f"<{name}>{values[name]!r}</{name}>" for name in PARAMETERS if values[name] or name == "f")
    yield "</calibration>\n</sensor>"


def sensor_parameters(camera: ExchangedCamera) -> dict[str, float]:
    """Return the parameters of a camera as they are in a document: the principal point from the middle of the frame."""
    values = {name: float(camera.parameters.get(name, 0.0)) for name in PARAMETERS}
    return {**values, "cx": values["cx"] - camera.columns / 2.0, "cy": values["cy"] - camera.rows / 2.0}


def _camera(number: int, photo: ExchangedPhoto) -> Iterator[str]:
    begin = f'<camera id="{number}" sensor_id="{photo.camera}" component_id="0" label={quoteattr(photo.name)}'
    if not photo.rotation:
        yield f"{begin}/>"
        return
    rows = [(*photo.rotation[3 * n : 3 * n + 3], photo.position[n]) for n in range(3)]
    matrix = " ".join(repr(float(value)) for row in rows for value in row)
    covariance = ""
    if photo.position_covariance is not None:
        words = " ".join(map(repr, photo.position_covariance))
        covariance = f"<location_covariance>{words}</location_covariance>"
    yield f"{begin}><transform>{matrix} 0 0 0 1</transform>{covariance}</camera>"


def _reference(point: ControlPoint | None) -> str:
    """Return what is known of a control point; a check point is not enabled."""
    if point is None:
        return ""
    words = [f'{axis}="{value!r}"' for axis, value in zip("xyz", point.coordinates, strict=True) if value is not None]
    errors = [error for error in point.errors if error is not None]
    if errors:
        words += [f's{axis}="{abs(error or errors[0])!r}"' for axis, error in zip("xyz", point.errors, strict=True)]
    is_check = any(math.copysign(1.0, error) < 0 for error in errors)
    return f'<reference {" ".join(words)} enabled="{"false" if is_check else "true"}"/>'


def _locations(project: ExchangedProject, marked: list[int]) -> Iterator[str]:
    number = {row: n for n, row in enumerate(marked)}
    places: dict[int, list[str]] = {}
    rays = project.rays
    for row, (photo, point) in enumerate(zip(rays.photo.tolist(), rays.point.tolist(), strict=True)):
        if point in number and rays.is_active[row]:
            x, y = rays.image[row].tolist()
            places.setdefault(point, []).append(f'<location camera_id="{photo}" pinned="true" x="{x!r}" y="{y!r}"/>')
    for point, found in places.items():
        yield f'<marker marker_id="{number[point]}">{"".join(found)}</marker>'
