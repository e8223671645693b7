"""Cameras: principal distance and point, distortion, fiducial marks or sensor; cameras that have the same lens."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Final, Literal

from msgspec import Struct

from orip.records.fields import Field, Part
from orip.records.names import record_key
from orip.structs import replace

CAMERA_PARAMETERS = ("C", "DX", "DY", "A1", "A3", "A5", "A7", "A9", "P1", "P2", "B1", "B2", "READOUT")
"""Parameters of the camera model, in the order of every array that holds them. C, DX, DY are millimetres."""

OWN_PARAMETERS = ("DX", "DY", "READOUT")
"""Those that do not depend on the lens: cameras with the same lens have principal points and readouts of their own."""

RADIAL_PARAMETERS = ("A1", "A3", "A5", "A7", "A9")
"""Those of the radial distortion, which a camera's record may also give as a curve or in the form of the ISP."""

RADIAL_PLACES = slice(CAMERA_PARAMETERS.index("A1"), CAMERA_PARAMETERS.index("A9") + 1)
"""Their places among the parameters of a camera."""

DISTORTION_PARAMETERS = CAMERA_PARAMETERS[3:12]
"""Coefficients of the distortion."""

READOUT = CAMERA_PARAMETERS.index("READOUT")
"""Place of the readout time: seconds from the first row or column to the last one, negative in the other order."""

CAMERA_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "C": "mm",
        "DX": "mm",
        "DY": "mm",
        "A1": "",
        "A3": "mm^-2",
        "A5": "mm^-4",
        "A7": "mm^-6",
        "A9": "mm^-8",
        "P1": "mm^-1",
        "P2": "mm^-1",
        "B1": "",
        "B2": "",
        "READOUT": "s",
    }
)
"""Unit of each camera parameter; empty for a pure number."""

DistortionArgument = Literal["ideal", "measured"]
Projection = Literal["perspective", "equidistant"]
ReadoutDirection = Literal["down", "up", "right", "left"]
AdditionalSet = Literal["EBNER", "GRUEN"]


ISP_PARAMETERS = ("R0", "A1", "A2", "A3")
"""Parameters of the distortion in the form of the ISP regulations."""

_DISTORTION_UNITS = ("", "1/mm^2", "1/mm^4", "1/mm^6", "1/mm^8", "1/mm", "1/mm", "", "")

_PARAMETER_KEYS = (
    Part(key="c", above=0, units=("mm",), heading="C (mm)", example="8.595"),
    Part(key="principal_point", size=2, units=("mm",), heading="DX, DY (mm)", example="[-0.1905, 0.9305]"),
    Part(
        key="distortion",
        size=9,
        names=DISTORTION_PARAMETERS,
        units=_DISTORTION_UNITS,
        heading="Distortion",
        example="{ A1 = 0.0, A3 = 1.0e-4 }",
    ),
    Part(key="readout", default=0.0, units=("s",), heading="Readout (s)", example="0.030"),
)


class Mark(Struct, frozen=True):
    """A fiducial mark, reseau cross, photo corner or tick mark with its given coordinates (mm)."""

    name: Annotated[str, Field(example='"1"')]
    x: Annotated[float, Field(example="-12.0", units=("mm",))]
    y: Annotated[float, Field(example="18.0", units=("mm",))]


class Sensor(Struct, frozen=True):
    """A digital frame: pixels and its size in millimetres; pixel coordinates count from the upper left outer corner."""

    columns: Annotated[int, Field(above=0, example="1280", units=("pixels",))]
    rows: Annotated[int, Field(above=0, example="1024", units=("pixels",))]
    width: Annotated[float, Field(above=0, example="8.245", units=("mm",))]
    height: Annotated[float, Field(above=0, example="6.6", units=("mm",))]

    @property
    def size(self) -> tuple[float, float]:
        """Return width and height."""
        return self.width, self.height


class Camera(Struct, frozen=True):
    """One camera record.

    Parameters
    ----------
    name : str
        Record name; case does not count.
    parameters : tuple of 13 floats
        Values in the order of `CAMERA_PARAMETERS`; millimetres for C, DX, DY, seconds for READOUT, powers of 1/mm
        otherwise.
    distortion_at : {"ideal", "measured"}
        Whether the polynomial's argument is the ideal or the measured photo coordinate.
    distortion_isp : tuple (R0, A1, A2, A3) or None
        The radial distortion in the form of the ISP regulations, if it was given so; `parameters` holds the polynomial,
        and P1, P2, B1, B2 in any case.
    distortion_curve : tuple of (radius, distortion) or None
        Points of the curve of the radial distortion (mm), if it was given so.
    frame : tuple (x, y) or None
        Size of the photo frame for multi-model driving, mm.
    fiducials : tuple of Mark
        Given photo coordinates; empty for a digital frame.
    sensor : Sensor or None
        Digital frame; excludes fiducials.
    unknown : tuple of str
        Names of the parameters that the adjustment estimates; the others are constant.
    additional_set : {"EBNER", "GRUEN"} or None
        Additional parameters as weighted unknowns.
    same_lens_as : str or None
        Camera whose principal distance and distortion this one has: both are adjusted together.
    projection : {"perspective", "equidistant"}
        What the ideal coordinates are; equidistant are those of fisheye lenses.
    readout_direction : {"down", "up", "right", "left"}
        In which rows, or columns of the sensor, are exposed one after the other.
    """

    name: Annotated[str, Field(example='"OLYMPUS"')]
    parameters: Annotated[tuple[float, ...], Field(elements=CAMERA_PARAMETERS, parts=_PARAMETER_KEYS)]
    distortion_at: Annotated[DistortionArgument, Field(example='"ideal"', key_after="distortion_curve")] = "ideal"
    distortion_isp: Annotated[
        tuple[float, float, float, float] | None,
        Field(
            names=ISP_PARAMETERS,
            units=("mm", "1/mm^2", "1/mm^4", "1/mm^6"),
            example="{ R0 = 10.0, A1 = 1.0e-4 }",
            column="isp",
            elements=ISP_PARAMETERS,
        ),
    ] = None
    distortion_curve: Annotated[
        tuple[tuple[float, float], ...] | None, Field(units=("mm",), example="[[0.0, 0.0], [5.0, 0.002]]")
    ] = None
    frame: Annotated[
        tuple[float, float] | None, Field(above=0, units=("mm",), example="[24.0, 36.0]", elements=("x", "y"))
    ] = None
    fiducials: Annotated[
        tuple[Mark, ...], Field(heading="Fiducials", example='[{ name = "1", x = -12.0, y = 18.0 }]')
    ] = ()
    sensor: Annotated[Sensor | None, Field(example="{ columns = 1280, rows = 1024, width = 8.245, height = 6.6 }")] = (
        None
    )
    unknown: Annotated[tuple[str, ...], Field(heading="Unknown", example='["C", "DX", "DY"]')] = ()
    additional_set: Annotated[
        AdditionalSet | None, Field(key="set", example='"EBNER"', column_after="distortion_at")
    ] = None
    same_lens_as: Annotated[
        str | None, Field(names_record=True, example='"OLYMPUS"', key_after="name", column_after="name")
    ] = None
    projection: Annotated[
        Projection, Field(example='"equidistant"', key_after="same_lens_as", column_after="distortion_at")
    ] = "perspective"
    readout_direction: Annotated[
        ReadoutDirection, Field(example='"right"', key_after="parameters", column_after="projection")
    ] = "down"

    @property
    def is_rolling(self) -> bool:
        """Return whether it has a readout time that is not zero, or unknown."""
        return self.parameters[READOUT] != 0.0 or "READOUT" in self.unknown


def without_radial_distortion(camera: Camera) -> Camera:
    """Return the camera without the radial terms of its polynomial."""
    pairs = zip(CAMERA_PARAMETERS, camera.parameters, strict=True)
    return replace(camera, parameters=tuple(0.0 if name in RADIAL_PARAMETERS else value for name, value in pairs))


# `same_lens_as` of a camera names the one whose lens it has. What the lens determines is given, adjusted and updated
# there.

LENS_PLACES = tuple(place for place, name in enumerate(CAMERA_PARAMETERS) if name not in OWN_PARAMETERS)
"""Places of the lens's parameters among those of a camera."""


def lens_key(camera: Camera) -> str:
    """Return the `record_key` of the camera that a camera's lens is given with."""
    return record_key(camera.same_lens_as or camera.name)


def first_of_lens(cameras: Sequence[Camera]) -> list[int]:
    """Return for each camera the place of the first one with the same lens."""
    first: dict[str, int] = {}
    return [first.setdefault(lens_key(camera), place) for place, camera in enumerate(cameras)]


def with_lens_of(camera: Camera, lens: Camera) -> Camera:
    """Return a camera with the principal distance and distortion of another one."""
    parameters, own = list(camera.parameters), set(camera.unknown) & set(OWN_PARAMETERS)
    for place in LENS_PLACES:
        parameters[place] = lens.parameters[place]
    unknown = own | (set(lens.unknown) - set(OWN_PARAMETERS))
    return replace(
        camera,
        parameters=tuple(parameters),
        distortion_at=lens.distortion_at,
        projection=lens.projection,
        distortion_isp=lens.distortion_isp,
        distortion_curve=lens.distortion_curve,
        unknown=tuple(name for name in CAMERA_PARAMETERS if name in unknown),
    )


def with_shared_lenses(cameras: Iterable[Camera]) -> tuple[Camera, ...]:
    """Return the cameras; those that name another one have its lens, or their own where that one is missing."""
    every = tuple(cameras)
    by_name = {record_key(camera.name): camera for camera in every}
    return tuple(
        with_lens_of(camera, by_name[lens_key(camera)])
        if camera.same_lens_as is not None and lens_key(camera) in by_name
        else camera
        for camera in every
    )


def without_lens(camera: Camera) -> Camera:
    """Return a camera as its record is written: without what its lens determines if it names another camera's lens."""
    own = tuple(name for name in camera.unknown if name in OWN_PARAMETERS)
    parameters = list(camera.parameters)
    for place in LENS_PLACES:
        parameters[place] = 0.0
    return replace(
        camera,
        parameters=tuple(parameters),
        distortion_at="ideal",
        projection="perspective",
        distortion_isp=None,
        distortion_curve=None,
        unknown=own,
    )
