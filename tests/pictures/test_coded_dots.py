"""Coded dots: the distances of their codes, and rendered ones under tilt, blur and noise, none of them misnamed."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest
from pictures.rendered import Camera, drawing, looking_at, photograph, photograph_of
from support.long_cases import every, in_turn

from orip.errors import OripError
from orip.pictures.targets.boards import Board, board_points, check_board
from orip.pictures.targets.coded_dots import FAMILIES, codes_of, dark_runs, find_coded
from orip.pictures.targets.found_boards import find_board, find_tags
from orip.pictures.targets.printing import board_shapes, board_size, pdf_bytes, svg_text

CAMERA = Camera()
BOARD = Board("rings", 6, 5, 40.0, 30.0, "RINGS_16")
FINE = Board("rings", 5, 4, 48.0, 36.0, "RINGS_20", first_tag=260)


def turned(word: str) -> list[str]:
    return [word[place:] + word[:place] for place in range(len(word))]


@pytest.mark.parametrize(("family", "count"), [("RINGS_16", 31), ("RINGS_20", 289)])
def test_codes_differ_in_four_fields_however_they_are_turned_or_mirrored(family, count):
    words = [format(code, f"0{FAMILIES[family]}b") for code in codes_of(family)]
    assert len(words) == count
    fields = np.array([[list(map(int, one)) for one in turned(word)] for word in words])
    for number, word in enumerate(words):
        own = np.array(list(map(int, word)))
        off = (fields != own).sum(axis=2)
        off[number] = 99
        mirrored = (fields != own[::-1]).sum(axis=2)
        assert min(off.min(), mirrored.min()) >= 4


def test_dark_parts_are_the_ones_of_the_word():
    for family in FAMILIES:
        step = 2.0 * np.pi / FAMILIES[family]
        for number, code in enumerate(codes_of(family)):
            word = format(code, f"0{FAMILIES[family]}b")
            middle = (np.arange(len(word)) + 0.5) * step
            dark = np.zeros(len(word), dtype=bool)
            for begin, end in dark_runs(family, number):
                dark |= np.mod(middle - begin, 2.0 * np.pi) < end - begin
            assert "".join("1" if one else "0" for one in dark) == word


def off_and_deviations(board, found, station):
    points = board_points(board)
    true = CAMERA.project(np.array([[*points[mark.name], 0.0] for mark in found.marks]), station)
    measured = np.array([[mark.column, mark.row] for mark in found.marks])
    return measured - true, np.array([mark.deviation for mark in found.marks])


SEEN = [((0.0, 0.0, 3.0), 0.7, 2.0), ((-25.0, -30.0, 190.0), 0.7, 2.0), ((35.0, 20.0, 77.0), 1.2, 5.0),
        ((10.0, -45.0, 300.0), 1.0, 8.0)]  # fmt: skip


@pytest.mark.parametrize(("seen", "board"), in_turn(SEEN, [BOARD, FINE]))
def test_all_are_named_and_where_they_should_be(seen, board):
    angles, blur, noise = seen
    station = looking_at(board, angles, 420.0)
    found = find_board(photograph_of(board, CAMERA, station, blur=blur, noise=noise), board)
    assert not found.fault
    off, deviations = off_and_deviations(board, found, station)
    assert np.abs(off).max() < 0.25
    # of 30 and 20; what is seen most obliquely may be too small to read
    assert len(found.marks) >= (0.9 if angles[1] == -45.0 else 1.0) * len(board_points(board))
    assert np.sqrt(np.mean(off**2)) < 0.03
    assert 0.7 < np.sqrt(np.mean((off / deviations) ** 2)) < 2.5


@pytest.mark.parametrize(("board", "distance"), [(BOARD, 1250.0), (FINE, 1200.0)], ids=["RINGS_16", "RINGS_20"])
def test_dots_of_four_and_five_pixels_are_read(board, distance):
    station = looking_at(board, (0.0, 0.0, 10.0), distance)
    found = find_board(photograph_of(board, CAMERA, station), board)
    assert len(found.marks) == len(board_points(board))
    # the ground between dot and ring is four pixels wide, and blurred from both sides
    assert np.sqrt(np.mean(off_and_deviations(board, found, station)[0] ** 2)) < 0.05


@pytest.mark.parametrize("seed", every(8, range(8)))
def test_none_is_misnamed_where_they_can_hardly_be_read(seed):
    random = np.random.default_rng(seed)
    angles = (random.uniform(-50.0, 50.0), random.uniform(-50.0, 50.0), random.uniform(0.0, 360.0))
    station = looking_at(BOARD, angles, random.uniform(450.0, 1000.0))
    grey = photograph_of(
        BOARD, CAMERA, station, blur=random.uniform(0.7, 2.0), noise=random.uniform(2.0, 12.0), seed=seed
    )
    found = find_tags(grey, "RINGS_16")
    if found.marks:
        off, _ = off_and_deviations(BOARD, found, station)
        assert np.abs(off).max() < 1.5
    # with all codes of the other family to be mistaken for
    other = find_coded(grey, "RINGS_20")
    assert not other.marks


def test_a_mirrored_picture_has_no_codes():
    grey = photograph_of(BOARD, CAMERA, looking_at(BOARD, (5.0, -10.0, 30.0), 420.0))
    found = find_coded(np.ascontiguousarray(np.fliplr(grey)), "RINGS_16")
    assert not found.marks
    assert sum(item.reason == "its ring is no code of RINGS_16" for item in found.rejected) >= 30


def test_rings_of_which_something_is_covered_or_added_are_rejected_or_right():
    station = looking_at(BOARD, (0.0, 0.0, 3.0), 420.0)
    field = drawing(board_shapes(BOARD), board_size(BOARD), 40.0)
    random = np.random.default_rng(5)
    # half of a field's width to three fields, dark or light, on every ring
    for x, y in board_points(BOARD).values():
        angle, size = random.uniform(0.0, 2.0 * np.pi), random.uniform(1.0, 5.0)
        i, j = ((np.array([x, y]) + 40.0 + 12.5 * np.array([np.cos(angle), np.sin(angle)])) * 8).astype(int)
        half = int(size * 4)
        field[j - half : j + half, i - half : i + half] = random.integers(2)
    found = find_coded(photograph(field, 40.0, CAMERA, station), "RINGS_16")
    off, _ = off_and_deviations(BOARD, found, station)
    assert np.abs(off).max() < 0.3
    assert len(found.marks) + len(found.rejected) >= 25
    assert {item.reason for item in found.rejected} <= {
        "its ring is not read with certainty", "its ring is no code of RINGS_16"}  # fmt: skip


def test_codes_that_are_there_twice_are_not_measured():
    grey = photograph_of(BOARD, CAMERA, looking_at(BOARD, (0.0, 0.0, 3.0), 400.0))
    found = find_coded(np.vstack([grey, grey]), "RINGS_16")
    assert not found.marks
    assert {item.reason for item in found.rejected} == {"this code is in the picture twice"}


def test_dots_without_rings_and_noise_have_no_codes():
    circles = Board("circles", 6, 9, 15.0, 8.0)
    plain = photograph_of(circles, CAMERA, looking_at(circles, (5.0, 5.0, 5.0), 300.0))
    noise = np.random.default_rng(3).integers(0, 255, (680, 900)).astype(np.uint8)
    for grey in (plain, noise):
        found = find_coded(grey, "RINGS_16")
        assert not found.marks
        assert "no coded dot of RINGS_16" in found.fault


def test_printed_rings_are_those_that_are_drawn():
    polygons = [one.attrib["points"] for one in ET.fromstring(svg_text(BOARD)).iter() if one.tag.endswith("polygon")]
    assert len(polygons) == sum(len(dark_runs("RINGS_16", number)) for number in range(30))
    paths = [line for line in pdf_bytes(BOARD).decode("ascii").splitlines() if line.endswith(" l h f")]
    assert len(paths) == len(polygons)
    # first corner of the first ring: millimetres from the left, and from the top or bottom
    x, y = map(float, polygons[0].split()[0].split(","))
    assert list(map(float, paths[0].split()[:2])) == [x, pytest.approx(5 * 40.0 + 2 * 12.0 + 14.0 - y, abs=1e-3)]


@pytest.mark.parametrize(
    ("board", "said"),
    [
        (Board("rings", 6, 6, 40.0, 30.0, "RINGS_16"), "RINGS_16 has 0 to 30"),
        (Board("rings", 6, 5, 40.0, 36.0, "RINGS_16"), "light ground"),
        (Board("rings", 6, 5, 40.0, 30.0, "5X5_100"), "there are RINGS_16, RINGS_20"),
    ],
)
def test_boards_of_rings_that_cannot_be_are_refused(board, said):
    with pytest.raises(OripError, match=said):
        check_board(board)
