"""Units of length that are taken for each other."""

from __future__ import annotations

from orip.units import METRES_PER_FOOT

LENGTH_UNITS = {
    METRES_PER_FOOT: ("feet", "metres"),
    1.0 / METRES_PER_FOOT: ("metres", "feet"),
    1e-3: ("millimetres", "metres"),
    1e-2: ("centimetres", "metres"),
    1e2: ("metres", "centimetres"),
    1e3: ("metres", "millimetres"),
}
"""By the factor that lengths have to be multiplied by: the unit that they are in, and the unit of what they are
compared with."""

FEET_AND_METRES = (METRES_PER_FOOT, 1.0 / METRES_PER_FOOT)
"""The factors of the two units that are in use side by side."""
