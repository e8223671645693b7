"""Sensors of Metashape: their frame and calibration, and calibrations exported by themselves (Agisoft's XML)."""

from __future__ import annotations

from pathlib import Path

from orip.exchange.format import Format
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import XmlElement, XmlFields, is_true, plain, read_xml
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed, shown_token
from orip.records.exchanged import ExchangedCamera, ExchangedProject, Lens

# The frame camera has f, b1, b2 in pixels and cx, cy in pixels from the middle of the frame, y down; what is missing is
# 0. Documents of PhotoScan before 1.3 have fx, fy, skew, principal points from the corner, and p1, p2 exchanged.

_RADIAL = ("k1", "k2", "k3", "k4")
_DECENTRING = ("p1", "p2", "p3", "p4")
_AFFINE = ("b1", "b2")
_FISHEYE = "fisheye"

PARAMETERS = ("f", "cx", "cy", *_AFFINE, *_RADIAL, *_DECENTRING)
"""Of a calibration, in the order of the documents."""


_PLANE = ("f", "cx", "cy")


def read_sensor(sensor: XmlElement, fields: XmlFields) -> ExchangedCamera | None:
    """Return a sensor as a camera; None if it has no calibration, or if complaints are kept."""
    name = sensor.attributes.get("label") or f"sensor {sensor.attributes.get('id', '')}"
    calibration = _adjusted(sensor)
    resolution = sensor.child("resolution")
    if resolution is None and calibration is not None:
        resolution = calibration.child("resolution")
    if resolution is None:
        fields.faults.complain(f"sensor '{shown_token(name)}' has no resolution; export the cameras again", sensor.line)
        return None
    width, height = fields.attribute_whole(resolution, "width", 1), fields.attribute_whole(resolution, "height", 1)
    if width is None or height is None:
        return None
    kind = sensor.attributes.get("type", "frame")
    if calibration is None:
        return _uncalibrated(sensor, fields, name, (width, height))
    size = _sensor_size(sensor, fields, (width, height))
    camera = calibrated(calibration, fields, name, (width, height), kind)
    if camera is None:
        return None
    free = () if is_true(_property(sensor, "fixed"), missing=False) else _estimated(sensor, calibration, camera)
    return ExchangedCamera(
        camera.name,
        camera.columns,
        camera.rows,
        camera.lens,
        camera.parameters,
        camera.model,
        sensor_mm=size,
        free=free,
    )


def read_lens_file(path: Path, faults: Faults) -> ExchangedCamera | None:
    """Return the camera of a calibration exported by itself; None, and complaints kept, if it is not one."""
    root = read_xml(path, faults)
    if root is None:
        return None
    if root.tag != "calibration":
        faults.complain(f"this is not a camera calibration of Agisoft, but <{shown_token(root.tag)}>", root.line)
        return None
    fields = XmlFields(faults)
    sizes = [
        fields.faults.whole(found.text, f"<{tag}>", found.line, 1)
        for tag in ("width", "height")
        if (found := fields.required(root, tag)) is not None
    ]
    if len(sizes) < 2 or None in sizes:
        return None
    width, height = (size or 0 for size in sizes)
    projection = root.child("projection")
    kind = "frame" if projection is None else plain(projection.text)
    return calibrated(root, fields, path.stem, (width, height), kind)


def calibrated(
    calibration: XmlElement, fields: XmlFields, name: str, size: tuple[int, int], kind: str
) -> ExchangedCamera | None:
    """Return the camera of a calibration.

    Parameters
    ----------
    calibration : XmlElement
        Its elements are the parameters.
    size : tuple of 2 ints
        Columns and rows.
    kind : str
        ``frame``, ``fisheye`` or another one, which cannot be converted.
    """
    if kind not in ("frame", _FISHEYE):
        return ExchangedCamera(name, *size, "unsupported", {}, kind)
    if calibration.child("fx") is not None and calibration.child("f") is None:
        return _of_photoscan(calibration, fields, name, size)
    if calibration.child("f") is None:
        fields.faults.complain(
            f"the calibration of '{shown_token(name)}' has no <f>; export it again", calibration.line
        )
        return None
    value = {tag: fields.optional(calibration, tag) for tag in PARAMETERS}
    if value["f"] <= 0:
        fields.faults.complain("<f> has to be above 0; correct it", calibration.line)
        return None
    value["cx"] += size[0] / 2.0
    value["cy"] += size[1] / 2.0
    lens: Lens = "agisoft" if kind == "frame" else "agisoft_fisheye"
    return ExchangedCamera(name, *size, lens, value, kind)


def _of_photoscan(
    calibration: XmlElement, fields: XmlFields, name: str, size: tuple[int, int]
) -> ExchangedCamera | None:
    tags = ("fx", "fy", "cx", "cy", "skew", "k1", "k2", "k3", "p1", "p2")
    value = {tag: fields.optional(calibration, tag) for tag in tags}
    if min(value["fx"], value["fy"]) <= 0:
        fields.faults.complain("<fx> and <fy> have to be above 0; correct them", calibration.line)
        return None
    parameters = {
        "f": value["fy"], "b1": value["fx"] - value["fy"], "b2": value["skew"], "cx": value["cx"], "cy": value["cy"],
        "k1": value["k1"], "k2": value["k2"], "k3": value["k3"], "p1": value["p2"], "p2": value["p1"],
    }  # fmt: skip
    return ExchangedCamera(name, *size, "agisoft", parameters, "frame")


def _uncalibrated(sensor: XmlElement, fields: XmlFields, name: str, size: tuple[int, int]) -> ExchangedCamera | None:
    """Return the camera of a sensor without a calibration, from its focal length in millimetres."""
    sensor_mm = _sensor_size(sensor, fields, size)
    focal = _property(sensor, "focal_length")
    millimetres = None if focal is None else fields.faults.decimal(focal, "focal_length", sensor.line)
    if sensor_mm is None or millimetres is None or not millimetres > 0:
        return None
    pixels = millimetres / sensor_mm[0] * size[0]
    parameters = {"f": pixels, "cx": size[0] / 2.0, "cy": size[1] / 2.0}
    return ExchangedCamera(name, *size, "agisoft", parameters, "frame", sensor_mm=sensor_mm)


def _adjusted(sensor: XmlElement) -> XmlElement | None:
    """Return the adjusted calibration of a sensor; any other one if there is none."""
    found = list(sensor.all("calibration"))
    adjusted = [item for item in found if item.attributes.get("class", "adjusted") == "adjusted"]
    return next(iter(adjusted or found), None)


def _estimated(sensor: XmlElement, calibration: XmlElement, camera: ExchangedCamera) -> tuple[str, ...]:
    """Return the parameters that were estimated: those with covariances; without any, those of an adjusted one."""
    for path in ("covariance/params", "calibration/covariance/params"):
        found = sensor.child(path)
        if found is not None:
            return tuple(name for name in found.text.split() if name in PARAMETERS)
    if calibration.attributes.get("class", "adjusted") != "adjusted":
        return ()
    return tuple(name for name, value in camera.parameters.items() if name in _PLANE or value)


def _sensor_size(sensor: XmlElement, fields: XmlFields, size: tuple[int, int]) -> tuple[float, float] | None:
    pixels = [_property(sensor, name) for name in ("pixel_width", "pixel_height")]
    if any(pixel is None for pixel in pixels):
        return None
    width, height = (fields.faults.decimal(pixel or "", "pixel size", sensor.line) for pixel in pixels)
    return (width * size[0], height * size[1]) if width > 0 and height > 0 else None


def _property(sensor: XmlElement, name: str) -> str | None:
    return next(
        (item.attributes.get("value") for item in sensor.all("property") if item.attributes.get("name") == name), None
    )


_BEGINNING = 1000


def is_lens(source: Path) -> bool:
    """Return whether a file begins as a calibration does."""
    text = beginning(source, _BEGINNING) if source.suffix.lower() == ".xml" else ""
    return "<calibration>" in text and "<document" not in text and "<projection>" in text


def read_lens(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read the file of a calibration."""
    faults = Faults(shown)
    camera = read_lens_file(source, faults)
    if camera is None or faults.complaints:
        return Parsed(None, tuple(faults.complaints))
    points, rays = CollectedPoints().points(), CollectedRays().rays()
    notes = ("The file has a camera alone: add photos of it to orip.toml, and their measurements.",)
    return Parsed(
        ExchangedProject(camera.name, (camera,), (), points, rays, is_calibration=True, ground_unit="m", notes=notes)
    )


LENS_FORMAT = Format("lens", "Agisoft camera calibration (XML): a camera without photos", read_lens, is_lens)
