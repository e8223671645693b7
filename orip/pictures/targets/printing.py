"""Boards on paper, to scale: SVG and PDF with fields as vectors, and a ruler to check the printer's scale."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from msgspec import Struct

from orip.pictures.targets.boards import Board, board_points, dot_radius, tag_bits, tag_corners
from orip.pictures.targets.coded_dots import INNER, OUTER, dark_runs

_MARGIN = 12.0
_RULER = 100.0
_FOOT = 14.0
_POINTS_PER_MM = 72.0 / 25.4
_CHORD = 0.01
"""Radians of an arc that are drawn straight: 1.3e-5 of the radius off."""

_CIRCLE = 0.5522847498
"""Handles of four Bézier curves of a circle of radius 1: within 2.7e-4 of it."""


class Shape(Struct, frozen=True):
    """A rectangle, or a circle or a polygon in it; millimetres, y up; dark or light.

    Parameters
    ----------
    x, y, width, height : float
        Lower left corner and size.
    is_round : bool
    is_dark : bool
    corners : tuple of (x, y)
        Of a polygon.
    """

    x: float
    y: float
    width: float
    height: float
    is_round: bool = False
    is_dark: bool = True
    corners: tuple[tuple[float, float], ...] = ()


def board_size(board: Board) -> tuple[float, float]:
    """Return width and height of the pattern, mm; of circles, from centre to centre."""
    if board.kind == "circles":
        return (2 * board.columns - 1) * board.square, (board.rows - 1) * board.square
    return board.columns * board.square, board.rows * board.square


def board_shapes(board: Board) -> Iterator[Shape]:
    """Yield what is printed of a board, in the order of printing, in its coordinates."""
    if board.kind in {"circles", "rings"}:
        radius = dot_radius(board)
        for number, (x, y) in enumerate(board_points(board).values(), start=board.first_tag):
            yield Shape(x - radius, y - radius, 2.0 * radius, 2.0 * radius, is_round=True)
            if board.kind == "rings":
                yield from _ring(board, number, x, y)
        return
    if board.kind != "tags":
        for row in range(board.rows):
            for column in range(row % 2, board.columns, 2):
                yield Shape(column * board.square, (board.rows - 1 - row) * board.square, board.square, board.square)
    if board.kind != "chess":
        for number, corners in tag_corners(board).items():
            yield from _tag(board, number, corners[0])


def _ring(board: Board, number: int, x: float, y: float) -> Iterator[Shape]:
    """Yield the dark parts of a ring: its first field begins at the right, and the next ones follow clockwise."""
    radius, half = dot_radius(board), 0.5 * board.tag
    for begin, end in dark_runs(board.dictionary.upper(), number):
        steps = np.linspace(-begin, -end, max(int((end - begin) / _CHORD), 2))
        along = np.column_stack([np.cos(steps), np.sin(steps)])
        corners = np.array([x, y]) + radius * np.vstack([OUTER * along, INNER * along[::-1]])
        yield Shape(x - half, y - half, board.tag, board.tag, corners=tuple(map(tuple, corners.tolist())))


def _tag(board: Board, number: int, upper_left: tuple[float, float]) -> Iterator[Shape]:
    bits = tag_bits(board, number)
    field = board.tag / len(bits)
    left, top = upper_left
    yield Shape(left, top - board.tag, board.tag, board.tag)
    for row, values in enumerate(bits):
        begin = 0
        for column in range(1, len(values) + 1):
            if column == len(values) or values[column] != values[begin]:
                if values[begin] > 0:
                    at = left + begin * field, top - (row + 1) * field
                    yield Shape(*at, (column - begin) * field, field, is_dark=False)
                begin = column


def describe_board(board: Board) -> str:
    """Return one line that says what a board is."""
    tags = f", {board.dictionary} {board.tag:g} mm from tag {board.first_tag}" if board.dictionary else ""
    circles = f", circles {board.tag:g} mm" if board.kind == "circles" else ""
    return f"{board.kind} {board.columns} x {board.rows}, {board.square:g} mm{tags}{circles}"


def _page(board: Board) -> tuple[float, float, float, float]:
    """Return width and height of the page, and where the pattern's lower left corner is on it, mm."""
    width, height = board_size(board)
    edge = _MARGIN + (0.5 * board.tag if board.kind == "circles" else 0.0)
    return max(width + 2.0 * edge, _RULER + 2.0 * _MARGIN), height + 2.0 * edge + _FOOT, edge, edge + _FOOT


def svg_text(board: Board) -> str:
    """Return a board as SVG; its size is in millimetres."""
    width, height, left, bottom = _page(board)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm"',
        f'  viewBox="0 0 {width:.4f} {height:.4f}" shape-rendering="crispEdges">',
        f'<rect width="{width:.4f}" height="{height:.4f}" fill="white"/>',
    ]
    for shape in board_shapes(board):
        fill = "black" if shape.is_dark else "white"
        x, y = left + shape.x, height - bottom - shape.y - shape.height
        if shape.corners:
            corners = " ".join(f"{left + a:.4f},{height - bottom - b:.4f}" for a, b in shape.corners)
            lines.append(f'<polygon points="{corners}" fill="{fill}"/>')
        elif shape.is_round:
            radius = 0.5 * shape.width
            lines.append(f'<circle cx="{x + radius:.4f}" cy="{y + radius:.4f}" r="{radius:.4f}" fill="{fill}"/>')
        else:
            size = f'width="{shape.width:.4f}" height="{shape.height:.4f}"'
            lines.append(f'<rect x="{x:.4f}" y="{y:.4f}" {size} fill="{fill}"/>')
    for shape in _ruler():
        at = f'x="{shape.x:.4f}" y="{height - shape.y - shape.height:.4f}"'
        lines.append(f'<rect {at} width="{shape.width:.4f}" height="{shape.height:.4f}" fill="black"/>')
    for text, x, y in _words(board):
        lines.append(f'<text x="{x:.4f}" y="{height - y:.4f}" font-size="3" font-family="Helvetica">{text}</text>')
    return "\n".join([*lines, "</svg>", ""])


def pdf_bytes(board: Board) -> bytes:
    """Return a board as PDF (1.4): one page of the size of the board, vectors, a font of every reader."""
    width, height, left, bottom = _page(board)
    scale = _POINTS_PER_MM
    drawn = [f"{scale:.10f} 0 0 {scale:.10f} 0 0 cm"]
    for shape in board_shapes(board):
        drawn.append("0 g" if shape.is_dark else "1 g")
        drawn.append(_pdf_shape(shape, left, bottom))
    drawn.append("0 g")
    drawn += [_pdf_shape(shape, 0.0, 0.0) for shape in _ruler()]
    drawn += [f"BT /F1 3 Tf {x:.4f} {y:.4f} Td ({text}) Tj ET" for text, x, y in _words(board)]
    content = "\n".join(drawn).encode("ascii", "replace")
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width * scale:.4f} {height * scale:.4f}] "
        "/Resources << /Font << /F1 5 0 R >> >> /Contents 4 0 R >>".encode(),
        f"<< /Length {len(content)} >>\nstream\n".encode() + content + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    return _assembled(objects)


def _pdf_shape(shape: Shape, left: float, bottom: float) -> str:
    x, y = left + shape.x, bottom + shape.y
    if shape.corners:
        corners = [f"{left + a:.4f} {bottom + b:.4f}" for a, b in shape.corners]
        return f"{corners[0]} m " + " ".join(f"{corner} l" for corner in corners[1:]) + " h f"
    if not shape.is_round:
        return f"{x:.4f} {y:.4f} {shape.width:.4f} {shape.height:.4f} re f"
    r = 0.5 * shape.width
    k, cx, cy = _CIRCLE * r, x + r, y + r
    turns = ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 0))
    path = [f"{cx + r:.4f} {cy:.4f} m"]
    for (a, b), (c, d) in pairwise(turns):
        handles = (cx + r * a + k * c, cy + r * b + k * d, cx + r * c + k * a, cy + r * d + k * b)
        path.append(" ".join(f"{value:.4f}" for value in (*handles, cx + r * c, cy + r * d)) + " c")
    return " ".join([*path, "f"])


def _assembled(objects: list[bytes]) -> bytes:
    data = bytearray(b"%PDF-1.4\n")
    places = []
    for number, body in enumerate(objects, start=1):
        places.append(len(data))
        data += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    start = len(data)
    data += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n".encode()
    data += b"".join(f"{place:010d} 00000 n \n".encode() for place in places)
    data += f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n".encode()
    return bytes(data)


def _ruler() -> Iterator[Shape]:
    """Yield a line of 100 mm between the outer edges of its end ticks, with a tick every 10 mm."""
    yield Shape(_MARGIN, 10.0, _RULER, 0.2)
    for tick in range(11):
        at = _MARGIN + tick * 10.0 - (0.0 if tick == 0 else 0.2 if tick == 10 else 0.1)
        yield Shape(at, 10.0, 0.2, 4.0 if tick % 5 == 0 else 2.5)


def _words(board: Board) -> list[tuple[str, float, float]]:
    return [
        (f"{_RULER:g} mm: measure this line, and use the squares as they are printed", _MARGIN, 6.0),
        (describe_board(board), _MARGIN, 2.0),
    ]
