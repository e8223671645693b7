"""Camera formulas of other programs: where a direction is imaged, and the polynomial that orip has for it.

Directions are tangents (x, y): to the right and along the y axis of the lens' axes, at the depth 1. Parameters are
those that `LENSES` lists, by name; those that are missing are 0.
"""

from __future__ import annotations
