"""XML of MicMac's first version: cameras (``AutoCal_*.xml``), orientations, points on the ground and in photos.

Pixels of a camera and coefficients of its distortion are those of the photo; the polynomial takes ideal pixels to
measured ones (``eConvApero_DistM2C``). The rotation's columns are the axes of the camera in the world, y down, z
forward. The pairs of an orientation (``Verif``) are pixels and points that the camera has to reproduce.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import XmlElement, XmlFields, plain, read_xml
from orip.files.text.shown import shown_token

_CONVENTION = "eConvApero_DistM2C"
_LONGEST_RADIAL = 5


class Calibration(Struct, frozen=True):
    """A camera; pixels.

    Parameters
    ----------
    principal_point, centre : tuple of 2 floats
        Principal point, and the centre of the distortion.
    size : tuple of 2 ints
        Columns and rows.
    radial : tuple of floats
        Coefficients of r^2, r^4, ... (1/px^2, 1/px^4, ...).
    decentring : tuple of 2 floats
        P1, P2 (1/px).
    affine : tuple of 2 floats
        b1, b2.
    normalised : bool
        Coefficients are those of coordinates divided by the focal length, as in MMVII.
    """

    principal_point: tuple[float, float]
    focal: float
    size: tuple[int, int]
    centre: tuple[float, float]
    radial: tuple[float, ...] = ()
    decentring: tuple[float, float] = (0.0, 0.0)
    affine: tuple[float, float] = (0.0, 0.0)
    normalised: bool = False


class Orientation(Struct, frozen=True):
    """The orientation of a photo.

    Parameters
    ----------
    photo, calibration : str
        Names of the photo and of the file of its camera.
    rotation : tuple of 9 floats
        Row by row; columns are the axes of the camera in the world.
    to_camera : tuple of 6 floats or None
        Pixels of the photo to those of the camera: origin, then what a column and what a row adds; None if equal.
    pairs : tuple of (pixel, point)
        What the camera has to reproduce.
    """

    photo: str
    calibration: str
    centre: tuple[float, ...]
    rotation: tuple[float, ...]
    to_camera: tuple[float, ...] | None = None
    pairs: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = ()


class GroundPoint(Struct, frozen=True):
    """A point on the ground; `covariance` xx xy xz yy yz zz in square units, None where only a default is given."""

    name: str
    coordinates: tuple[float, ...]
    covariance: tuple[float, ...] | None
    line: int


class PhotoMark(Struct, frozen=True):
    """A point measured in a photo; `deviation` in pixels, None where only a default is given."""

    photo: str
    point: str
    pixel: tuple[float, ...]
    deviation: tuple[float, float] | None
    line: int


def read_calibration(path: Path, faults: Faults) -> Calibration | None:
    """Read a camera; None, and complaints kept, if it cannot be represented."""
    camera = _element(path, "CalibrationInternConique", "a camera", faults)
    if camera is None:
        return None
    fields = XmlFields(faults)
    convention = fields.text(camera, "KnownConv")
    if convention is not None and convention != _CONVENTION:
        faults.complain(f"convention '{shown_token(convention)}' is not known; export with {_CONVENTION}", camera.line)
    point, size = fields.decimals(camera, "PP", 2), fields.decimals(camera, "SzIm", 2)
    focal = fields.decimal(camera, "F")
    distortion = _distortion(camera, fields)
    if (
        point is None
        or size is None
        or focal is None
        or distortion is None
        or not _sizes_are_sound(size, focal, camera, faults)
    ):
        return None
    radial, decentring, affine, centre = distortion
    columns_rows = (int(size[0]), int(size[1]))
    return Calibration(
        (point[0], point[1]), focal, columns_rows, centre or (point[0], point[1]), radial, decentring, affine
    )


def _sizes_are_sound(size: Sequence[float], focal: float, camera: XmlElement, faults: Faults) -> bool:
    if min(size) >= 1 and focal > 0:
        return True
    faults.complain("the size of the photo and the focal length have to be above 0; correct them", camera.line)
    return False


_Distortion = tuple[tuple[float, ...], tuple[float, float], tuple[float, float], tuple[float, float] | None]


def _distortion(camera: XmlElement, fields: XmlFields) -> _Distortion | None:
    models = [model for part in camera.all("CalibDistortion") for model in part.children]
    if len(models) > 1:
        fields.faults.complain("more than one distortion in sequence is not read; export one", models[1].line)
        return None
    if not models or models[0].tag == "ModNoDist":
        return (), (0.0, 0.0), (0.0, 0.0), None
    model = models[0]
    if model.tag == "ModRad":
        return _radial(model, model, fields)
    if model.tag == "ModPhgrStd":
        part = fields.required(model, "RadialePart")
        return None if part is None else _radial(part, model, fields)
    kind = model.child("TypeModele")
    name = model.tag if kind is None else f"{model.tag} {plain(kind.text)}"
    message = f"the distortion '{shown_token(name)}' cannot be converted; ModRad and ModPhgrStd (RadialStd, Fraser) can"
    fields.faults.complain(message, model.line)
    return None


def _radial(part: XmlElement, model: XmlElement, fields: XmlFields) -> _Distortion | None:
    centre = fields.decimals(part, "CDist", 2)
    found = [fields.faults.decimals(item.text, 1, "<CoeffDist>", item.line) for item in part.all("CoeffDist")]
    radial = tuple(values[0] for values in found if values is not None)
    while radial and radial[-1] == 0.0:
        radial = radial[:-1]
    if len(radial) > _LONGEST_RADIAL:
        fields.faults.complain(
            f"{len(radial)} radial coefficients cannot be converted, {_LONGEST_RADIAL} can", part.line
        )
        return None
    p1, p2, b1, b2 = (fields.optional(model, tag) for tag in ("P1", "P2", "b1", "b2"))
    return None if centre is None else (radial, (p1, p2), (b1, b2), (centre[0], centre[1]))


def read_orientation(path: Path, faults: Faults) -> Orientation | None:
    """Read the orientation of a photo, whose name is that of the file."""
    external = _element(path, "OrientationConique", "an orientation", faults)
    if external is None:
        return None
    fields = XmlFields(faults)
    centre = fields.decimals(external, "Externe/Centre", 3)
    lines = [fields.decimals(external, f"Externe/ParamRotation/CodageMatr/L{row}", 3) for row in (1, 2, 3)]
    calibration = fields.text(external, "FileInterne")
    if centre is None or calibration is None:
        return None
    rotation = tuple(value for line in lines if line is not None for value in line)
    if len(rotation) != 9:  # rows of three
        return None
    photo = path.name.removeprefix("Orientation-").removesuffix(".xml")
    return Orientation(photo, calibration, centre, rotation, _to_camera(external, fields), _pairs(external, fields))


def _to_camera(external: XmlElement, fields: XmlFields) -> tuple[float, ...] | None:
    if external.child("OrIntImaM2C") is None:
        return None
    parts = [fields.decimals(external, f"OrIntImaM2C/{tag}", 2) for tag in ("I00", "V10", "V01")]
    values = tuple(value for part in parts if part is not None for value in part)
    return None if values == (0.0, 0.0, 1.0, 0.0, 0.0, 1.0) or len(values) != 6 else values


def _pairs(external: XmlElement, fields: XmlFields) -> tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]:
    verification = external.child("Verif")
    found = []
    for pair in verification.all("Appuis") if verification is not None else ():
        pixel, point = fields.decimals(pair, "Im", 2), fields.decimals(pair, "Ter", 3)
        if pixel is not None and point is not None:
            found.append((pixel, point))
    return tuple(found)


def ground_points(root: XmlElement, faults: Faults) -> tuple[GroundPoint, ...]:
    """Return the points of a ``DicoAppuisFlottant``; uncertainties 1 1 1 are MicMac's default."""
    fields, found = XmlFields(faults), []
    for element in root.within("OneAppuisDAF"):
        name, coordinates = fields.text(element, "NamePt"), fields.decimals(element, "Pt", 3)
        given = None if element.child("Incertitude") is None else fields.decimals(element, "Incertitude", 3)
        if name is not None and coordinates is not None:
            found.append(GroundPoint(name, coordinates, _covariance(given), element.line))
    return tuple(found)


def _covariance(deviations: tuple[float, ...] | None) -> tuple[float, ...] | None:
    if deviations is None or deviations == (1.0, 1.0, 1.0) or min(deviations) <= 0:
        return None
    x, y, z = deviations
    return (x * x, 0.0, 0.0, y * y, 0.0, z * z)


def photo_marks(root: XmlElement, faults: Faults) -> tuple[PhotoMark, ...]:
    """Return the measurements of a ``SetOfMesureAppuisFlottants``."""
    fields, found = XmlFields(faults), []
    for photo in root.within("MesureAppuiFlottant1Im"):
        image = fields.text(photo, "NameIm")
        for element in photo.all("OneMesureAF1I"):
            name, pixel = fields.text(element, "NamePt"), fields.decimals(element, "PtIm", 2)
            if image is not None and name is not None and pixel is not None:
                found.append(PhotoMark(image, name, pixel, None, element.line))
    return tuple(found)


def _element(path: Path, tag: str, kind: str, faults: Faults) -> XmlElement | None:
    """Return the element of a tag in a file; None, and complaints kept, if there is none."""
    root = read_xml(path, faults)
    if root is None or root.tag == tag:
        return root
    found = next(root.within(tag), None)
    if found is None:
        message = f"this is not {kind} ({tag}) of MicMac, but <{shown_token(root.tag)}>; name another file"
        faults.complain(message, root.line)
    return found
