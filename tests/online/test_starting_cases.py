"""The four ways in which a session may begin: what is known of the ground and of the photos before it.

They are those of Kersten, Holm and Gruen 1992: orientations alone, control alone, both, and nothing at all.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.online_answers import last_answer

from orip.bundle.assemble import BlockInput
from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.simulation import SimulatedSession, simulated_session
from orip.records.control import Control, ControlElement
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace

CENTRE_ERROR, ANGLE_ERROR = 0.05, 0.001
"""Metres and degrees."""


@pytest.fixture(scope="module")
def normal() -> tuple[SimulatedSession, Measuring]:
    """Return a session with control and unknown orientations, played."""
    session = simulated_session(2, 2, 0)
    return session, _played(session, session.inputs)


def _played(session: SimulatedSession, inputs: BlockInput) -> Measuring:
    measuring = Measuring(OnlineBlock(inputs))
    for measurement in session.measurements:
        last_answer(measuring, measurement)
    # values may be off their solution by a thousandth of the distance
    measuring.relinearise()
    return measuring


def _orientations(measuring: Measuring) -> Control:
    """Return the orientations of a session as observed elements."""
    elements = []
    for photo, values in measuring.block.values.orientations.items():
        for place, kind in enumerate(PHOTO_PARAMETERS):
            value = float(values[place]) if place < 3 else float(np.degrees(values[place]))
            elements.append(ControlElement(photo, "PHOTO", kind, value, CENTRE_ERROR if place < 3 else ANGLE_ERROR))
    return Control((), tuple(elements))


def _assert_complete(measuring: Measuring, like: Measuring) -> None:
    """Assert that all photos and points have values, near those of a session with control."""
    measuring.relinearise()
    assert not measuring.suspects
    assert measuring.block.values.orientations.keys() == like.block.values.orientations.keys()
    assert measuring.block.values.points.keys() == like.block.values.points.keys()
    # a photo point is good to 0.05 m on the ground, a height of two rays at the edge of the block to several times that
    for name, place in like.block.values.points.items():
        assert np.linalg.norm(measuring.block.values.points[name] - place) < 0.5


def test_with_control_photos_wait_for_known_points(normal) -> None:
    session, measuring = normal
    assert not measuring.suspects
    assert len(measuring.block.values.orientations) == 4
    assert {point for _, point, _ in session.measurements} == set(measuring.block.values.points)


def test_with_orientations_alone_points_are_intersected_by_their_first_two_rays(normal) -> None:
    session, like = normal
    measuring = Measuring(OnlineBlock(replace(session.inputs, control=_orientations(like))))
    rays: dict[str, int] = {}
    for measurement in session.measurements:
        answer = last_answer(measuring, measurement)
        rays[answer.point] = rays.get(answer.point, 0) + 1
        assert (answer.state == "waiting") == (rays[answer.point] == 1)
    _assert_complete(measuring, like)


def test_with_orientations_and_control_nothing_waits_that_is_known(normal) -> None:
    session, like = normal
    control = replace(_orientations(like), points=session.inputs.control.points)
    measuring = Measuring(OnlineBlock(replace(session.inputs, control=control)))
    known = {point.name for point in control.points}
    for measurement in session.measurements:
        answer = last_answer(measuring, measurement)
        assert answer.state != "waiting" or answer.point not in known
    _assert_complete(measuring, like)


def test_with_nothing_the_block_lies_in_a_system_of_its_own(normal) -> None:
    session, like = normal
    inputs = replace(session.inputs, control=Control(()), definition=replace(session.inputs.definition, datum="free"))
    measuring = _played(session, inputs)
    assert not measuring.suspects
    assert measuring.block.values.orientations.keys() == like.block.values.orientations.keys()
    names = list(like.block.values.points)
    own, ground = (np.array([one.block.values.points[name] for name in names]) for one in (measuring, like))
    # the same form: a similarity takes one to the other
    own, ground = own - own.mean(axis=0), ground - ground.mean(axis=0)
    left, _, right = np.linalg.svd(own.T @ ground)
    rotation = (left * [1.0, 1.0, np.linalg.det(left @ right)]) @ right
    moved = own @ rotation
    scale = float(np.sum(moved * ground) / np.sum(moved**2))
    assert np.abs(scale * moved - ground).max() < 0.5
