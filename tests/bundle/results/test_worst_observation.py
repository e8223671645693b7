"""The first sentence names the observation that fits worst where it is no photo point."""

from __future__ import annotations

from support.synthetic_block import synthetic_block

from orip.records.control import ControlElement
from orip.solving.solve import solve
from orip.structs import replace

NOISE_MM = 0.005


def test_an_observed_coordinate_that_is_wrong_is_named() -> None:
    made = synthetic_block("convergent", "worst", noise_mm=NOISE_MM, precision_mm=NOISE_MM)
    control = {point.name for point in made.block.control_points}
    free = [row for row, name in enumerate(made.block.point_names) if name not in control][:12]
    elements = tuple(
        ControlElement(
            made.block.point_names[row], "POINT", "Z", float(made.points[row, 2]) + 0.1 * (row == free[3]), 0.001
        )
        for row in free
    )
    block = replace(made.block, photo_orientation=made.orientations, point_start=made.points, elements=elements)
    solution, _ = solve(block)
    assert solution.status == "doubtful"
    assert f"observations do not fit, worst of all Z of point {made.block.point_names[free[3]]}" in solution.verdict
