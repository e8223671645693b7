"""Details of photos around measured places: where the point was measured, and where the adjustment has it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from markupsafe import Markup

from orip.report.drawings.svg import drawing, element, number, text
from orip.report.pictures import Chip
from orip.report.report_input import CHIP_PIXELS

_TIMES = 2.0
_ARM, _GAP, _RADIUS = 14.0, 4.0, 6.0
_ROOM_FOR_WORDS = 30.0


def chip_drawings(chips: Sequence[Chip]) -> tuple[Markup, ...]:
    """Return a drawing of each chip: a cross at the measured place, a ring at the adjusted one."""
    return tuple(_drawing(chip) for chip in chips)


def _drawing(chip: Chip) -> Markup:
    side = CHIP_PIXELS * _TIMES
    off = float(np.hypot(*(chip.adjusted - chip.measured)))
    size = f"{off:.2f} px" if off < 10.0 else f"{off:.0f} px"
    tested = f"v {size}, w {chip.w:.1f}" if np.isfinite(chip.w) else f"v {size}"
    label = f"Point {chip.point} in photo {chip.photo}: {tested}"
    parts = [*_content(chip, side), text(0.0, side + 12.0, f"{chip.point} in {chip.photo}", class_="label")]
    return drawing(side, side + _ROOM_FOR_WORDS, label, [*parts, text(0.0, side + 26.0, tested)], "chip")


def _content(chip: Chip, side: float) -> Iterator[str]:
    yield element("image", href=chip.address, x=0, y=0, width=side, height=side, preserveAspectRatio="none")
    (x, y), (u, v) = (place * _TIMES for place in (chip.measured, chip.adjusted))
    arms = "".join(
        f"M{number(x + _GAP * dx)} {number(y + _GAP * dy)}l{number(_ARM * dx)} {number(_ARM * dy)}"
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    # each line twice: dark below light, so that it is seen on any ground
    for style in ("below", "measured"):
        yield element("path", d=arms, class_=style)
    u, v = (min(max(float(place), _RADIUS), side - _RADIUS) for place in (u, v))
    for style in ("below", "adjusted"):
        yield element("circle", cx=u, cy=v, r=_RADIUS, class_=style)
