"""Boards on paper: what is drawn is the board, to scale, in SVG and PDF."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from orip.pictures.targets.boards import Board, board_points
from orip.pictures.targets.found_boards import find_board
from orip.pictures.targets.printing import pdf_bytes, svg_text

BOARDS = (
    Board("charuco", 7, 5, 20.0, 15.0, "4X4_50"),
    Board("chess", 7, 6, 20.0),
    Board("tags", 3, 2, 40.0, 30.0, "APRILTAG_36H11"),
)
PER_MM = 4


def painted(rectangles: list[tuple[float, float, float, float, bool]], width: float, height: float) -> np.ndarray:
    """Return a picture of rectangles x, y (of the upper left corner, down), width, height, dark; PER_MM pixels a mm."""
    picture = np.full((round(height * PER_MM), round(width * PER_MM)), 255, dtype=np.uint8)
    for x, y, w, h, is_dark in rectangles:
        (i, j), (m, n) = (np.rint(np.array(place) * PER_MM).astype(int) for place in ((x, y), (x + w, y + h)))
        picture[j:n, i:m] = 0 if is_dark else 255
    return picture


def of_svg(text: str) -> np.ndarray:
    root = ET.fromstring(text)
    width, height = (float(root.attrib[side].removesuffix("mm")) for side in ("width", "height"))
    assert root.attrib["viewBox"] == f"0 0 {width:.4f} {height:.4f}"
    keys = ("x", "y", "width", "height")
    rectangles = [
        (*(float(one.attrib.get(key, "0")) for key in keys), one.attrib["fill"] == "black")
        for one in root.iter("{http://www.w3.org/2000/svg}rect")
    ]
    return painted(rectangles, width, height)  # type: ignore[arg-type]


def of_pdf(data: bytes) -> np.ndarray:
    text = data.decode("ascii")
    box = re.search(r"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", text)
    assert box is not None
    width, height = (float(side) * 25.4 / 72.0 for side in box.groups())
    rectangles, is_dark = [], True
    for line in text.split("stream\n")[1].splitlines():
        if line in {"0 g", "1 g"}:
            is_dark = line == "0 g"
        elif line.endswith(" re f"):
            x, y, w, h = map(float, line.split()[:4])
            rectangles.append((x, height - y - h, w, h, is_dark))
    return painted(rectangles, width, height)


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.kind)
@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_a_printed_board_is_found_to_scale(board: Board, form: str) -> None:
    picture = of_svg(svg_text(board)) if form == "svg" else of_pdf(pdf_bytes(board))
    found = find_board(picture, board)
    points = board_points(board)
    assert {mark.name for mark in found.marks} == set(points)
    measured = np.array([(mark.column, -mark.row) for mark in found.marks]) / PER_MM
    given = np.array([points[mark.name] for mark in found.marks])
    np.testing.assert_allclose(measured - measured[0], given - given[0], atol=0.05)


@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_the_ruler_is_100_mm_long(form: str) -> None:
    picture = of_svg(svg_text(BOARDS[0])) if form == "svg" else of_pdf(pdf_bytes(BOARDS[0]))
    foot = picture[-round(13.9 * PER_MM) : -round(10.0 * PER_MM)]  # above the line and its words
    columns = np.flatnonzero((foot == 0).any(axis=0))
    assert columns.max() + 1 - columns.min() == 100 * PER_MM


def test_circles_are_drawn_round_in_both_forms() -> None:
    board = Board("circles", 4, 5, 10.0, 8.0)
    assert svg_text(board).count('r="4.0000"') == 20
    assert pdf_bytes(board).count(b" c") >= 80


def test_a_pdf_can_be_read_by_its_table_of_places() -> None:
    data = pdf_bytes(BOARDS[0])
    start = int(data.rsplit(b"startxref\n", 1)[1].split()[0])
    assert data[start:].startswith(b"xref")
    places = [int(line[:10]) for line in data[start:].splitlines()[3:8]]
    for number, place in enumerate(places, start=1):
        assert data[place:].startswith(f"{number} 0 obj".encode())
