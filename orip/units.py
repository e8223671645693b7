"""Units: one place for the factors and names that cross file borders.

Inside orip angles are radians, photo coordinates millimetres, ground coordinates the project's ground unit.
Files and people get degrees.
"""

from __future__ import annotations

import math

DEGREES_PER_RADIAN = 180.0 / math.pi
RADIANS_PER_DEGREE = math.pi / 180.0

DEGREES_PER_GON = 0.9
DEGREES_PER_UNIT = {"degrees": 1.0, "gon": DEGREES_PER_GON, "radians": DEGREES_PER_RADIAN}
"""Units in which angles may be given."""

METRES_PER_FOOT = 0.3048
MILLIMETRES_PER_INCH = 25.4

METRES_PER_GROUND_UNIT = {
    "m": 1.0,
    "km": 1000.0,
    "cm": 0.01,
    "mm": 0.001,
    "foot": METRES_PER_FOOT,
    "US survey foot": 1200.0 / 3937.0,
}
"""Ground units that orip knows the length of (metres each); any other label is printed as it is given."""
