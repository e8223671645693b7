"""A project as Blocks Exchange XML: cameras, photos, control and tie points in one file, in matrices, y down."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from orip.exchange.format import require_without
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, PoseReading
from orip.records.observations.control import ControlPoint

READING = PoseReading("y_down", "to_camera", "matrix", "radian", "centre")

_DISTORTION = ("K1", "K2", "K3", "P1", "P2")
_CATEGORIES = {(True, True): "Full", (True, False): "Horizontal", (False, True): "Vertical"}


def write_blocks_exchange(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return the file; coordinates are in the project's crs, or a local system."""
    return {"block.xml": "".join(_pieces(project)).encode()}


def _pieces(project: ExchangedProject) -> Iterator[str]:
    definition = project.crs or 'LOCAL_CS["Local",UNIT["metre",1]]'
    yield (
        '<?xml version="1.0" encoding="utf-8"?>\n<BlocksExchange version="2.1">\n<SpatialReferenceSystems><SRS>'
        f"<Id>0</Id><Name>{escape(definition[:60])}</Name><Definition>{escape(definition)}</Definition></SRS>"
        f"</SpatialReferenceSystems>\n<Block>\n<Name>{escape(project.name or 'orip')}</Name><SRSId>0</SRSId>\n"
        "<Photogroups>\n"
    )
    for number, camera in enumerate(project.cameras):
        yield f"<Photogroup>\n{_camera(camera)}"
        for key, photo in enumerate(project.photos):
            if photo.camera == number:
                yield _photo(key, photo)
        yield "</Photogroup>\n"
    yield "</Photogroups>\n<ControlPoints>\n"
    marks = _marks(project)
    control = {point.name for point in project.control}
    places = project.points.marks
    for point in project.control:
        yield _control(point, marks.get(places.get(point.name, -1), []))
    yield "</ControlPoints>\n<TiePoints>\n"
    for place, rows in marks.items():
        xyz = project.points.coordinates[place].tolist()
        if project.points.is_track[place] or project.points.names[place] not in control:
            position = f"<Position>{_place(xyz)}</Position>" if all(map(math.isfinite, xyz)) else ""
            yield f"<TiePoint>{position}{''.join(rows)}</TiePoint>\n"
    yield "</TiePoints>\n</Block>\n</BlocksExchange>\n"


def _camera(camera: ExchangedCamera) -> str:
    value = camera.parameters
    require_without(camera, ("k4", "p3", "p4", "b1", "b2"), "Blocks Exchange XML")
    sensor = "" if camera.sensor_mm is None else f"<SensorSize>{max(camera.sensor_mm)!r}</SensorSize>"
    distortion = "".join(f"<{tag}>{value.get(tag.lower(), 0.0)!r}</{tag}>" for tag in _DISTORTION)
    return (
        f"<Name>{escape(camera.name)}</Name>\n<ImageDimensions><Width>{camera.columns}</Width><Height>{camera.rows}"
        f"</Height></ImageDimensions>\n<CameraModelType>Perspective</CameraModelType>{sensor}<FocalLengthPixels>"
        f"{value['f']!r}</FocalLengthPixels>\n<CameraOrientation>XRightYDown</CameraOrientation>\n<PrincipalPoint><x>"
        f"{value['cx']!r}</x><y>{value['cy']!r}</y></PrincipalPoint>\n<Distortion>{distortion}</Distortion>\n"
    )


def _photo(key: int, photo: ExchangedPhoto) -> str:
    head = f"<Photo><Id>{key}</Id><ImagePath>{escape(photo.name)}</ImagePath>"
    if not photo.rotation or not photo.position:
        return f"{head}</Photo>\n"
    matrix = "".join(f"<M_{n // 3}{n % 3}>{float(v)!r}</M_{n // 3}{n % 3}>" for n, v in enumerate(photo.rotation))
    return f"{head}<Pose><Rotation>{matrix}</Rotation><Center>{_place(photo.position)}</Center></Pose></Photo>\n"


def _control(point: ControlPoint, marks: Sequence[str]) -> str:
    x, y, z = point.coordinates
    category = _CATEGORIES.get((x is not None and y is not None, z is not None), "Full")
    check = "true" if point.kind == "check" else "false"
    across, up = point.errors[0], point.errors[2]
    horizontal = "" if not across else f"<HorizontalAccuracy>{abs(across)!r}</HorizontalAccuracy>"
    vertical = "" if not up else f"<VerticalAccuracy>{abs(up)!r}</VerticalAccuracy>"
    position = _place([value or 0.0 for value in point.coordinates])
    return (
        f"<ControlPoint><SRSId>0</SRSId><Name>{escape(point.name)}</Name><Position>{position}</Position><Category>"
        f"{category}</Category><CheckPoint>{check}</CheckPoint>{horizontal}{vertical}{''.join(marks)}</ControlPoint>\n"
    )


def _marks(project: ExchangedProject) -> dict[int, list[str]]:
    """Return the measurements of points by their places."""
    rays = project.rays
    found: dict[int, list[str]] = {}
    for row in np.flatnonzero(rays.is_active).tolist():
        x, y = rays.image[row].tolist()
        mark = f"<Measurement><PhotoId>{rays.photo[row]}</PhotoId><x>{x!r}</x><y>{y!r}</y></Measurement>"
        found.setdefault(int(rays.point[row]), []).append(mark)
    return found


def _place(xyz: Sequence[float]) -> str:
    return "".join(f"<{tag}>{float(value)!r}</{tag}>" for tag, value in zip("xyz", xyz, strict=True))
