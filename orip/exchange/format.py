"""What a format of another program's projects offers, how it is recognised, and what of a camera it lacks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.files.text.shown import Parsed
from orip.records.exchanged import PIXELS, ExchangedCamera, ExchangedProject, ImageAxes, Lens, PoseReading
from orip.structs import replace

Given = Literal["control points", "check points", "stations", "distances", "tie points", "measurements"]
"""What a project may have that a format may lack."""

Read = Callable[[Path, str], Parsed[ExchangedProject | None]]
"""From a file or folder, and its name for messages, to the project in it; None where there are complaints."""

Write = Callable[[ExchangedProject, Path | None], Mapping[str, bytes]]
"""From a project, and the file or folder that it was once imported from, to files by their names.

What the original has and the project has not stays as it is there.
"""


AddReferences = Callable[[ExchangedProject, Path, str, str], Parsed[ExchangedProject]]
"""From a project, a table of references, its name for messages and letters of its columns, to a project."""


class Conventions(Struct, frozen=True):
    """What the numbers of a format mean when it is written.

    Parameters
    ----------
    lens : Lens or None
        None: cameras and measurements are not written.
    is_cartesian : bool
        The format has a rectangular system: eastings, northings and heights of a map projection are taken to a local
        one.
    fisheye_lens : Lens or None
        Of fisheye cameras, if the format has any.
    terms, fisheye_terms : tuple of str, or None
        Parameters of these lenses that the format has a place for; None: all.
    counts_from_principal_point : bool
        Image coordinates have the principal point as their origin, which the format has no place for.
    is_drawn : bool
        What is written is drawn: photos have footprints.
    is_copied : function of a path, or None
        Tells whether a result is put into a copy of an original. None: every original is copied.
    has_terms_of_original : bool
        A copy has the ground frame of its original, and the cameras that have not changed.
    has_rigs : bool
        Rigs and their exposures have a place in its files.
    lacks : tuple of str
        What the files of a new project in the format have no place for, and what an export says is not written.
    """

    lens: Lens | None
    reading: PoseReading
    lens_axes: ImageAxes = PIXELS
    ray_axes: ImageAxes = PIXELS
    is_cartesian: bool = True
    fisheye_lens: Lens | None = None
    terms: tuple[str, ...] | None = None
    fisheye_terms: tuple[str, ...] | None = None
    counts_from_principal_point: bool = False
    is_drawn: bool = False
    is_copied: Callable[[Path], bool] | None = None
    has_terms_of_original: bool = False
    has_rigs: bool = False
    lacks: tuple[Given, ...] = ()


class Format(Struct, frozen=True):
    """A format.

    Parameters
    ----------
    name : str
        As it is written on the command line.
    title : str
        The program, and which files of it.
    recognises : function of a path
        Tells from names and first bytes whether a file or folder is probably of this format; False if it is absent.
    conventions : Conventions or None
        Those in which `write` takes a project.
    is_file : bool
        What is written is one file, and no folder.
    add_references : AddReferences or None
        Of formats that give positions of photos and control in a table of its own.
    require_way_back : function of a project and its original, or None
        Raises an InputError where it is known beforehand that a result cannot be put into a copy of the original.
    """

    name: str
    title: str
    read: Read | None = None
    recognises: Callable[[Path], bool] = lambda _: False
    write: Write | None = None
    conventions: Conventions | None = None
    is_file: bool = False
    add_references: AddReferences | None = None
    require_way_back: Callable[[ExchangedProject, Path], None] | None = None


def never(_original: Path) -> bool:
    """Return that a format is always written as a new project."""
    return False


OBSERVED: tuple[Given, ...] = ("stations", "distances")
WITHOUT_GROUND: tuple[Given, ...] = ("control points", "check points", *OBSERVED)
"""What most formats have no place for."""

PIXEL_MM = 0.01
"""Of the pixels that stand for millimetres."""

_SMALLEST_MM = 10.0


def with_assumed_frame(
    camera: ExchangedCamera, image: FloatArray, pixel_mm: float = PIXEL_MM
) -> tuple[ExchangedCamera, str]:
    """Return a camera whose frame holds all measurements (n, 2), millimetres from its centre, and a note on it."""
    reach = np.abs(image).max(axis=0) if len(image) else np.zeros(2)
    width, height = (max(_SMALLEST_MM, float(np.ceil(2.0 * side))) for side in np.minimum(reach, 1e4).tolist())
    found = replace(
        camera,
        columns=round(width / pixel_mm),
        rows=round(height / pixel_mm),
        sensor_mm=(width, height),
    )
    note = (
        f"The frame of camera {camera.name} is in no file: {width:.0f} x {height:.0f} mm hold all its measurements, "
        f"and pixels of {pixel_mm:g} mm stand for millimetres."
    )
    return found, note


_NOTHING = 1e-12


def require_without(camera: ExchangedCamera, terms: Sequence[str], format_title: str) -> None:
    """Check that a camera has none of some terms.

    Raises
    ------
    InputError
        If it has, as the camera that is written would be another one.
    """
    found = [term for term in terms if abs(camera.parameters.get(term, 0.0)) > _NOTHING]
    if found:
        message = (
            f"camera {camera.name}: {format_title} has no place for its terms {', '.join(found)} "
            "(B1, B2 and A9 of orip give such); adjust without them, or export another format"
        )
        raise InputError.single(message)
