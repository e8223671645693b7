"""A session tests held control as if it were observed; what it shows is the solution in which it is held."""

from __future__ import annotations

import numpy as np
import pytest
from support.online_answers import last_answer

from orip.bundle.assemble import BlockInput, gather
from orip.bundle.points.starting import given_coordinates
from orip.bundle.solve import solve_block
from orip.bundle.state import BlockState
from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.replies import cameras_of, photos_of, points_of
from orip.online.simulation import simulated_session
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace

HUNDREDTH = 2e-4
"""Metres: less than a hundredth of the standard deviation of any point or centre of the block that is not held."""


def _inputs(inputs: BlockInput, errors: tuple[float, float, float], unknown: tuple[str, ...]) -> BlockInput:
    """Return a session whose control, off by 0.05 m, has other a-priori errors, and whose camera has unknowns."""
    points = tuple(replace(point, errors=errors) for point in inputs.control.points)
    cameras = {key: replace(camera, unknown=unknown) for key, camera in inputs.records.cameras.items()}
    return replace(
        inputs, control=replace(inputs.control, points=points), records=replace(inputs.records, cameras=cameras)
    )


def _solved(measuring: Measuring, inputs: BlockInput) -> tuple[list[str], tuple[str, ...], BlockState]:
    """Return photos, points and values of the adjustment of what is in, from the values of the session."""
    measured = measuring.block.measurements.observations
    observations = {record_key(measured.bundle): measured}
    block = gather(
        replace(inputs, measured=replace(inputs.measured, observations=observations)), measuring.block.ground
    )
    started, given = measuring.block.values.started(block), given_coordinates(block)
    # what is held is held where the adjustment starts
    started = replace(started, point_start=np.where(np.isfinite(given), given, started.point_start))
    solved = solve_block(started, lambda _: None, lambda: False)
    return [photo.name for photo in solved.block.photos], solved.block.point_names, solved.state


@pytest.mark.parametrize("errors", [(0.0, 0.0, 0.0), (0.05, 0.05, 0.0)])
@pytest.mark.parametrize("unknown", [(), ("C",)])
def test_what_is_shown_is_the_solution_with_the_control_held(
    errors: tuple[float, float, float], unknown: tuple[str, ...]
) -> None:
    session = simulated_session(2, 3, 0)
    inputs = _inputs(session.inputs, errors, unknown)
    measuring = Measuring(OnlineBlock(inputs))
    for one in session.measurements:
        last_answer(measuring, one)
    photos, points, state = _solved(measuring, inputs)
    shown = {one["photo"]: one for one in photos_of(measuring)}
    placed = {one["point"]: [one[axis] for axis in "XYZ"] for one in points_of(measuring)}
    assert not measuring.suspects
    assert len(photos) == 6
    for name, centre, angles in zip(photos, state.centres, state.angles(), strict=True):
        elements = np.array([shown[name][kind] for kind in PHOTO_PARAMETERS])
        assert np.abs(elements[:3] - centre).max() < HUNDREDTH
        # a ten-thousandth of a degree is 2.7 mm on the ground, a fortieth of what phi is good to
        assert np.abs(elements[3:] - np.degrees(angles)).max() < 1e-5
    for name, place in zip(points, state.points, strict=True):
        assert np.abs(np.array(placed[name]) - place).max() < HUNDREDTH
    assert cameras_of(measuring)[0]["C"] == pytest.approx(state.cameras[0, 0], abs=1e-5)


def test_a_wrong_held_point_is_tested_before_and_after_values_are_shown() -> None:
    """It would make what is measured near to it suspect in its place if showing values left the control held."""
    session = simulated_session(2, 3, 0)
    inputs = _inputs(session.inputs, (0.0, 0.0, 0.0), ())
    wrong = inputs.control.points[2]
    x, y, z = (value or 0.0 for value in wrong.coordinates)
    moved = replace(wrong, coordinates=(x + 5.0, y, z))
    points = tuple(moved if point is wrong else point for point in inputs.control.points)
    measuring = Measuring(OnlineBlock(replace(inputs, control=replace(inputs.control, points=points))))
    for number, one in enumerate(session.measurements):
        last_answer(measuring, one)
        if number % 20 == 0:
            photos_of(measuring)
    measuring.examine()
    assert [(key.kind, key.point) for key in measuring.suspects] == [("control", wrong.name)]
