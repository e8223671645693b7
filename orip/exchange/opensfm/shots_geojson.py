"""Orientations of OpenDroneMap's report (``odm_report/shots.geojson``): photos on the map, after the adjustment.

A shot has the projection centre in the output's map projection (``translation``), the rotation vector from ground to
camera, and the focal length divided by the longer side of the photo. There are neither distortion nor measurements. The
projection is named in the first line of ``odm_georeferencing/coords.txt``.
"""

from __future__ import annotations

from pathlib import Path

from orip.errors import Complaint
from orip.exchange.opensfm.point_lists import crs_of_heading
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.faults import Faults
from orip.exchange.sources.json_tree import JsonValue, read_json
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed, shown_token
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject, PoseReading

READING = PoseReading("y_down", "to_camera", "rotation_vector", "radian", "centre")

_COORDS = "odm_georeferencing/coords.txt"
_FIRST_LINE = 300


def is_shots_geojson(source: Path) -> bool:
    """Return whether a file is such a report by its name."""
    return source.is_file() and source.suffix.lower() == ".geojson" and source.name.startswith("shots")


def read_shots_geojson(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read photos with their orientations, and cameras without distortion."""
    faults = Faults(shown)
    document = read_json(source, faults)
    features = None if document is None else document.required("features")
    cameras: dict[str, ExchangedCamera] = {}
    photos: list[ExchangedPhoto] = []
    for feature in features.items() if features is not None else ():
        properties = feature.required("properties")
        if properties is not None:
            _add_shot(properties, cameras, photos)
    if not faults.complaints and not photos:
        faults.complaints.append(Complaint("the file has no photo; name odm_report/shots.geojson", shown))
    if faults.complaints:
        return Parsed(None, tuple(faults.complaints))
    crs = crs_of_heading(beginning(source.parent.parent / _COORDS, _FIRST_LINE).partition("\n")[0])
    notes = ["The file has neither distortion nor measurements: photos are oriented, and nothing can be adjusted."]
    if crs is None:
        notes.append(f"There is no {_COORDS} that names the map projection: write crs into orip.toml.")
    return Parsed(
        ExchangedProject(
            name="",
            cameras=tuple(cameras.values()),
            photos=tuple(photos),
            points=CollectedPoints().points(),
            rays=CollectedRays().rays(),
            readings=(READING,),
            crs=crs,
            ground_unit="m",
            notes=tuple(notes),
        )
    )


def _add_shot(properties: JsonValue, cameras: dict[str, ExchangedCamera], photos: list[ExchangedPhoto]) -> None:
    name = properties.text("filename")
    focal, width, height = (properties.number(key) for key in ("focal", "width", "height"))
    position, rotation = properties.numbers("translation", 3), properties.numbers("rotation", 3)
    if name is None or position is None or rotation is None:
        return
    if focal is None or width is None or height is None:
        return
    if min(focal, width, height) <= 0 or max(width, height) > _LARGEST_SIDE:
        properties.complain(f"focal, width and height of '{shown_token(name)}' have to be above 0; correct them")
        return
    # older reports name no camera: one for each size and focal length
    camera = properties.text("camera") if properties.get("camera") is not None else f"{width:g}x{height:g} {focal:g}"
    if camera is None:
        return
    if camera not in cameras:
        pixels = focal * max(width, height)
        plane = {"fx": pixels, "fy": pixels, "cx": width / 2.0, "cy": height / 2.0}
        cameras[camera] = ExchangedCamera(camera, int(width), int(height), "opencv", plane, "perspective")
    place = list(cameras).index(camera)
    photos.append(ExchangedPhoto(name, place, rotation, position, key=len(photos)))


_LARGEST_SIDE = 1e6
"""Pixels that no photo has."""
