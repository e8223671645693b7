"""Marks of rendered boards against their true places: how far off, and whether their own errors say so."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from pictures.rendered import Camera, looking_at, photograph_of
from support.long_cases import every

from orip.arrays import FloatArray
from orip.errors import OripError
from orip.pictures.targets.boards import Board, board_points, check_board
from orip.pictures.targets.found_boards import find_board, find_tags
from orip.pictures.targets.marks import FoundTargets

CAMERA = Camera()
CHARUCO = Board("charuco", 9, 6, 24.0, 18.0, "5X5_100")
CHESS = Board("chess", 9, 6, 24.0)
CIRCLES = Board("circles", 6, 9, 15.0, 8.0)
TAGS = Board("tags", 6, 4, 36.0, 26.0, "APRILTAG_36H11")
TURNED = (-25.0, -30.0, 190.0)


def differences(board: Board, found: FoundTargets, station: object) -> tuple[FloatArray, FloatArray]:
    """Return measured less true places and standard deviations, pixels (n, 2)."""
    assert not found.fault
    points = board_points(board)
    true = CAMERA.project(np.array([[*points[mark.name], 0.0] for mark in found.marks]), station)  # type: ignore[arg-type]
    measured = np.array([[mark.column, mark.row] for mark in found.marks])
    return measured - true, np.array([mark.deviation for mark in found.marks])


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(
    ("board", "limit", "highest"),
    [(CHARUCO, 0.02, 1.6), (CHESS, 0.02, 1.6), (CIRCLES, 0.02, 2.5), (TAGS, 0.05, 3.0)],
    ids=lambda value: value.kind if isinstance(value, Board) else "",
)
def test_marks_are_where_they_should_be(board: Board, limit: float, highest: float) -> None:
    station = looking_at(board, TURNED, 300.0)
    found = find_board(photograph_of(board, CAMERA, station), board)
    off, deviations = differences(board, found, station)
    assert len(found.marks) == len(board_points(board))
    assert rms(off) < limit
    assert 0.7 < rms(off / deviations) < highest


def test_more_blur_and_noise_show_in_the_errors() -> None:
    station = looking_at(CHESS, TURNED, 300.0)
    sharp = find_board(photograph_of(CHESS, CAMERA, station), CHESS)
    dull = find_board(photograph_of(CHESS, CAMERA, station, blur=1.4, noise=6.0), CHESS)
    off, deviations = differences(CHESS, dull, station)
    assert rms(off) < 0.07
    assert 0.7 < rms(off / deviations) < 1.6
    assert rms(deviations) > 2.5 * rms(differences(CHESS, sharp, station)[1])


@pytest.mark.parametrize("kappa", every(2, [180.0, 0.0, 90.0, 270.0]))
def test_half_turns_do_not_exchange_points(kappa: float) -> None:
    station = looking_at(CHESS, (10.0, 15.0, kappa), 330.0)
    off, _ = differences(CHESS, find_board(photograph_of(CHESS, CAMERA, station), CHESS), station)
    assert np.abs(off).max() < 0.2


def test_centres_of_large_circles_need_the_correction_of_eccentricity() -> None:
    board = Board("circles", 6, 9, 15.0, 15.0)
    station = looking_at(board, TURNED, 300.0)
    found = find_board(photograph_of(board, CAMERA, station), board)
    off, _ = differences(board, found, station)
    assert rms(off) < 0.03
    # without radius the same circles are off by what projective geometry says
    tiny = Board("circles", 6, 9, 15.0, 0.001)
    off_centres, _ = differences(board, find_board(photograph_of(board, CAMERA, station), tiny), station)
    assert rms(off_centres) > 0.2


def test_a_board_that_is_partly_outside_is_measured_where_it_is_seen() -> None:
    station = looking_at(CHARUCO, (30.0, 10.0, 80.0), 220.0)
    found = find_board(photograph_of(CHARUCO, CAMERA, station), CHARUCO)
    off, _ = differences(CHARUCO, found, station)
    assert 12 < len(found.marks) < 40
    assert np.abs(off).max() < 0.2
    named = {mark.name for mark in found.marks} | {item.name for item in found.rejected}
    assert named == set(board_points(CHARUCO))
    assert all(item.reason for item in found.rejected)


def test_two_boards_of_the_same_kind_are_refused_and_others_are_not() -> None:
    one = photograph_of(CHARUCO, CAMERA, looking_at(CHARUCO, (0.0, 0.0, 3.0), 600.0))
    both = np.vstack([one, np.fliplr(np.flipud(one))])
    assert "twice" in find_board(both, CHARUCO).fault
    other = Board("charuco", 9, 6, 24.0, 18.0, "5X5_100", first_tag=40, prefix="B")
    two = np.vstack([one, photograph_of(other, CAMERA, looking_at(other, (0.0, 0.0, 3.0), 600.0))])
    first, second = find_board(two, CHARUCO), find_board(two, other)
    assert len(first.marks) == len(second.marks) == 40
    rows = [[mark.row for mark in found.marks] for found in (first, second)]
    assert max(rows[0]) < CAMERA.rows < min(rows[1])
    assert all(mark.name.startswith("BR") for mark in second.marks)


def test_single_tags_are_named_and_repeated_ones_are_not_measured() -> None:
    grey = photograph_of(TAGS, CAMERA, looking_at(TAGS, (0.0, 0.0, 3.0), 400.0))
    found = find_tags(grey, "APRILTAG_36H11", "A")
    assert {mark.name for mark in found.marks} == {"A" + name for name in board_points(TAGS)}
    twice = find_tags(np.hstack([grey, grey]), "APRILTAG_36H11")
    assert not twice.marks
    assert {item.reason for item in twice.rejected} == {"this tag is in the picture twice"}


# the mirror image of the others is the board turned by half a turn
@pytest.mark.parametrize(
    ("board", "what"),
    [(CHARUCO, "noise"), (CHESS, "nothing"), (CIRCLES, "noise"), (TAGS, "nothing"), (CHARUCO, "mirrored"),
     (TAGS, "mirrored")],
)  # fmt: skip
def test_a_picture_without_the_board_has_no_marks(board: Board, what: str) -> None:
    if what == "mirrored":
        grey = np.ascontiguousarray(np.fliplr(photograph_of(board, CAMERA, looking_at(board, TURNED, 300.0))))
    else:
        random = np.random.default_rng(3)
        grey = np.full((680, 900), 128) if what == "nothing" else random.integers(0, 255, (680, 900))
        grey = grey.astype(np.uint8)
    found = find_board(grey, board)
    assert not found.marks
    assert found.fault


def test_every_board_that_cannot_be_used_is_refused_with_all_reasons() -> None:
    wrong = Board("charuco", 2, 6, 0.0, 18.0, "NONE")
    with pytest.raises(OripError, match=r"size is 2x6.*no size.*dictionary NONE"):
        check_board(wrong)
    for board in (Board("chess", 8, 6, 20.0), Board("circles", 4, 10, 20.0, 10.0)):
        with pytest.raises(OripError, match="half a turn"):
            check_board(board)
    with pytest.raises(OripError, match="needs tags 90 to 116, dictionary 5X5_100 has 0 to 99"):
        check_board(Board("charuco", 9, 6, 24.0, 18.0, "5X5_100", first_tag=90))


def test_points_run_in_rows_from_the_upper_left() -> None:
    names = list(board_points(CHESS).items())
    assert names[0] == ("R1C1", (24.0, 120.0))
    assert all(a[1][0] < b[1][0] for a, b in pairwise(names[:8]))
