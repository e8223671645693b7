"""Units of length that are mistaken for each other."""

from __future__ import annotations

from orip.records.block import Block
from orip.records.project.camera import Camera
from orip.units import METRES_PER_FOOT, MILLIMETRES_PER_INCH

LENGTH_UNITS = {
    METRES_PER_FOOT: ("feet", "metres"),
    1.0 / METRES_PER_FOOT: ("metres", "feet"),
    1e-3: ("millimetres", "metres"),
    1e-2: ("centimetres", "metres"),
    1e2: ("metres", "centimetres"),
    1e3: ("metres", "millimetres"),
}
"""By the factor that lengths have to be multiplied by: their unit, and the unit of what they are compared with."""

FEET_AND_METRES = (METRES_PER_FOOT, 1.0 / METRES_PER_FOOT)
"""The factors of the two units that are used side by side."""


def control_unit_text(factor: float) -> str:
    """Return the message for control that fits the orientations of the photos when multiplied by a factor."""
    unit, other = LENGTH_UNITS[factor]
    return (
        f"the control fits the photos' orientations when it is multiplied by {factor:.5g}: it seems to be in {unit}, "
        f"and the orientations in {other}; use one unit"
    )


def millimetres_per_unit(camera: Camera) -> dict[str, float]:
    """Return the size (mm) of the units that principal distances are written in by mistake; pixels if it has any."""
    sizes = {"metres": 1e3, "inches": MILLIMETRES_PER_INCH}
    if camera.sensor is not None:
        sizes["pixels"] = camera.sensor.width / camera.sensor.columns
    return sizes


def smallest_pixel(block: Block) -> float | None:
    """Return the width (mm) of the smallest pixel of a block's cameras; None where none has a sensor."""
    widths = [camera.sensor.width / camera.sensor.columns for camera in block.cameras if camera.sensor is not None]
    return min(widths, default=None)
