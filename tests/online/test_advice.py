"""What to measure next: the gain is that of the determinant, and places are where the points are."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
from support.online_answers import last_answer

from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.sequential.observation_rows import ObservationKey
from orip.online.simulation import SimulatedSession, simulated_session


def _log_determinant(measuring: Measuring) -> float:
    """Return the binary logarithm of the determinant of the normal equations, from a dense design matrix."""
    equations = measuring.block.equations
    size = equations.triangle.size
    points = {rows.point: None for rows in equations.included.values() if rows.point}
    places = {name: size + 3 * place for place, name in enumerate(points)}
    blocks = []
    for rows in equations.included.values():
        part = np.zeros((len(rows.right), size + 3 * len(places)))
        part[:, rows.columns] = rows.by_reduced
        if rows.point:
            part[:, places[rows.point] : places[rows.point] + 3] = rows.by_point
        blocks.append(part)
    design = np.vstack(blocks)
    return float(np.linalg.slogdet(design.T @ design)[1] / np.log(2.0))


@pytest.fixture(scope="module")
def played() -> tuple[SimulatedSession, Measuring, list[tuple[str, str, tuple[float, float]]]]:
    """Return a session in which the last photo lacks points that two others show."""
    session = simulated_session(2, 3, 0)
    last = session.measurements[-1][0]
    measuring, kept = Measuring(OnlineBlock(session.inputs)), []
    shown: dict[str, int] = {}
    for photo, point, xy in session.measurements:
        shown[point] = shown.get(point, 0) + 1
        if photo == last and shown[point] >= 3 and len(kept) < 3:
            kept.append((photo, point, xy))
        else:
            last_answer(measuring, (photo, point, xy))
    return session, measuring, kept


def test_gain_is_half_the_logarithm_of_the_determinant(played) -> None:
    _, measuring, kept = played[0], deepcopy(played[1]), played[2]
    advised = {one.point: one for one in measuring.next([kept[0][0]], 50)}
    photo, point, _ = kept[0]
    candidate = advised[point]
    before = _log_determinant(measuring)
    measuring.block.measurements.put((photo, point, candidate.xy))
    key = ObservationKey("photo", photo, point)
    # equations of the same place that the candidate was judged by
    measuring.block.equations.include(key, measuring.block.rows([(photo, point)])[key])
    assert 0.5 * (_log_determinant(measuring) - before) == pytest.approx(candidate.gain, rel=1e-6)


def test_points_are_where_they_are_expected(played) -> None:
    _, measuring, kept = played
    advised = {one.point: one for one in measuring.next([kept[0][0]], 50)}
    for _, point, xy in kept:
        candidate = advised[point]
        assert candidate.ellipse is not None
        # prediction and measurement: 0.005 mm each way, four standard deviations
        spread = np.hypot(candidate.ellipse[0], 0.005)
        assert np.hypot(*np.subtract(candidate.xy, xy)) < 4.0 * spread


def test_the_most_profitable_comes_first_and_each_is_missing(played) -> None:
    _, measuring, _ = played
    advised = measuring.next(measuring.block.measurements.photos, 20)
    gains = [one.gain or 0.0 for one in advised]
    assert all(one.gain is None or one.gain >= 0.05 for one in advised), "0.0 bit is not worth a line"
    assert gains == sorted(gains, reverse=True)
    assert all(measuring.block.measurements.at(one.photo, one.point) is None for one in advised)


def test_a_photo_that_waits_is_told_where_known_points_are(played) -> None:
    session = played[0]
    measuring = Measuring(OnlineBlock(session.inputs))
    last = session.measurements[-1][0]
    there = {point: xy for photo, point, xy in session.measurements if photo == last}
    answer = None
    for photo, point, xy in session.measurements:
        if photo == last and point not in list(there)[:3]:
            continue
        answer = last_answer(measuring, (photo, point, xy))
    assert answer is not None
    assert answer.state == "waiting"
    assert answer.next
    for candidate in answer.next:
        # by a plane similarity of photos that are tilted by degrees over 60 m of relief: a few millimetres of 230
        assert np.hypot(*np.subtract(candidate.xy, there[candidate.point])) < 15.0
