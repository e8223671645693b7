"""Rigs: cameras on one body, how they are mounted, and the photos of each exposure; where they are in a block."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final, NamedTuple

from msgspec import Struct

from orip.records.fields import GROUND_UNIT, Field
from orip.records.names import record_key

OFFSET: Final = ("OX", "OY", "OZ")
MOUNTING_PARAMETERS: Final = (*OFFSET, "OMEGA", "PHI", "KAPPA")
"""Parameters of a mounting in the order of every array that holds them."""


class Mounting(Struct, frozen=True):
    """How a camera is mounted on its rig.

    With E the centre and R the rotation of an exposure (rig to ground), a photo of the camera has::

        X0 = E + R (OX, OY, OZ),   rotation = R M,   M = Rx(OMEGA) Ry(PHI) Rz(KAPPA)

    What is given without an error is constant, with one it is observed; what is not given is unknown, except that the
    first camera of a rig is in its origin and has its axes.

    Parameters
    ----------
    name : str
        The camera.
    offset : tuple of 3 float or None
        Projection centre along the axes of the rig, ground unit.
    offset_error : tuple of 3 float or None
        A-priori errors.
    rotation : tuple of 3 float or None
        From the photo's axes to those of the rig: omega, phi, kappa, degrees.
    """

    name: Annotated[str, Field(names_record=True, example='"NADIR"')]
    offset: Annotated[
        tuple[float, float, float] | None, Field(units=(GROUND_UNIT,), example="[0.3, 0.0, 0.05]", elements=OFFSET)
    ] = None
    offset_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=(GROUND_UNIT,), example="[0.002, 0.002, 0.002]", elements=OFFSET),
    ] = None
    rotation: Annotated[
        tuple[float, float, float] | None,
        Field(units=("degrees",), example="[0.0, 45.0, 0.0]", elements=MOUNTING_PARAMETERS[3:]),
    ] = None
    rotation_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=("degrees",), example="[0.1, 0.1, 0.1]", elements=MOUNTING_PARAMETERS[3:]),
    ] = None

    @property
    def errors(self) -> tuple[float | None, ...]:
        """Return the a-priori errors of `MOUNTING_PARAMETERS`, ground unit and degrees; None where there are none."""
        none = (None, None, None)
        return (*(self.offset_error or none), *(self.rotation_error or none))


_ORIGIN = (0.0, 0.0, 0.0)


class Rig(Struct, frozen=True):
    """A rig: its name and cameras, the first of which is the reference where nothing else is given."""

    name: Annotated[str, Field(example='"PENTA"')]
    cameras: Annotated[
        tuple[Mounting, ...], Field(key="camera", heading="Cameras", example='[{ name = "LEFT" }, { name = "RIGHT" }]')
    ]

    @property
    def mountings(self) -> tuple[Mounting, ...]:
        """Return the mountings, the first of which has values."""
        first, *others = self.cameras
        offset, rotation = first.offset or _ORIGIN, first.rotation or _ORIGIN
        reference = Mounting(first.name, offset, first.offset_error, rotation, first.rotation_error)
        return (reference, *others)


class RigExposure(Struct, frozen=True):
    """The photos that the cameras of a rig took at the same instant."""

    name: Annotated[str, Field(example='"E17"')]
    photos: Annotated[tuple[str, ...], Field(shortest=1, names_record=True, heading="Photos", example='["17L", "17R"]')]


class Rigs(Struct, frozen=True):
    """All rigs of a project, with their exposures."""

    rigs: tuple[Rig, ...] = ()
    exposures: tuple[RigExposure, ...] = ()


class MountedCamera(NamedTuple):
    """A camera on a rig."""

    rig: str
    mounting: Mounting

    @property
    def name(self) -> str:
        """Return what the mounting is called: ``NADIR on PENTA``."""
        return f"{self.mounting.name} on {self.rig}"


class RigPhoto(NamedTuple):
    """A photo of a rig, by its row among the photos, its exposure, and its camera's row among the mounted ones."""

    photo: int
    exposure: int
    mounted: int


class RigPlaces(NamedTuple):
    """Where the photos of a block are on rigs.

    Attributes
    ----------
    mounted : tuple of MountedCamera
        Those with photos in the block.
    exposures : tuple of str
        Names of those with photos in the block.
    """

    mounted: tuple[MountedCamera, ...]
    exposures: tuple[str, ...]
    rig_of_exposure: tuple[str, ...]
    photos: tuple[RigPhoto, ...]


def places_on_rigs(rigs: Rigs, photos: Sequence[tuple[str, str]], in_place: Sequence[tuple[str, str]]) -> RigPlaces:
    """Return where photos are on rigs.

    Parameters
    ----------
    photos : sequence of (str, str)
        Name and camera of each photo.
    in_place : sequence of (str, str)
        Cameras, and those that photos have in their place: these are mounted as the others.
    """
    every = [MountedCamera(rig.name, mounting) for rig in rigs.rigs for mounting in rig.mountings]
    row_of = {record_key(one.mounting.name): row for row, one in enumerate(every)}
    for name, other in in_place:
        if record_key(name) in row_of:
            row_of.setdefault(record_key(other), row_of[record_key(name)])
    photo_row = {record_key(name): row for row, (name, _) in enumerate(photos)} if rigs.exposures else {}
    found = [
        (row, exposure, mounted)
        for exposure in rigs.exposures
        for name in exposure.photos
        if (row := photo_row.get(record_key(name))) is not None
        and (mounted := row_of.get(record_key(photos[row][1]))) is not None
    ]
    used = sorted({mounted for _, _, mounted in found})
    exposures = list(dict.fromkeys(exposure.name for _, exposure, _ in found))
    exposure_row = {name: row for row, name in enumerate(exposures)}
    rig_of = {exposure.name: every[mounted].rig for _, exposure, mounted in found}
    return RigPlaces(
        tuple(every[row] for row in used),
        tuple(exposures),
        tuple(rig_of[name] for name in exposures),
        tuple(RigPhoto(row, exposure_row[exposure.name], used.index(mounted)) for row, exposure, mounted in found),
    )
