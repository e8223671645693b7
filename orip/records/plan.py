"""The table `[plan]` of orip.toml: what a flight or a network is to be, before it is carried out."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Struct

from orip.records.fields import GROUND_UNIT, Field

_LENGTH: Final = (GROUND_UNIT,)

PlanKind = Literal["flight", "rings"]
ObjectKind = Literal["", "control"]
Side = Literal["width", "height"]


class PlanSettings(Struct, frozen=True):
    """What is to be planned; see docs/reference/plan.md.

    Parameters
    ----------
    kind : {"flight", "rings"}
        Strips over an area or along a line, or stations on rings round an object.
    camera : str
        Record name; empty: the only one.
    area : str
        GeoJSON or KML file.
    corners : tuple of (X, Y)
        In place of a file, in the project's system.
    corridor : float
        Width to both sides together of a line, which `area` or `corners` is; 0: it is an area.
    pixel, height, sd : float or None
        Size of a pixel on the ground, height above it, or the standard deviation of the heights of points that is
        wanted (their median): one of the three, ground unit.
    forward, side : float
        Overlaps, percent.
    across : {"width", "height"}
        Side of the frame that lies across the flight.
    direction : float or None
        Grid azimuth of the strips, degrees; None: that with the shortest time.
    margin : float
        Ground beyond the border that is covered as the area is.
    crab : float
        Angle between photos and strips at which the overlaps still hold, degrees.
    cross_strips : int
        Across all others, evenly spaced, the first and the last at the ends.
    cross_height : float
        Their height above ground, divided by that of the others.
    cross_tilt : float
        Degrees by which the camera looks forward in them.
    ground : float
        Height of the terrain.
    terrain : str
        ``control`` (heights of the .PNT file), or a GeoTIFF in the project's system; empty: `ground`.
    follow : bool
        Each photo at its height above the ground below it; else all at one height, above the mean of the ground.
    interval, shutter, blur, speed, turn, battery : float
        Seconds from photo to photo at least; exposure time, seconds; pixels of blur at most; fastest ground speed,
        units a second; seconds of a turn; minutes of a battery.
    object : {"", "control"}
        The box of `centre` and `size`, or the points of the .PNT file.
    centre, size : tuples of 3 float
        Of the object's box.
    axis : tuple of 3 float
        Of the rings; elevations are above the plane at right angles to it.
    lowest : float or None
        Height below which there is no station.
    distance : float or None
        From the centre; None: the box fills the frame.
    elevations : tuple of float
        Of the rings above the horizontal plane through the centre, degrees.
    stations : int
        On each ring; with `rays` at least.
    rays, convergence : int, float
        So many photos at least show each point, from places whose rays enclose this angle with each other, degrees; 0:
        as many as there are.
    rolls : tuple of float
        Turns of the camera about its axis at each station, degrees.
    position_error, angle_error : tuples of 3 float, or None
        A-priori errors of positions, and of omega, phi and kappa (degrees); None: not observed.
    tie_points : int
        In a photo, on a regular grid.
    control_error : float
        Of planned control points.
    """

    kind: Annotated[PlanKind, Field(example='"flight"')] = "flight"
    camera: Annotated[str, Field(names_record=True, example='"P4RTK"')] = ""
    area: Annotated[str, Field(example='"area.geojson"')] = ""
    corners: Annotated[
        tuple[tuple[float, float], ...] | None,
        Field(units=_LENGTH, example="[[0.0, 0.0], [300.0, 0.0], [300.0, 200.0], [0.0, 200.0]]"),
    ] = None
    corridor: Annotated[float, Field(least=0, units=_LENGTH, example="80.0")] = 0.0
    pixel: Annotated[float | None, Field(above=0, units=_LENGTH, example="0.01")] = None
    height: Annotated[float | None, Field(above=0, units=_LENGTH, example="80.0")] = None
    sd: Annotated[float | None, Field(above=0, units=_LENGTH, example="0.01")] = None
    forward: Annotated[float, Field(least=0, most=99, units=("%",), example="80.0")] = 80.0
    side: Annotated[float, Field(least=0, most=99, units=("%",), example="60.0")] = 60.0
    across: Annotated[Side, Field(example='"width"')] = "width"
    direction: Annotated[float | None, Field(units=("degrees",), example="90.0")] = None
    margin: Annotated[float, Field(least=0, units=_LENGTH, example="20.0")] = 0.0
    crab: Annotated[float, Field(least=0, most=45, units=("degrees",), example="5.0")] = 0.0
    cross_strips: Annotated[int, Field(least=0, example="2")] = 0
    cross_height: Annotated[float, Field(above=0, example="1.2")] = 1.0
    cross_tilt: Annotated[float, Field(least=0, most=60, units=("degrees",), example="20.0")] = 0.0
    ground: Annotated[float, Field(units=_LENGTH, example="420.0")] = 0.0
    terrain: Annotated[str, Field(example='"control"')] = ""
    follow: Annotated[bool, Field(example="true")] = False
    interval: Annotated[float, Field(least=0, units=("s",), example="2.0")] = 0.0
    shutter: Annotated[float, Field(least=0, units=("s",), example="0.001")] = 0.001
    blur: Annotated[float, Field(above=0, units=("pixels",), example="0.5")] = 0.5
    speed: Annotated[float, Field(above=0, units=("ground unit/s",), example="8.0")] = 10.0
    turn: Annotated[float, Field(least=0, units=("s",), example="8.0")] = 8.0
    battery: Annotated[float, Field(above=0, units=("minutes",), example="20.0")] = 20.0
    object: Annotated[ObjectKind, Field(example='"control"')] = ""
    centre: Annotated[tuple[float, float, float], Field(units=_LENGTH, example="[0.0, 0.0, 0.0]")] = (0.0, 0.0, 0.0)
    size: Annotated[tuple[float, float, float], Field(above=0, units=_LENGTH, example="[1.0, 1.0, 0.5]")] = (
        1.0, 1.0, 1.0,
    )  # fmt: skip
    axis: Annotated[tuple[float, float, float], Field(example="[0.0, -1.0, 0.0]")] = (0.0, 0.0, 1.0)
    lowest: Annotated[float | None, Field(units=_LENGTH, example="0.0")] = None
    distance: Annotated[float | None, Field(above=0, units=_LENGTH, example="3.0")] = None
    elevations: Annotated[tuple[float, ...], Field(units=("degrees",), example="[15.0, 50.0]")] = (45.0,)
    stations: Annotated[int, Field(least=1, example="8")] = 8
    rays: Annotated[int, Field(least=0, most=50, example="6")] = 0
    convergence: Annotated[float, Field(above=0, most=80, units=("degrees",), example="15.0")] = 15.0
    rolls: Annotated[tuple[float, ...], Field(units=("degrees",), example="[0.0, 90.0]")] = (0.0, 90.0)
    position_error: Annotated[
        tuple[float, float, float] | None, Field(above=0, units=_LENGTH, example="[0.015, 0.015, 0.025]")
    ] = None
    angle_error: Annotated[
        tuple[float, float, float] | None, Field(above=0, units=("degrees",), example="[0.1, 0.1, 0.2]")
    ] = None
    tie_points: Annotated[int, Field(least=6, most=10000, example="100")] = 100
    control_error: Annotated[float, Field(above=0, units=_LENGTH, example="0.01")] = 0.01
