"""The tables `[gnss]`, `[gnss_network]` and `[imu]` of orip.toml: what is computed from which files, and how."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Struct

from orip.records.fields import Field

_METRES: Final = ("m",)
_DEGREES: Final = ("degrees",)
_SECONDS: Final = ("s",)

Vector = tuple[float, float, float]
PositioningWay = Literal["kinematic", "epochs"]
ForceUnit = Literal["m/s2", "g"]
RateUnit = Literal["rad/s", "deg/s"]
TimeSystem = Literal["fitting", "gps", "week", "unix-gps", "unix-utc"]
UnitGrade = Literal["mems", "tactical", "navigation"]


class EventSettings(Struct, frozen=True):
    """When photos were taken, and which event is whose.

    Parameters
    ----------
    events : str
        File of the events; empty: none.
    photo_times : str
        Names and times of photos: a table, or the folder of the image files.
    photo_names : str
        Pattern of names with the number of the event.
    event_offset : float or None
        Event less photo time; None: found.
    """

    events: Annotated[str, Field(example='"flight_Timestamp.MRK"')] = ""
    photo_times: Annotated[str, Field(example='"photos"')] = ""
    photo_names: Annotated[str, Field(example='"DJI_{:04d}"')] = ""
    event_offset: Annotated[float | None, Field(units=_SECONDS, example="18.0")] = None


class GnssSettings(EventSettings, frozen=True, kw_only=True):
    """`[gnss]`: observations of a receiver that moved, and of one at a known place; see `orip gnss`.

    Parameters
    ----------
    rover, base : str
        Observations.
    way : {"kinematic", "epochs"}
    base_place : tuple of 3 float or None
        Geocentric coordinates of the base's mark; None: those of its header.
    rover_height, base_height : float or None
        Of the antennas above their marks; None: as the headers say.
    elevation : float
        Least one of satellites.
    antex : str
        Calibrations of antennas; empty: none are applied.
    rover_antenna, base_antenna : str
        Their types in it; empty: as the headers say.
    """

    rover: Annotated[str, Field(shortest=1, example='"flight.obs"')]
    base: Annotated[str, Field(shortest=1, example='"base.obs"')]
    orbits: Annotated[tuple[str, ...], Field(shortest=1, example='["flight.nav"]')]
    way: Annotated[PositioningWay, Field(example='"kinematic"')] = "kinematic"
    base_place: Annotated[
        Vector | None, Field(units=_METRES, example="[-3978242.4348, 3382841.1715, 3649902.7667]")
    ] = None
    rover_height: Annotated[float | None, Field(least=-100, most=100, units=_METRES, example="0.0")] = None
    base_height: Annotated[float | None, Field(least=-100, most=100, units=_METRES, example="1.52")] = None
    elevation: Annotated[float, Field(least=0, most=60, units=_DEGREES, example="15.0")] = 15.0
    systems: Annotated[str, Field(shortest=1, longest=5, example='"GREJC"')] = "GREJC"
    frequencies: Annotated[int, Field(least=1, most=3, example="2")] = 2
    antex: Annotated[str, Field(example='"igs20.atx"')] = ""
    rover_antenna: Annotated[str, Field(example='"TRM29659.00 NONE"')] = ""
    base_antenna: Annotated[str, Field(example='"TRM29659.00 NONE"')] = ""


class NetworkSettings(Struct, frozen=True, kw_only=True):
    """`[gnss_network]`: observations of receivers that stand, whose marks become control; see `orip gnss network`.

    Parameters
    ----------
    marks : tuple of str
        Observations, a file a mark.
    orbits : tuple of str
    hold : str
        Name of the mark that is held; empty: the first one, at the place in its header.
    hold_place : tuple of 3 float or None
        Its geocentric coordinates.
    elevation : float
        Least one of satellites.
    systems : str
    frequencies : int
    antex : str
        Calibrations of antennas; empty: none are applied.
    """

    marks: Annotated[tuple[str, ...], Field(shortest=2, example='["B1.obs", "B2.obs"]')]
    orbits: Annotated[tuple[str, ...], Field(shortest=1, example='["flight.nav"]')]
    hold: Annotated[str, Field(example='"B1"')] = ""
    hold_place: Annotated[
        Vector | None, Field(units=_METRES, example="[-3978242.4348, 3382841.1715, 3649902.7667]")
    ] = None
    elevation: Annotated[float, Field(least=0, most=60, units=_DEGREES, example="15.0")] = 15.0
    systems: Annotated[str, Field(shortest=1, longest=5, example='"GREJC"')] = "GREJC"
    frequencies: Annotated[int, Field(least=1, most=3, example="2")] = 2
    antex: Annotated[str, Field(example='"igs20.atx"')] = ""


class ImuSettings(EventSettings, frozen=True, kw_only=True):
    """`[imu]`: samples of an inertial unit; see `orip imu`.

    Parameters
    ----------
    positions : str
        A solution of RTKLIB; empty: that of `[gnss]`.
    columns : tuple of str
        Of the table; empty: time, three forces, three rates.
    mount : tuple of 3 float
        Roll, pitch and yaw of the unit on the body.
    time : str
        System of the times; "fitting": the one that fits.
    shift : float
        Added to the times.
    lever_arm : tuple of 3 float
        From the unit to the antenna: forward, right, down.
    grade : str
        Usual noise of a unit.
    noise : tuple of 6 float or None
        In place of it.
    as_given : bool
        The noise is not estimated.
    """

    samples: Annotated[str, Field(shortest=1, example='"imu.csv"')]
    positions: Annotated[str, Field(example='"flight.pos"')] = ""
    columns: Annotated[tuple[str, ...], Field(example='["time", "fx", "fy", "fz", "wx", "wy", "wz"]')] = ()
    force_unit: Annotated[ForceUnit, Field(example='"m/s2"')] = "m/s2"
    rate_unit: Annotated[RateUnit, Field(example='"rad/s"')] = "rad/s"
    mount: Annotated[Vector, Field(least=-360, most=360, units=_DEGREES, example="[180.0, 0.0, -90.0]")] = (
        0.0,
        0.0,
        0.0,
    )
    time: Annotated[TimeSystem, Field(example='"gps"')] = "fitting"
    shift: Annotated[float, Field(units=_SECONDS, example="0.0")] = 0.0
    lever_arm: Annotated[Vector, Field(least=-50, most=50, units=_METRES, example="[0.12, 0.0, -0.35]")] = (
        0.0,
        0.0,
        0.0,
    )
    grade: Annotated[UnitGrade, Field(example='"tactical"')] = "mems"
    noise: Annotated[
        tuple[float, float, float, float, float, float] | None,
        Field(above=0, example="[3e-5, 2e-4, 3e-8, 1e-6, 1e-5, 5e-3]"),
    ] = None
    as_given: Annotated[bool, Field(example="true")] = False
