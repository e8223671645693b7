"""Boards of chequers, tags, circles and coded dots: what is on them, and where.

A board's coordinates are millimetres: x to the right, y up, from the lower left corner of its pattern.
"""

from __future__ import annotations

from typing import Any, Literal

from msgspec import Struct

from orip.errors import OripError
from orip.pictures.targets.coded_dots import FAMILIES, OUTER, codes_of
from orip.pictures.targets.marks import opencv

BoardKind = Literal["charuco", "chess", "circles", "tags", "rings"]


class Board(Struct, frozen=True):
    """A plane board.

    Parameters
    ----------
    kind : {"charuco", "chess", "circles", "tags", "rings"}
        Chequers with a tag in each light square; chequers; rows of circles, every second one displaced; rows of tags;
        rows of coded dots.
    columns, rows : int
        Squares; of circles: how many in a row, and how many rows; of tags and coded dots: these.
    square : float
        Side of a square, or from tag to tag; of circles: the distance of rows, half that of neighbours in one. mm.
    tag : float
        Side of a tag; of circles and of the rings of coded dots: the diameter. mm.
    dictionary : str
        Of the tags, such as ``5X5_100`` or ``APRILTAG_36h11``; of coded dots ``RINGS_16`` or ``RINGS_20``.
    first_tag : int
        Number of the first one: boards with different tags can be in one picture.
    prefix : str
        Of the names of points.
    """

    kind: BoardKind
    columns: int
    rows: int
    square: float
    tag: float = 0.0
    dictionary: str = ""
    first_tag: int = 0
    prefix: str = ""


def check_board(board: Board) -> None:
    """Refuse a board that cannot be made, or whose points cannot be told apart.

    Raises
    ------
    OripError
        With everything that is wrong.
    """
    faults = []
    least = {"charuco": 3, "chess": 4, "circles": 3, "tags": 1, "rings": 1}[board.kind]
    if min(board.columns, board.rows) < least or max(board.columns, board.rows) > 100:
        faults.append(f"its size is {board.columns}x{board.rows}: {least} to 100 are allowed")
    if not 0.0 < board.square < 1e5:
        faults.append("its squares have no size: give millimetres above 0")
    if board.kind == "chess" and (board.columns + board.rows) % 2 == 0:
        faults.append("turned by half a turn it looks the same: one of columns and rows must be even, the other odd")
    if board.kind == "circles" and board.rows % 2 == 0:
        faults.append("turned by half a turn it looks the same: the number of rows must be odd")
    if board.kind != "chess" and not 0.0 < board.tag < board.square * (1.4 if board.kind == "circles" else 1.0):
        faults.append("its tags or circles must be larger than 0 and smaller than what they stand in")
    if board.kind == "rings" and not board.tag < 6.0 / 7.0 * board.square:
        faults.append("between its rings there must be light ground, a sixth of their diameter at least")
    if board.kind in {"charuco", "tags", "rings"}:
        faults += _faults_of_tags(board)
    if faults:
        raise OripError("the board cannot be used: " + "; ".join(faults))


def _faults_of_tags(board: Board) -> list[str]:
    known = tuple(FAMILIES) if board.kind == "rings" else dictionaries()
    if board.dictionary.upper() not in known:
        return [f"dictionary {board.dictionary or 'of no name'} is not known; there are {', '.join(known)}"]
    count = len(codes_of(board.dictionary)) if board.kind == "rings" else len(dictionary_of(board.dictionary).bytesList)
    needed = board.first_tag + _tag_count(board)
    if board.first_tag < 0 or needed > count:
        return [f"it needs tags {board.first_tag} to {needed - 1}, dictionary {board.dictionary} has 0 to {count - 1}"]
    return []


def dictionaries() -> tuple[str, ...]:
    """Return the names of the dictionaries of tags."""
    names = {name.removeprefix("DICT_").upper() for name in dir(opencv().aruco) if name.startswith("DICT_")}
    return tuple(sorted(names))


def dictionary_of(name: str) -> Any:
    """Return OpenCV's dictionary of tags of a name."""
    aruco = opencv().aruco
    return aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{name.upper()}"))


def _tag_count(board: Board) -> int:
    squares = board.columns * board.rows
    return squares // 2 if board.kind == "charuco" else squares


def board_points(board: Board) -> dict[str, tuple[float, float]]:
    """Return the points of a board and their coordinates.

    Corners and circles are called by row and column, from 1 at the upper left: ``R2C5``. Corners of tags are
    ``TAG7-1`` to ``TAG7-4``, clockwise from the upper left one; coded dots are ``CODE7``. A prefix comes first.
    """
    if board.kind == "tags":
        return {
            f"{board.prefix}TAG{number}-{corner + 1}": place
            for number, corners in tag_corners(board).items()
            for corner, place in enumerate(corners)
        }
    if board.kind == "rings":
        return {
            f"{board.prefix}CODE{number}": (
                0.5 * (corners[0][0] + corners[1][0]),
                0.5 * (corners[0][1] + corners[3][1]),
            )
            for number, corners in tag_corners(board).items()
        }
    if board.kind == "circles":
        height = (board.rows - 1) * board.square
        return {
            name_of(board, row, column): ((2 * column + row % 2) * board.square, height - row * board.square)
            for row in range(board.rows)
            for column in range(board.columns)
        }
    return {
        name_of(board, row, column): ((column + 1) * board.square, (board.rows - 1 - row) * board.square)
        for row in range(board.rows - 1)
        for column in range(board.columns - 1)
    }


def name_of(board: Board, row: int, column: int) -> str:
    """Return the name of a corner or circle, rows and columns from 0."""
    return f"{board.prefix}R{row + 1}C{column + 1}"


def dot_radius(board: Board) -> float:
    """Return the radius of the circles, or of the dots that have codes, mm."""
    return 0.5 * board.tag / (OUTER if board.kind == "rings" else 1.0)


def tag_corners(board: Board) -> dict[int, tuple[tuple[float, float], ...]]:
    """Return by number the corners of tags, or of the squares round rings, clockwise from the upper left one."""
    corners: dict[int, tuple[tuple[float, float], ...]] = {}
    margin = 0.5 * (board.square - board.tag)
    number = board.first_tag
    for row in range(board.rows):
        for column in range(board.columns):
            if board.kind == "charuco" and (row + column) % 2 == 0:  # a dark square
                continue
            left, top = column * board.square + margin, (board.rows - row) * board.square - margin
            right, bottom = left + board.tag, top - board.tag
            corners[number] = ((left, top), (right, top), (right, bottom), (left, bottom))
            number += 1
    return corners


def tag_bits(board: Board, number: int) -> Any:
    """Return the dark (0) and light (255) fields of a tag with its dark border, rows from the top."""
    dictionary = dictionary_of(board.dictionary)
    return opencv().aruco.generateImageMarker(dictionary, number, dictionary.markerSize + 2)
