"""Sessions in which the control is measured late: what waited is oriented and tested as soon as it suffices."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest
from support.online_answers import last_answer

from orip.bundle.assemble import BlockInput
from orip.geometry.plane import IDENTITY
from orip.online.block.first_photos import THOROUGH
from orip.online.block.measurements import Measurement
from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.simulation import simulated_session
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.structs import replace


def _control_last(inputs: BlockInput, measured: tuple[Measurement, ...]) -> list[Measurement]:
    names = {point.name for point in inputs.control.points}
    return sorted(measured, key=lambda one: one[1] in names)


def _started_again(measuring: Measuring) -> Measuring:
    return Measuring(measuring.block.begun_again(measuring.excluded), THOROUGH)


def test_control_measured_last_orients_the_session_without_being_asked_for() -> None:
    session = simulated_session(2, 3, 1)
    measuring = Measuring(OnlineBlock(session.inputs))
    answers = [last_answer(measuring, one) for one in _control_last(session.inputs, session.measurements)]
    assert answers[0].state == "waiting"
    again = _started_again(measuring)
    assert measuring.block.values.orientations.keys() == again.block.values.orientations.keys()
    assert len(again.block.values.orientations) == 6
    assert measuring.block.values.points.keys() == again.block.values.points.keys()
    # what waited has been tested: the planted blunder is named
    blunder = session.blunders[0]
    assert (blunder.photo, blunder.point) in {(key.photo, key.point) for key in measuring.suspects}


@pytest.mark.long
def test_a_tie_that_makes_control_usable_orients_the_session_when_it_is_shown() -> None:
    """Control comes first; the tie that lets a model reach it is within a tenth of all from the last attempt."""
    session = simulated_session(2, 2, 0)
    inputs = replace(session.inputs, control=replace(session.inputs.control, points=session.inputs.control.points[-4:]))
    names = {point.name for point in inputs.control.points}
    measured = list(session.measurements)
    random.Random(1).shuffle(measured)
    measured.sort(key=lambda one: one[1] not in names)
    measuring = Measuring(OnlineBlock(inputs))
    for one in measured[:31]:
        last_answer(measuring, one)
    assert not measuring.block.values.orientations
    measuring.try_waiting()
    assert len(measuring.block.values.orientations) == 4
    assert measuring.block.values.orientations.keys() == _started_again(measuring).block.values.orientations.keys()


@pytest.fixture
def islands() -> tuple[BlockInput, list[Measurement], list[Measurement]]:
    """Return two blocks of four photos without a common point, each with control of its own."""
    session = simulated_session(2, 2, 0)
    inputs = session.inputs
    others = {
        record_key(f"Q{photo.name}"): Photo(f"Q{photo.name}", photo.camera) for photo in inputs.records.photos.values()
    }
    control = tuple(replace(point, name=f"9{point.name}") for point in inputs.control.points)
    both = replace(
        inputs,
        records=replace(inputs.records, photos={**inputs.records.photos, **others}),
        interior=replace(inputs.interior, to_photo={**inputs.interior.to_photo, **dict.fromkeys(others, IDENTITY)}),
        control=replace(inputs.control, points=(*inputs.control.points, *control)),
    )
    other = tuple((f"Q{photo}", f"9{point}", xy) for photo, point, xy in session.measurements)
    return both, list(session.measurements), _control_last(both, other)


def test_a_part_of_the_block_that_is_not_tied_to_the_rest_is_oriented_by_its_own_late_control(islands) -> None:
    inputs, first, second = islands
    measuring = Measuring(OnlineBlock(inputs))
    for one in first:
        last_answer(measuring, one)
    assert len(measuring.block.values.orientations) == 4
    for one in second:
        last_answer(measuring, one)
    assert len(_started_again(measuring).block.values.orientations) == 8
    assert len(measuring.block.values.orientations) == 8
    assert not measuring.waiting()


def test_nothing_is_tried_again_while_nothing_that_decides_has_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    session = simulated_session(2, 3, 0)
    names = {point.name for point in session.inputs.control.points}
    measuring = Measuring(OnlineBlock(session.inputs))
    tried: list[int] = []
    start = OnlineBlock.start

    def counted(block: OnlineBlock, first: object) -> None:
        tried.append(len(block.measurements))
        start(block, first)  # type: ignore[arg-type]

    monkeypatch.setattr(OnlineBlock, "start", counted)
    # so few that no two photos can be oriented to each other
    ties = set(sorted({point for _, point, _ in session.measurements} - names)[::2])
    for one in session.measurements:
        if one[1] in ties:
            last_answer(measuring, one)
    assert not measuring.block.values.orientations
    for _ in range(3):
        measuring.try_waiting()
    # a tenth more each time, and once more for what has been measured since
    assert tried[-1] == len(measuring.block.measurements)
    assert all(later >= int(earlier * 1.1) for earlier, later in pairwise(tried[:-1]))
    assert len(tried) < 30
