"""Where the points of boards are in a picture, and where a plane's points should be, as their neighbours predict.

Predicted by neighbours, distortion adds up nowhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.geometry.plane import homography
from orip.pictures.targets.boards import Board, board_points, dictionary_of, dot_radius, name_of, tag_corners
from orip.pictures.targets.coded_dots import FAMILIES, find_coded
from orip.pictures.targets.corners import measure_crossing, measure_tag
from orip.pictures.targets.dots import Dot, as_bytes, find_dots
from orip.pictures.targets.marks import FoundTargets, Mark, Rejected, opencv

_FITTING = 0.12
"""How far from the place that all its neighbours predict a point may be, in distances of neighbouring points."""

_NEIGHBOURS = 12
_LEAST_KEPT = 6


def spacing_in_plane(xy: FloatArray) -> float:
    """Return the median distance of a point (n, 2) to the one nearest to it."""
    away = np.hypot(*(xy[:, None] - xy).transpose(2, 0, 1))
    np.fill_diagonal(away, np.inf)
    return float(np.median(away.min(axis=1)))


def affinity(plane: FloatArray, image: FloatArray, away: FloatArray | None = None) -> tuple[FloatArray, int]:
    """Return the affinity (3, 2) of points, near ones with more weight, and its rank."""
    weight = np.ones(len(plane)) if away is None else 1.0 / np.maximum(away, 1e-12)
    weight = (weight / weight.max())[:, None]
    scale = np.ptp(plane, axis=0).max()
    design = np.column_stack([plane / scale, np.ones(len(plane))])
    matrix, _, rank, _ = np.linalg.lstsq(design * weight, image * weight, rcond=1e-3)
    return matrix / np.array([[scale], [scale], [1.0]]), int(rank)


def with_one(xy: FloatArray) -> FloatArray:
    """Return homogeneous coordinates (n, 3)."""
    return np.column_stack([xy, np.ones(len(xy))])


def through(matrix: FloatArray, xy: FloatArray) -> FloatArray:
    """Return points (n, 2) mapped by a homography."""
    mapped = with_one(xy) @ matrix.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def smallest_scale(matrix: FloatArray) -> float:
    """Return pixels per unit of the plane in the direction in which an affinity has fewest."""
    return float(np.linalg.svd(matrix[:2])[1][1])


def consistent(xy: FloatArray, places: FloatArray) -> IntArray:
    """Return which points are where their neighbours predict them, the worst taken out one by one.

    Parameters
    ----------
    xy, places : arrays (n, 2)
        In the plane and in the picture.
    """
    kept = np.arange(len(xy))
    spacing = spacing_in_plane(xy) if len(xy) > 1 else 0.0
    while len(kept) > _LEAST_KEPT:
        off = [_misfit(int(place), kept, xy, places, spacing) for place in kept]
        worst = int(np.argmax(off))
        if off[worst] < _FITTING:
            break
        kept = np.delete(kept, worst)
    return kept


def _misfit(point: int, kept: IntArray, xy: FloatArray, places: FloatArray, spacing: float) -> float:
    """Return how far a point is from where its neighbours' homography predicts it, in distances of neighbours."""
    known = kept[kept != point]
    near = known[np.argsort(np.hypot(*(xy[known] - xy[point]).T), kind="stable")[:_NEIGHBOURS]]
    matrix, rank = affinity(xy[near], places[near])
    if rank < 3:
        return 0.0
    try:
        predicted = through(homography(xy[near], places[near]), xy[[point]])[0]
    except ValueError:  # all but one on a line
        return 0.0
    return float(np.hypot(*(predicted - places[point]))) / max(smallest_scale(matrix) * spacing, 1e-12)


def eccentricity(plane_to_image: FloatArray, centres: FloatArray, radius: float) -> FloatArray:
    """Return the centre of the ellipse less the image of the circle's centre, of circles in a plane, pixels (n, 2).

    With C the conic of the circle and H the homography from the plane to the picture, the ellipse is H^-T C H^-1, and
    its centre the pole of the line at infinity: H C^-1 H^T (0, 0, 1). Heikkilä (2000), Geometric camera calibration
    using circular control points, IEEE PAMI 22(10); Ahn, Warnecke, Kotowski (1999), PFG 1999(6).

    Parameters
    ----------
    plane_to_image : array (3, 3)
        Distortion is left out: over a dot it is nearly linear.
    centres : array (n, 2)
        Of the circles, in the plane.
    radius : float
        In the same unit.
    """
    dual = np.zeros((len(centres), 3, 3))
    dual[:, :2, :2] = np.eye(2) * radius**2 - centres[:, :, None] * centres[:, None, :]
    dual[:, :2, 2] = dual[:, 2, :2] = -centres
    dual[:, 2, 2] = -1.0
    pole = plane_to_image @ dual @ plane_to_image.T @ np.array([0.0, 0.0, 1.0])
    return np.asarray(pole[:, :2] / pole[:, 2:] - through(plane_to_image, centres))


_GAP = 40.0
_LARGEST_DRAWING = 30_000_000

_MIRRORED_OR_NONE = "no board was found: it is not in the picture, too small, cut, blurred, or of another size"


def find_board(grey: Any, board: Board) -> FoundTargets:
    """Find the points of a board in a picture.

    Parameters
    ----------
    grey : array (rows, columns) of uint8 or uint16

    Returns
    -------
    FoundTargets
        Without marks, and with the reason, where the board is not found.
    """
    picture = as_bytes(grey)
    found = {"charuco": _find_charuco, "chess": _find_chess, "circles": _find_circles, "tags": _find_tags,
             "rings": _find_rings}  # fmt: skip
    measured = found[board.kind](picture, board)
    if measured.fault or board.kind == "tags":
        return measured
    measured = _with_consistent(measured, board)
    return _centred(measured, board) if board.kind in {"circles", "rings"} and not measured.fault else measured


def find_tags(grey: Any, dictionary: str, prefix: str = "") -> FoundTargets:
    """Find all tags of a dictionary, wherever they are, and measure their corners; of coded dots their centres.

    A tag that is in the picture twice is not measured: its name would be ambiguous.
    """
    if dictionary in FAMILIES:
        return find_coded(grey, dictionary, prefix)
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
    corners, numbers, _ = aruco.ArucoDetector(dictionary_of(dictionary), parameters).detectMarkers(picture)
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


def _find_rings(picture: Any, board: Board) -> FoundTargets:
    found = find_coded(picture, board.dictionary.upper(), board.prefix)
    wanted = board_points(board)
    marks = tuple(mark for mark in found.marks if mark.name in wanted)
    others = tuple(
        Rejected(mark.column, mark.row, "not a code of the board", mark.name)
        for mark in found.marks
        if mark.name not in wanted
    )
    named = {mark.name for mark in marks} | {item.name for item in found.rejected}
    missing = tuple(Rejected(0.0, 0.0, "not found", name) for name in wanted if name not in named)
    return FoundTargets(marks, found.rejected + others + missing, "" if marks else _MIRRORED_OR_NONE)


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
    pattern = cv2.aruco.CharucoBoard(size, board.square, board.tag, dictionary_of(board.dictionary), numbers)
    detector = cv2.aruco.CharucoDetector(pattern)
    corners = [(own[number] - 0.5).astype(np.float32).reshape(1, 4, 2) for number in sorted(own)]
    places, indices, _, _ = detector.detectBoard(
        picture, markerCorners=corners, markerIds=np.array(sorted(own), dtype=np.int32).reshape(-1, 1)
    )
    if indices is None or len(indices) < 4:
        return FoundTargets((), (), _MIRRORED_OR_NONE)
    across = board.columns - 1
    starts = {
        name_of(board, index // across, index % across): (float(place[0]) + 0.5, float(place[1]) + 0.5)
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
        name_of(board, row, column): (float(grid[row, column, 0]), float(grid[row, column, 1]))
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
        name = name_of(board, index // board.columns, index % board.columns)
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
    off = eccentricity(homography(xy, places), xy, dot_radius(board))
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
