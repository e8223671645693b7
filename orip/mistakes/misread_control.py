"""Control that fits a block only if read differently: what was probably mistaken, and what to do about it."""

from __future__ import annotations

from orip.mistakes.length_units import LENGTH_UNITS
from orip.records.results.preliminary import ControlReading

_EXCHANGE = "exchange the columns X and Y of the control file"
_ANY_REFLECTION = "X and Y of the control are exchanged (north, east in place of X = east, Y = north), or"
_CHANGE_TEXTS = {
    "exchanged": "when X and Y are exchanged: the control file probably has north, east in place of X = east, Y = "
    f"north; {_EXCHANGE}",
    "X": "when X has the opposite sign: X of the control seems to count to the west; reverse its sign",
    "Y": "when Y has the opposite sign: Y of the control seems to count to the south; reverse its sign",
    "Z": "when Z has the opposite sign: Z of the control seems to count downwards; reverse its sign",
    "photos": "when the photos are mirrored: their x seems to count to the left, as on film scanned from the back, or "
    "their y downwards, or x and y are exchanged; reverse it, or check the fiducial marks",
}
_EXCHANGED_OR_MIRRORED = (
    f"as a mirror image: {_ANY_REFLECTION} one of them has the opposite sign, or the photos are mirrored (x counted to "
    f"the left); the control alone cannot tell which. {_EXCHANGE[0].upper()}{_EXCHANGE[1:]} first"
)
_DOWNWARDS = (
    "when Z has the opposite sign: Z of the control seems to count downwards, or y of photos that look horizontally; "
    "reverse its sign"
)
_MIRROR_IMAGE = (
    f"as a mirror image: {_ANY_REFLECTION} one axis has the opposite sign, or the photos are mirrored (x counted to "
    "the left); check them in this order"
)


def misread_control(reading: ControlReading | None) -> tuple[str, ...]:
    """Return the sentence about control that fits if read differently; none if there is no such reading."""
    if reading is None:
        return ()
    if reading.reading == "mirror image":
        return (_fits(reading) + _reflection(reading),)
    if reading.reading == "unit of Z":
        unit, others = LENGTH_UNITS[reading.z_factor]
        text = f"when Z is multiplied by {reading.z_factor:.5g}: Z seems to be in {unit}, X and Y in {others}"
        return (f"{_fits(reading)}{text}; use one unit",)
    if reading.reading == "from below":
        return (_from_below(reading),)
    order = "X, Y" if reading.reading == "longitude, latitude" else "Y, X"
    text = (
        f"the control fits when {order} are longitude and latitude in degrees, but X, Y and Z have to be in one unit "
        "of length: convert them to projected coordinates (a national grid or UTM: easting, northing), and name the "
        "system as crs in [project] if the area is large"
    )
    return (text,)


def _fits(reading: ControlReading) -> str:
    return f"control fits within {reading.misfit:.2g} (as given it fits within {reading.misfit_as_given:.3g}) "


def _reflection(reading: ControlReading) -> str:
    """Return which change explains a mirror image, from known projection centres, else from the side of the cameras.

    An exchange of X and Y, or one of them reversed, leaves the cameras above the ground; Z reversed puts them below it.
    """
    if len(reading.changes) == 1:
        return _CHANGE_TEXTS[reading.changes[0]]
    if reading.side > 0.0:
        return _EXCHANGED_OR_MIRRORED
    return _DOWNWARDS if reading.side < 0.0 else _MIRROR_IMAGE


def _from_below(reading: ControlReading) -> str:
    points = "three control points" if reading.points == 3 else "control points that lie in a plane"
    return (
        f"{points} fit within {reading.misfit:.2g}, but with the cameras below them, looking up; {points} fit a mirror "
        f"image equally well. If the photos were taken from above, {_ANY_REFLECTION} one axis has the opposite sign, "
        f"or the photos are mirrored; {_EXCHANGE} first, or measure control points at other heights"
    )
