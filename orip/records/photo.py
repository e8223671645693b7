"""Photos, the templates that they are printed on, and the tick marks of templates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from orip.records.camera import Mark

PHOTO_PARAMETERS = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
"""Exterior orientation in the order of every array that holds it."""

Stage = Literal["UPPER", "LOWER"]


@dataclass(frozen=True, slots=True)
class Scan:
    """Scanned film: pixel size (mm, x and y), and where the pixel coordinates' origin is in the upper left pixel."""

    pixel: tuple[float, float]
    origin: Literal["corner", "centre"] = "corner"


@dataclass(frozen=True, slots=True)
class Photo:
    """One photo record.

    Parameters
    ----------
    name, camera : str
        Record names; case does not count.
    template : str or None
        Template that the photo is printed on.
    stage : {"UPPER", "LOWER"} or None
        Stage plate of a photo off a template.
    orientation : tuple of 6 (float or None)
        Preliminary values as in the files, ground unit and degrees, ordered as `PHOTO_PARAMETERS`; None: not known.
    constant : tuple of str
        Names of the orientation elements that the adjustment holds.
    scan : Scan or None
        The photo's measurements are scan pixels.
    """

    name: str
    camera: str
    template: str | None = None
    stage: Stage | None = None
    orientation: tuple[float | None, ...] = (None,) * 6
    constant: tuple[str, ...] = ()
    scan: Scan | None = None


@dataclass(frozen=True, slots=True)
class Temtick:
    """Given coordinates of the tick marks of a kind of template (mm)."""

    name: str
    ticks: tuple[Mark, ...]


@dataclass(frozen=True, slots=True)
class Template:
    """A film sheet that carries photos: its tick marks, its stage plate, the photos on it."""

    name: str
    temtick: str
    stage: Stage | None = None
    photos: tuple[str, ...] = ()
    scan: Scan | None = None
