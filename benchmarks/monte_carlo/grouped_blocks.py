"""Blocks with observations of every kind on the ground, clean or with an error common to one group.

Each block has fifteen aerial photos with observed projection centres, a few control and check points, and a scale bar
in several positions. All have the same weight in the result by and large, so that none alone fixes the ground system.
"""

from __future__ import annotations

from functools import cache
from typing import Literal

import numpy as np
from bundle.aerial_block import aerial_block
from monte_carlo.simulated_blocks import random_numbers, solved
from msgspec import Struct
from support.synthetic_block import SyntheticBlock

from orip.bundle.groups.verdict import GroupVerdict, group_verdict
from orip.bundle.solve import SolvedBlock
from orip.records.block import Block
from orip.records.control import ControlDistance, ControlElement, ControlPoint
from orip.structs import replace

Planted = Literal["none", "control", "element", "check", "distance"]

STATION_ERROR = 0.05
BAR_ERROR = 0.05
BIAS = 3.0
"""Planted, in a-priori errors of one observation."""

_BARS = 6
_AXES = {"control": "XYZ", "element": ("X0", "Y0", "Z0"), "check": "XYZ", "distance": ("XYZ",)}


class Grouped(Struct, frozen=True):
    """A block with its planted error: in which group and component, "none" in neither."""

    block: Block
    planted: Planted
    component: str


@cache
def exact_block(geometry: int) -> SyntheticBlock:
    return aerial_block(f"groups {geometry}", 8, start_down_weight=20, max_iterations=20)


def grouped_block(planted: Planted, run: int) -> Grouped:
    """Return a block with normal errors as large as its a-priori errors; ten geometries take turns."""
    made, random = exact_block(run % 10), random_numbers(f"groups {planted}", run)
    block, truth = made.block, made.points
    component = str(random.choice(list(_AXES[planted]))) if planted != "none" else ""
    sign = random.choice([-1.0, 1.0])

    def error(kind: Planted, of: str, sd: float) -> float:
        return sd * (random.normal() + (BIAS * sign if (kind, of) == (planted, component) else 0.0))

    sd = block.control_points[0].errors[0]
    places = list(range(len(truth)))
    control = [
        _known(block.point_names[at], truth[at], sd, 1.0, "control", error) for at in places[:: len(places) // 8]
    ]
    check = [_known(block.point_names[at], truth[at], sd, -1.0, "check", error) for at in places[2 :: len(places) // 8]]
    elements = tuple(
        ControlElement(photo.name, "PHOTO", axis, value + error("element", axis, STATION_ERROR), STATION_ERROR)
        for photo, centre in zip(block.photos, made.orientations[:, :3], strict=True)
        for axis, value in zip(("X0", "Y0", "Z0"), centre.tolist(), strict=True)
    )
    distances = tuple(
        ControlDistance(
            f"BAR{number}", block.point_names[at], block.point_names[at + 1], "XYZ",
            float(np.linalg.norm(truth[at + 1] - truth[at])) + error("distance", "XYZ", BAR_ERROR), BAR_ERROR,
        )
        for number, at in enumerate(places[1 : -1 : len(places) // _BARS])
    )  # fmt: skip
    points = block.photo_points
    noisy = replace(points, xy=points.xy + points.error * random.normal(size=points.xy.shape))
    given = replace(
        block, photo_points=noisy, control_points=(*control, *check), elements=elements, distances=distances
    )
    return Grouped(given, planted, component)


def verdict_of(block: Block) -> tuple[SolvedBlock, GroupVerdict]:
    found = solved(block)
    names = {point.name for point in block.control_points if point.kind == "check"}
    errors = np.concatenate([kind.rows.error for kind in found.problem.observations])
    return found, group_verdict(found, errors, names)


def _known(name: str, at: np.ndarray, sd: float, sign: float, kind: Planted, error) -> ControlPoint:
    x, y, z = (float(value) + error(kind, axis, sd) for axis, value in zip("XYZ", at, strict=True))
    return ControlPoint(name, (x, y, z), (sign * sd,) * 3)
