"""Sessions without control: a local system from the first two photos, and the ground as soon as control is there."""

from __future__ import annotations

import numpy as np
import pytest
from support.online_answers import last_answer

from orip.bundle.assemble import gather
from orip.bundle.solve import solve_block
from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.replies import photos_of, points_of, summary
from orip.online.simulation import simulated_session
from orip.records.measurement import PhotoObservations
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.solving.starting_values import explained_preliminary_values, started_block
from orip.structs import replace

_LINEARISED = 1e-6
"""Radians, and parts of the base: what `approach_solution` leaves is the square of 1e-4 and less."""


def _in_order(session) -> tuple[list, list]:
    names = {point.name for point in session.inputs.control.points}
    ties = [one for one in session.measurements if one[1] not in names]
    return ties, [one for one in session.measurements if one[1] in names]


def _figures(measuring: Measuring) -> np.ndarray:
    return np.array([[photo[key] for key in PHOTO_PARAMETERS] for photo in photos_of(measuring)])


@pytest.mark.parametrize("blunders", [0, 2])
def test_without_control_all_is_oriented_and_tested_and_control_takes_it_to_the_ground(blunders: int) -> None:
    session = simulated_session(2, 3, blunders)
    ties, control = _in_order(session)
    measuring = Measuring(OnlineBlock(session.inputs))
    answers = [last_answer(measuring, one) for one in ties]
    assert len(measuring.block.values.orientations) == 6
    assert answers[-1].text.endswith("local system, no control yet")
    assert summary(measuring).count("local system, no control yet") == 1
    wrong = {(one.photo, one.point) for one in session.blunders}
    measured = {(photo, point) for photo, point, _ in ties}
    assert {(key.photo, key.point) for key in measuring.suspects} == wrong & measured
    figures = _figures(measuring)
    assert not figures[0].any()
    assert np.linalg.norm(figures[1, :3]) == pytest.approx(1.0)
    again = Measuring(measuring.block.begun_again(measuring.excluded))
    assert again.suspects.keys() == measuring.suspects.keys()
    np.testing.assert_allclose(_figures(again), figures, atol=np.degrees(_LINEARISED))

    for one in control:
        last_answer(measuring, one)
    assert measuring.system == ""
    assert len(measuring.block.values.orientations) == 6
    assert {(key.photo, key.point) for key in measuring.suspects} == wrong
    assert "local" not in summary(measuring)


def test_values_on_the_ground_are_those_of_the_adjustment() -> None:
    session = simulated_session(2, 3, 0)
    ties, control = _in_order(session)
    measuring = Measuring(OnlineBlock(session.inputs))
    for one in [*ties, *control]:
        last_answer(measuring, one)
    observed: PhotoObservations = measuring.block.measurements.observations
    inputs = replace(
        session.inputs,
        measured=replace(session.inputs.measured, observations={record_key(observed.bundle): observed}),
    )
    block = gather(inputs)
    block = replace(block, definition=replace(block.definition, start_down_weight=99, max_iterations=30, enp_stop=8.0))
    solved = solve_block(started_block(block, explained_preliminary_values).block, lambda _: None, lambda: False)
    measuring.relinearise()
    points = {one["point"]: [one[axis] for axis in "XYZ"] for one in points_of(measuring)}
    shown = np.array([points[name] for name in solved.block.point_names])
    # a millionth of standard deviations of about a decimetre
    np.testing.assert_allclose(shown, solved.state.points, atol=1e-7)


def test_the_base_is_that_of_approximate_positions() -> None:
    session = simulated_session(2, 2, 0)
    photos = dict(session.inputs.records.photos)
    given = list(photos)[:2]
    photos[given[0]] = replace(photos[given[0]], orientation=(0.0, 0.0, 1500.0, None, None, None))
    photos[given[1]] = replace(photos[given[1]], orientation=(920.0, 0.0, 1500.0, None, None, None))
    inputs = replace(session.inputs, records=replace(session.inputs.records, photos=photos))
    measuring = Measuring(OnlineBlock(replace(inputs, control=replace(inputs.control, points=()))))
    for one in session.measurements:
        last_answer(measuring, one)
    figures = _figures(measuring)
    assert np.linalg.norm(figures[1, :3] - figures[0, :3]) == pytest.approx(920.0)
