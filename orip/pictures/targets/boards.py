"""Boards of chequers, tags and circles: what is on them, and where it is in a picture.

A board's coordinates are millimetres: x to the right, y up, from the lower left corner of its pattern.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import OripError
from orip.geometry.plane import homography
from orip.pictures.targets.corners import measure_crossing, measure_tag
from orip.pictures.targets.dots import Dot, as_bytes, find_dots
from orip.pictures.targets.marks import FoundTargets, Mark, Rejected
from orip.pictures.targets.neighbours import affinity, consistent, eccentricity, smallest_scale
from orip.pictures.targets.packages import opencv

BoardKind = Literal["charuco", "chess", "circles", "tags"]

_GAP = 40.0
_LARGEST_DRAWING = 30_000_000

_MIRRORED_OR_NONE = "no board was found: it is not in the picture, too small, cut, blurred, or of another size"


class Board(Struct, frozen=True):
    """A plane board.

    Parameters
    ----------
    kind : {"charuco", "chess", "circles", "tags"}
        Chequers with a tag in each light square; chequers; rows of circles, every second one displaced; rows of tags.
    columns, rows : int
        Squares; of circles: how many in a row, and how many rows; of tags: tags.
    square : float
        Side of a square, or from tag to tag; of circles: the distance of rows, half that of neighbours in one. mm.
    tag : float
        Side of a tag; of circles: the diameter. mm.
    dictionary : str
        Of the tags, such as ``5X5_100`` or ``APRILTAG_36h11``.
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
    least = {"charuco": 3, "chess": 4, "circles": 3, "tags": 1}[board.kind]
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
    if board.kind in {"charuco", "tags"}:
        faults += _faults_of_tags(board)
    if faults:
        raise OripError("the board cannot be used: " + "; ".join(faults))


def _faults_of_tags(board: Board) -> list[str]:
    known = dictionaries()
    if board.dictionary.upper() not in known:
        return [f"dictionary {board.dictionary or 'of no name'} is not known; there are {', '.join(known)}"]
    count = len(_dictionary(board.dictionary).bytesList)
    needed = board.first_tag + _tag_count(board)
    if board.first_tag < 0 or needed > count:
        return [f"it needs tags {board.first_tag} to {needed - 1}, dictionary {board.dictionary} has 0 to {count - 1}"]
    return []


def dictionaries() -> tuple[str, ...]:
    """Return the names of the dictionaries of tags."""
    names = {name.removeprefix("DICT_").upper() for name in dir(opencv().aruco) if name.startswith("DICT_")}
    return tuple(sorted(names))


def _dictionary(name: str) -> Any:
    aruco = opencv().aruco
    return aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{name.upper()}"))


def _tag_count(board: Board) -> int:
    squares = board.columns * board.rows
    return squares if board.kind == "tags" else squares // 2


def board_points(board: Board) -> dict[str, tuple[float, float]]:
    """Return the points of a board and their coordinates.

    Corners and circles are called by row and column, from 1 at the upper left: ``R2C5``. Corners of tags are
    ``TAG7-1`` to ``TAG7-4``, clockwise from the upper left one. A prefix comes first.
    """
    if board.kind == "tags":
        return {
            f"{board.prefix}TAG{number}-{corner + 1}": place
            for number, corners in tag_corners(board).items()
            for corner, place in enumerate(corners)
        }
    if board.kind == "circles":
        height = (board.rows - 1) * board.square
        return {
            _name(board, row, column): ((2 * column + row % 2) * board.square, height - row * board.square)
            for row in range(board.rows)
            for column in range(board.columns)
        }
    return {
        _name(board, row, column): ((column + 1) * board.square, (board.rows - 1 - row) * board.square)
        for row in range(board.rows - 1)
        for column in range(board.columns - 1)
    }


def _name(board: Board, row: int, column: int) -> str:
    return f"{board.prefix}R{row + 1}C{column + 1}"


def tag_corners(board: Board) -> dict[int, tuple[tuple[float, float], ...]]:
    """Return the corners of the tags of a board by their numbers, clockwise from the upper left one."""
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
    dictionary = _dictionary(board.dictionary)
    return opencv().aruco.generateImageMarker(dictionary, number, dictionary.markerSize + 2)


def find_board(grey: Any, board: Board) -> FoundTargets:
    """Find the points of a board in a picture.

    Parameters
    ----------
    grey : array (rows, columns) of uint8 or uint16
    board : Board

    Returns
    -------
    FoundTargets
        Without marks, and with the reason, where the board is not found.
    """
    picture = as_bytes(grey)
    found = {"charuco": _find_charuco, "chess": _find_chess, "circles": _find_circles, "tags": _find_tags}
    measured = found[board.kind](picture, board)
    if measured.fault or board.kind == "tags":
        return measured
    measured = _with_consistent(measured, board)
    return _centred(measured, board) if board.kind == "circles" and not measured.fault else measured


def find_tags(grey: Any, dictionary: str, prefix: str = "") -> FoundTargets:
    """Find all tags of a dictionary, wherever they are, and measure their corners.

    A tag that is in the picture twice is not measured: its name would be ambiguous.
    """
    picture = as_bytes(grey)
    tags, repeated = _detected(picture, dictionary)
    measured: list[Mark | Rejected] = [
        mark for number in sorted(tags) for mark in measure_tag(picture, f"{prefix}TAG{number}", tags[number])
    ]
    twice = tuple(
        Rejected(float(corners[0, 0]), float(corners[0, 1]), "this tag is in the picture twice", f"{prefix}TAG{number}")
        for number, corners in repeated.items()
    )
    marks, rejected = _divided(measured, twice)
    return FoundTargets(marks, rejected, "" if marks else f"no tag of dictionary {dictionary} was measured")


def _detected(picture: Any, dictionary: str) -> tuple[dict[int, FloatArray], dict[int, FloatArray]]:
    """Return the corners (4, 2) of tags by their numbers: of those found once, and of the others."""
    aruco = opencv().aruco
    parameters = aruco.DetectorParameters()
    parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
    corners, numbers, _ = aruco.ArucoDetector(_dictionary(dictionary), parameters).detectMarkers(picture)
    once: dict[int, FloatArray] = {}
    repeated: dict[int, FloatArray] = {}
    for number, four in zip([] if numbers is None else numbers.ravel().tolist(), corners, strict=True):
        place = np.asarray(four, dtype=float).reshape(4, 2) + 0.5
        if number in once or number in repeated:
            repeated[number] = place
            once.pop(number, None)
        else:
            once[number] = place
    return once, repeated


def _find_tags(picture: Any, board: Board) -> FoundTargets:
    wanted = tag_corners(board)
    found = find_tags(picture, board.dictionary, board.prefix)
    names = {f"{board.prefix}TAG{number}" for number in wanted}
    marks = tuple(mark for mark in found.marks if mark.name.rpartition("-")[0] in names)
    others = tuple(
        Rejected(mark.column, mark.row, "not a tag of the board", mark.name)
        for mark in found.marks
        if mark.name.rpartition("-")[0] not in names
    )
    return FoundTargets(marks, found.rejected + others, "" if marks else _MIRRORED_OR_NONE)


def _find_charuco(picture: Any, board: Board) -> FoundTargets:
    cv2 = opencv()
    tags, repeated = _detected(picture, board.dictionary)
    wanted = tag_corners(board)
    if set(repeated) & set(wanted):
        return FoundTargets((), (), "tags of the board are in the picture twice: two boards of the same kind")
    own = {number: corners for number, corners in tags.items() if number in wanted}
    if len(own) < 2:
        return FoundTargets((), (), _MIRRORED_OR_NONE)
    size = board.columns, board.rows
    numbers = np.array(sorted(wanted), dtype=np.int32)
    pattern = cv2.aruco.CharucoBoard(size, board.square, board.tag, _dictionary(board.dictionary), numbers)
    detector = cv2.aruco.CharucoDetector(pattern)
    corners = [(own[number] - 0.5).astype(np.float32).reshape(1, 4, 2) for number in sorted(own)]
    places, indices, _, _ = detector.detectBoard(
        picture, markerCorners=corners, markerIds=np.array(sorted(own), dtype=np.int32).reshape(-1, 1)
    )
    if indices is None or len(indices) < 4:
        return FoundTargets((), (), _MIRRORED_OR_NONE)
    across = board.columns - 1
    starts = {
        _name(board, index // across, index % across): (float(place[0]) + 0.5, float(place[1]) + 0.5)
        for index, place in zip(indices.ravel().tolist(), places.reshape(-1, 2), strict=True)
    }
    margin = 0.5 * (board.square - board.tag)
    return _crossings(picture, board, starts, min(0.42, 1.3 * margin / board.square))


def _find_chess(picture: Any, board: Board) -> FoundTargets:
    cv2 = opencv()
    size = board.columns - 1, board.rows - 1
    is_found, corners = cv2.findChessboardCornersSB(picture, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not is_found:
        return FoundTargets((), (), _MIRRORED_OR_NONE)
    places = corners.reshape(-1, 2).astype(float) + 0.5
    grid = places.reshape(size[1], size[0], 2)
    if not _is_dark(picture, grid):
        grid = grid[::-1, ::-1]
    starts = {
        _name(board, row, column): (float(grid[row, column, 0]), float(grid[row, column, 1]))
        for row in range(size[1])
        for column in range(size[0])
    }
    return _crossings(picture, board, starts, 0.42)


def _is_dark(picture: Any, grid: FloatArray) -> bool:
    """Tell whether the squares like that between the first four corners are darker than the others.

    The upper left square of a board is dark, and so is the one beyond its first corner.
    """
    middle = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    columns, rows = np.floor(middle).astype(int).transpose(2, 0, 1)
    values = picture[rows, columns].astype(float)
    even = np.add.outer(np.arange(values.shape[0]), np.arange(values.shape[1])) % 2 == 0
    return bool(values[even].mean() < values[~even].mean())


def _crossings(picture: Any, board: Board, starts: Mapping[str, tuple[float, float]], part: float) -> FoundTargets:
    """Measure corners within a part of the side of a square around them."""
    points = board_points(board)
    names = list(starts)
    plane, image = np.array([points[name] for name in names]), np.array([starts[name] for name in names])
    measured: list[Mark | Rejected] = []
    for name, place in zip(names, image, strict=True):
        near = np.argsort(np.hypot(*(plane - points[name]).T), kind="stable")[:9]
        matrix, rank = affinity(plane[near], image[near])
        scale = smallest_scale(matrix) if rank == 3 else 0.0
        measured.append(
            measure_crossing(picture, name, (float(place[0]), float(place[1])), part * scale * board.square)
        )
    missing = tuple(Rejected(0.0, 0.0, "not found", name) for name in points if name not in starts)
    return FoundTargets(*_divided(measured, missing))


def _divided(
    items: Sequence[Mark | Rejected], missing: tuple[Rejected, ...] = ()
) -> tuple[tuple[Mark, ...], tuple[Rejected, ...]]:
    marks = tuple(item for item in items if isinstance(item, Mark))
    return marks, tuple(item for item in items if isinstance(item, Rejected)) + missing


def _find_circles(picture: Any, board: Board) -> FoundTargets:
    found = find_dots(picture)
    dots = _of_one_size(found.dots)
    if len(dots) < board.columns * board.rows:
        return FoundTargets((), found.rejected, _MIRRORED_OR_NONE)
    measured = np.array([[dot.column, dot.row] for dot in dots])
    ordered = _in_grid(measured, board)
    if ordered is None:
        return FoundTargets((), found.rejected, _MIRRORED_OR_NONE)
    marks = []
    for index, dot in enumerate(dots[place] for place in ordered):
        name = _name(board, index // board.columns, index % board.columns)
        marks.append(Mark(name, dot.column, dot.row, dot.deviation))
    return FoundTargets(tuple(marks), ())


def _in_grid(places: FloatArray, board: Board) -> list[int] | None:
    """Return which circle is which, by OpenCV; None where they are not those of the board.

    What it gets is a drawing of the circles alone, of one size and with room between them: the picture itself has other
    things, and small or slanting circles, that it does not take for blobs.
    """
    cv2 = opencv()
    away = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    np.fill_diagonal(away, np.inf)
    scale = _GAP / max(float(np.median(away.min(axis=1))), 1.0)
    drawn = (places - places.min(axis=0)) * scale + 2.0 * _GAP
    columns, rows = (drawn.max(axis=0) + 2.0 * _GAP).astype(int).tolist()
    if columns * rows > _LARGEST_DRAWING:
        return None
    clean = np.full((rows, columns), 255, dtype=np.uint8)
    for x, y in np.rint(drawn).astype(int).tolist():
        cv2.circle(clean, (x, y), int(0.3 * _GAP), 0, -1)
    is_found, centres = cv2.findCirclesGrid(clean, (board.columns, board.rows), flags=cv2.CALIB_CB_ASYMMETRIC_GRID)
    if not is_found:
        return None
    off = np.hypot(*(centres.reshape(-1, 1, 2) - drawn).transpose(2, 0, 1))
    return [int(place) for place in off.argmin(axis=1)]


def _centred(found: FoundTargets, board: Board) -> FoundTargets:
    """Correct the centres of ellipses to the images of the circles' centres."""
    points = board_points(board)
    xy = np.array([points[mark.name] for mark in found.marks])
    places = np.array([[mark.column, mark.row] for mark in found.marks])
    off = eccentricity(homography(xy, places), xy, 0.5 * board.tag)
    marks = tuple(
        Mark(mark.name, mark.column - float(x), mark.row - float(y), mark.deviation)
        for mark, (x, y) in zip(found.marks, off, strict=True)
    )
    return FoundTargets(marks, found.rejected)


def _of_one_size(dots: Sequence[Dot]) -> list[Dot]:
    """Return the dots whose size is near the usual one: what else is round in a picture has another."""
    usual = float(np.median([dot.radius for dot in dots])) if dots else 0.0
    return [dot for dot in dots if 0.4 * usual < dot.radius < 2.5 * usual]


def _with_consistent(found: FoundTargets, board: Board) -> FoundTargets:
    """Reject what is not where its neighbours predict it, and a board of which too little is left."""
    points = board_points(board)
    if not found.marks:
        return FoundTargets((), found.rejected, _MIRRORED_OR_NONE)
    xy = np.array([points[mark.name] for mark in found.marks])
    places = np.array([[mark.column, mark.row] for mark in found.marks])
    kept = set(consistent(xy, places).tolist())
    marks = tuple(mark for index, mark in enumerate(found.marks) if index in kept)
    rejected = found.rejected + tuple(
        Rejected(mark.column, mark.row, "not where its neighbours predict it", mark.name)
        for index, mark in enumerate(found.marks)
        if index not in kept
    )
    return FoundTargets(marks, rejected, "" if len(marks) >= 4 else _MIRRORED_OR_NONE)
