"""How the antenna and the inertial system of exposure stations relate to the camera, and how their positions drift."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Final, Literal

from msgspec import Struct

from orip.records.project.fields import GROUND_UNIT, Field

LEVER_ARM: Final = ("LX", "LY", "LZ")
BORESIGHT: Final = ("BX", "BY", "BZ")
TIME_OFFSET: Final = "DT"
ANTENNA_PARAMETERS: Final = (*LEVER_ARM, *BORESIGHT, TIME_OFFSET)
"""Parameters of an antenna in the order of every array that holds them."""

BORESIGHT_PLACES: Final = slice(3, 6)
"""Places of the boresight among them."""

ANTENNA_KEYS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {"lever_arm": LEVER_ARM, "boresight": BORESIGHT, "time_offset": (TIME_OFFSET,)}
)
"""Keys of orip.toml that hold them."""

SHIFT: Final = ("SX", "SY", "SZ")
DRIFT: Final = ("VX", "VY", "VZ")
"""Parameters of a strip or session."""

ANTENNA_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys((*LEVER_ARM, *SHIFT), "{ground}")
    | dict.fromkeys(BORESIGHT, "degrees")
    | dict.fromkeys(DRIFT, "{ground}/s")
    | {TIME_OFFSET: "s"}
)
"""Unit of each parameter, with the ground unit still to be filled in."""

Extent = Literal["none", "session", "strip"]

_LENGTHS: Final = (GROUND_UNIT,)


class Antenna(Struct, frozen=True):
    """An antenna, and an inertial system if there is one, with the corrections that its stations need.

    With X0 the projection centre and R the rotation of a photo (photo to ground), t its time and m the mean time of its
    strip or session, position and attitude of its station are::

        X0 + R (LX, LY, LZ) + (SX, SY, SZ) + (t - m) (VX, VY, VZ) + DT (velocity)
        R B^T,   B = Rx(BX) Ry(BY) Rz(BZ)

    Parameters
    ----------
    name : str
        Record name; case does not count.
    cameras : tuple of str
        Cameras whose photos have their stations from it; empty: all.
    lever_arm : tuple of 3 float
        From the projection centre to the antenna, along the photo's x, y and z axes, ground unit.
    lever_arm_error : tuple of 3 float or None
        A-priori errors of the unknown ones; None: nothing is known of them.
    boresight : tuple of 3 float
        Rotation of the camera against the inertial system, degrees.
    boresight_error : tuple of 3 float or None
    time_offset : float
        Time by which the stations are late, seconds: they are where the antenna was so much later.
    time_offset_error : float or None
    unknown : tuple of str
        Names of `ANTENNA_PARAMETERS` that the adjustment estimates; the others are constant.
    shift : {"none", "session", "strip"}
        Whether all stations together, or those of each strip, have an unknown common error.
    shift_error : tuple of 3 float or None
        A-priori errors of zero shifts, ground unit; None: nothing is known of them.
    strips : tuple of str
        Those whose shifts and drifts are unknown; empty: all.
    drift : {"none", "session", "strip"}
        Whether the common error changes with time.
    drift_error : tuple of 3 float or None
        A-priori errors of zero drifts, ground unit a second.
    """

    name: Annotated[str, Field(example='"GNSS"')]
    cameras: Annotated[tuple[str, ...], Field(names_record=True, heading="Cameras", example='["P4RTK"]')] = ()
    lever_arm: Annotated[
        tuple[float, float, float],
        Field(units=_LENGTHS, heading="Lever arm", example="[0.02, -0.01, 0.18]", elements=LEVER_ARM),
    ] = (0.0, 0.0, 0.0)
    lever_arm_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=_LENGTHS, example="[0.01, 0.01, 0.02]", elements=LEVER_ARM),
    ] = None
    boresight: Annotated[
        tuple[float, float, float],
        Field(units=("degrees",), heading="Boresight", example="[0.2, -0.1, 0.0]", elements=BORESIGHT),
    ] = (0.0, 0.0, 0.0)
    boresight_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=("degrees",), example="[0.5, 0.5, 1.0]", elements=BORESIGHT),
    ] = None
    time_offset: Annotated[float, Field(units=("s",), example="0.0")] = 0.0
    time_offset_error: Annotated[float | None, Field(above=0, units=("s",), example="0.01")] = None
    unknown: Annotated[tuple[str, ...], Field(heading="Unknown", example='["LX", "LY", "LZ"]')] = ()
    shift: Annotated[Extent, Field(heading="Shift", example='"strip"')] = "none"
    shift_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=_LENGTHS, example="[1.0, 1.0, 1.0]", elements=SHIFT),
    ] = None
    strips: Annotated[tuple[str, ...], Field(example='["2"]')] = ()
    drift: Annotated[Extent, Field(heading="Drift", example='"none"')] = "none"
    drift_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=("ground unit/s",), example="[0.001, 0.001, 0.001]", elements=DRIFT),
    ] = None

    @property
    def values(self) -> tuple[float, ...]:
        """Return the values of `ANTENNA_PARAMETERS`, boresight in degrees."""
        return (*self.lever_arm, *self.boresight, self.time_offset)

    @property
    def errors(self) -> tuple[float | None, ...]:
        """Return the a-priori errors of `ANTENNA_PARAMETERS`; None where nothing is known of them."""
        none = (None, None, None)
        return (*(self.lever_arm_error or none), *(self.boresight_error or none), self.time_offset_error)
