"""XML of MMVII (``MMVII-PhgrProj``): cameras, orientations, points on the ground and in photos.

The distortion is that of coordinates divided by the focal length, from ideal to measured. Axes I, J, K are those of
the camera in the world, y down, z forward. Texts are in quotes.
"""

from __future__ import annotations

from pathlib import Path

from orip.exchange.micmac.version1 import Calibration, GroundPoint, Orientation, PhotoMark
from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import XmlElement, XmlFields, read_xml
from orip.files.text.shown import shown_token

_RADIAL = ("K1", "K2", "K3", "K4")
_DECENTRING, _AFFINE = ("p1", "p2"), ("b1", "b2")
_DISTORTION = {"Radial": _RADIAL, "Decentric": _DECENTRING, "Polynomial": _AFFINE}


def read_calibration(path: Path, faults: Faults) -> Calibration | None:
    """Read a camera; None, and complaints kept, if it cannot be represented."""
    camera = _element(path, "InternalCalibration", faults)
    if camera is None:
        return None
    fields = XmlFields(faults)
    projection = fields.text(camera, "Projection")
    if projection is not None and projection != "Stenope":
        faults.complain(f"the projection '{shown_token(projection)}' cannot be converted; Stenope can", camera.line)
    focal, point = fields.decimal(camera, "PerfectProj/F"), fields.decimals(camera, "PerfectProj/PP", 2)
    size = fields.decimals(camera, "PixelFrame/NbPix", 2)
    terms = _terms(camera, fields)
    if focal is None or point is None or size is None:
        return None
    if focal <= 0 or min(size) < 1:
        faults.complain("the size of the photo and the focal length have to be above 0; correct them", camera.line)
        return None
    centre = (point[0], point[1])
    radial = tuple(terms.get(name, 0.0) for name in _RADIAL)
    p1, p2, b1, b2 = (terms.get(name, 0.0) for name in _DECENTRING + _AFFINE)
    return Calibration(centre, focal, (int(size[0]), int(size[1])), centre, radial, (p1, p2), (b1, b2), normalised=True)


def _terms(camera: XmlElement, fields: XmlFields) -> dict[str, float]:
    """Return the terms of the distortion by name; those that have no counterpart are complained of unless 0."""
    terms: dict[str, float] = {}
    distortion = camera.child("Distorsion")
    for part in distortion.children if distortion is not None else ():
        for term in part.children:
            value = fields.faults.decimals(term.text, 1, f"<{term.tag}>", term.line)
            if value is None or value[0] == 0.0:
                continue
            if term.tag in _DISTORTION.get(part.tag, ()):
                terms[term.tag] = value[0]
            else:
                message = f"the term {part.tag} {term.tag} of the distortion cannot be converted; calibrate without it"
                fields.faults.complain(message, term.line)
    return terms


def read_orientation(path: Path, faults: Faults) -> Orientation | None:
    """Read the orientation of a photo."""
    pose = _element(path, "CameraPose", faults)
    if pose is None:
        return None
    fields = XmlFields(faults)
    photo, calibration = fields.text(pose, "NameImage"), fields.text(pose, "NameInternalCalib")
    centre = fields.decimals(pose, "Center", 3)
    axes = [fields.decimals(pose, f"RotMatrix/{tag}", 3) for tag in ("AxeI", "AxeJ", "AxeK")]
    first, second, third = axes
    if photo is None or calibration is None or centre is None or first is None or second is None or third is None:
        return None
    rotation = tuple(axis[row] for row in range(3) for axis in (first, second, third))
    return Orientation(photo, calibration, centre, rotation)


def read_ground_points(path: Path, faults: Faults) -> tuple[GroundPoint, ...]:
    """Read points on the ground (``MesGCP-*.xml``); a unit matrix of covariances is MMVII's default."""
    points = _element(path, "SetGCP", faults)
    fields, found = XmlFields(faults), []
    for element in _measures(points):
        name, coordinates = fields.text(element, "Name"), fields.decimals(element, "Pt", 3)
        covariance = None
        if element.child("__Opt__Sigma2") is not None:
            covariance = fields.decimals(element, "__Opt__Sigma2", 6)
        if name is not None and coordinates is not None:
            given = None if covariance == (1.0, 0.0, 0.0, 1.0, 0.0, 1.0) else covariance
            found.append(GroundPoint(name, coordinates, given, element.line))
    return tuple(found)


def read_photo_marks(path: Path, faults: Faults) -> tuple[PhotoMark, ...]:
    """Read points measured in a photo (``MesIm-*.xml``); a unit matrix of covariances is MMVII's default."""
    marks = _element(path, "SetMesIm", faults)
    fields, found = XmlFields(faults), []
    photo = None if marks is None else fields.text(marks, "NameIm")
    for element in _measures(marks):
        name, pixel = fields.text(element, "Name"), fields.decimals(element, "Pt", 2)
        covariance = None if element.child("Sigma2") is None else fields.decimals(element, "Sigma2", 3)
        if photo is not None and name is not None and pixel is not None:
            found.append(PhotoMark(photo, name, pixel, _deviation(covariance), element.line))
    return tuple(found)


def _deviation(covariance: tuple[float, ...] | None) -> tuple[float, float] | None:
    if covariance is None or covariance == (1.0, 0.0, 1.0):
        return None
    x, _, y = covariance
    return (x**0.5, y**0.5) if x > 0 and y > 0 else None


def _measures(parent: XmlElement | None) -> list[XmlElement]:
    measures = None if parent is None else parent.child("Measures")
    return [] if measures is None else list(measures.all("el"))


def _element(path: Path, tag: str, faults: Faults) -> XmlElement | None:
    root = read_xml(path, faults)
    found = None if root is None else root.child(f"Data/{tag}")
    if root is not None and found is None:
        faults.complain(f"this is not a <{tag}> of MMVII; name another file", root.line)
    return found
