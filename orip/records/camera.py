"""Cameras: principal distance, principal point, distortion, fiducial marks or sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

CAMERA_PARAMETERS = ("C", "DX", "DY", "A1", "A3", "A5", "A7", "P1", "P2", "B1", "B2")
"""Parameters of the camera model, in the order of every array that holds them. C, DX, DY are millimetres."""

CAMERA_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "C": "mm",
        "DX": "mm",
        "DY": "mm",
        "A1": "",
        "A3": "mm^-2",
        "A5": "mm^-4",
        "A7": "mm^-6",
        "P1": "mm^-1",
        "P2": "mm^-1",
        "B1": "",
        "B2": "",
    }
)
"""Unit of each camera parameter; empty for a pure number."""

DistortionArgument = Literal["ideal", "measured"]
AdditionalSet = Literal["EBNER", "GRUEN"]


@dataclass(frozen=True, slots=True)
class Mark:
    """A fiducial mark, reseau cross, photo corner or tick mark with its given coordinates (mm)."""

    name: str
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class Sensor:
    """A digital frame: pixels and its size in millimetres; pixel coordinates count from the upper left outer corner."""

    columns: int
    rows: int
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Camera:
    """One camera record.

    Parameters
    ----------
    name : str
        Record name; case does not count.
    parameters : tuple of 11 floats
        Values in the order of `CAMERA_PARAMETERS`; millimetres for C, DX, DY, powers of 1/mm otherwise.
    distortion_at : {"ideal", "measured"}
        Whether the polynomial's argument is the ideal or the measured photo coordinate.
    distortion_isp : tuple (R0, A1, A2, A3) or None
        The distortion in the form of the ISP regulations, if it was given so; `parameters` holds the polynomial.
    distortion_curve : tuple of (radius, distortion) or None
        Points of the distortion curve (mm), if it was given so.
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
    """

    name: str
    parameters: tuple[float, ...]
    distortion_at: DistortionArgument = "ideal"
    distortion_isp: tuple[float, float, float, float] | None = None
    distortion_curve: tuple[tuple[float, float], ...] | None = None
    frame: tuple[float, float] | None = None
    fiducials: tuple[Mark, ...] = ()
    sensor: Sensor | None = None
    unknown: tuple[str, ...] = ()
    additional_set: AdditionalSet | None = None
