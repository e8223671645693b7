"""Photos, the templates that they are printed on, and the tick marks of templates."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Struct

from orip.records.camera import Mark
from orip.records.fields import GROUND_UNIT, Field, Part

PHOTO_PARAMETERS = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
"""Exterior orientation in the order of every array that holds it."""

_ELEMENT_KEYS = tuple(
    Part(key=key, heading=key, units=(unit,), example=example)
    for key, unit, example in zip(
        PHOTO_PARAMETERS,
        (GROUND_UNIT, GROUND_UNIT, GROUND_UNIT, "degrees", "degrees", "degrees"),
        ("1250.0", "830.0", "410.0", "0.5", "-1.5", "90.0"),
        strict=True,
    )
)

Stage = Literal["UPPER", "LOWER"]


class Scan(Struct, frozen=True):
    """Scanned film: pixel size (mm, x and y), and where the pixel coordinates' origin is in the upper left pixel."""

    pixel: Annotated[
        tuple[float, float],
        Field(above=0, one_for_all=True, units=("mm",), example="0.0127", elements=("x", "y")),
    ]
    origin: Annotated[Literal["corner", "centre"], Field(example='"corner"')] = "corner"


class Photo(Struct, frozen=True):
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
    image : str or None
        Path of its image file, from the project folder.
    """

    name: Annotated[str, Field(example='"P101"')]
    camera: Annotated[str, Field(names_record=True, heading="Camera", example='"OLYMPUS"')]
    template: Annotated[str | None, Field(names_record=True, heading="Template", example='"T1"')] = None
    stage: Annotated[Stage | None, Field(example='"UPPER"')] = None
    orientation: Annotated[tuple[float | None, ...], Field(elements=PHOTO_PARAMETERS, parts=_ELEMENT_KEYS)] = (
        None,
    ) * 6
    constant: Annotated[tuple[str, ...], Field(heading="Constant", example='["X0", "Y0"]')] = ()
    scan: Annotated[Scan | None, Field(example="{ pixel = 0.0127 }")] = None
    image: Annotated[str | None, Field(text="line", example='"DSC_0102.JPG"', key_after="camera")] = None


class Temtick(Struct, frozen=True):
    """Given coordinates of the tick marks of a kind of template (mm)."""

    name: Annotated[str, Field(example='"GRID"')]
    ticks: Annotated[tuple[Mark, ...], Field(heading="Ticks", example='[{ name = "1", x = 10.0, y = 220.0 }]')] = ()


class Template(Struct, frozen=True):
    """A film sheet that carries photos: its tick marks, its stage plate, the photos on it."""

    name: Annotated[str, Field(example='"T1"')]
    temtick: Annotated[str, Field(names_record=True, heading="Temtick", example='"GRID"')]
    stage: Annotated[Stage | None, Field(heading="Stage", example='"UPPER"')] = None
    photos: Annotated[tuple[str, ...], Field(names_record=True, heading="Photos", example='["P101", "P102"]')] = ()
    scan: Annotated[Scan | None, Field(example="{ pixel = 0.0127 }")] = None
