"""Cofactors of an adjusted block computed once more with 50 digits, from the formulas of docs/conventions.md alone.

Partials are central differences: with steps of 10^-18 and 60 digits they are right to 30 digits.
"""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np

from orip.bundle.solve import SolvedBlock

_DIGITS = 60
_STEP = Decimal("1e-18")

Vector = list[Decimal]


def deviations_of_photos_and_points(solved: SolvedBlock) -> tuple[np.ndarray, np.ndarray]:
    """Return standard deviations (p, 6) and (n, 3), a-priori, of photos and points; rotations about the ground axes.

    Of a block with known cameras without distortion, free photos and points, and weighted control points.
    """
    with localcontext() as context:
        context.prec = _DIGITS
        normals = _normals(solved)
        roots = [value.sqrt() for value in _diagonal_of_inverse(normals)]
    photos = 6 * len(solved.block.photos)
    found = np.array([float(root) for root in roots])
    return found[:photos].reshape(-1, 6), found[photos:].reshape(-1, 3)


def _normals(solved: SolvedBlock) -> list[Vector]:
    block, state = solved.block, solved.state
    size = 6 * len(block.photos) + 3 * len(block.point_names)
    normals = [[Decimal(0)] * size for _ in range(size)]

    def add(columns: list[int], partials: Vector) -> None:
        for column, one in zip(columns, partials, strict=True):
            for row, other in zip(columns, partials, strict=True):
                normals[column][row] += one * other

    seen = block.photo_points
    for photo, point, errors in zip(seen.photo.tolist(), seen.point.tolist(), seen.error, strict=True):
        first = 6 * len(block.photos) + 3 * point
        columns = [*range(6 * photo, 6 * photo + 6), *range(first, first + 3)]
        c = Decimal(float(state.cameras[block.photo_camera[photo], 0]))
        place = [Decimal(float(value)) for value in (*state.centres[photo], *state.points[point])]
        turn = [[Decimal(float(value)) for value in row] for row in state.rotations[photo]]
        by_unknown = [_difference(c, turn, place, unknown) for unknown in range(9)]
        for axis, error in enumerate(errors):
            add(columns, [partial[axis] / Decimal(float(error)) for partial in by_unknown])
    index = block.point_index()
    for control in block.control_points:
        for axis, error in enumerate(control.errors):
            add([6 * len(block.photos) + 3 * index[control.name] + axis], [1 / Decimal(float(error))])
    return normals


def _difference(c: Decimal, turn: list[Vector], place: Vector, unknown: int) -> Vector:
    """Return the partials (2,) of a photo point by X0, Y0, Z0, rotations about X, Y, Z, or the point's X, Y, Z."""
    ends = []
    for sign in (1, -1):
        moved, rotation = list(place), [Decimal(0)] * 3
        if unknown < 3:
            moved[unknown] += sign * _STEP
        elif unknown < 6:
            rotation[unknown - 3] = sign * _STEP
        else:
            moved[unknown - 3] += sign * _STEP
        ends.append(_image(c, turn, moved, rotation))
    return [(one - other) / (2 * _STEP) for one, other in zip(*ends, strict=True)]


def _image(c: Decimal, turn: list[Vector], place: Vector, rotation: Vector) -> Vector:
    x, y, z = (place[3 + axis] - place[axis] for axis in range(3))
    a, b, g = rotation
    # the inverse of Exp(delta), to the first order: what is left out is of the order of the square of the step
    offset = [x + g * y - b * z, y + a * z - g * x, z + b * x - a * y]
    u = [sum((turn[row][column] * offset[row] for row in range(3)), Decimal(0)) for column in range(3)]
    return [-c * u[0] / u[2], -c * u[1] / u[2]]


def _diagonal_of_inverse(matrix: list[Vector]) -> Vector:
    """Return the diagonal of the inverse of a symmetric positive definite matrix, by Gauss and Jordan."""
    size = len(matrix)
    rows = [[*row, *(Decimal(int(column == place)) for column in range(size))] for place, row in enumerate(matrix)]
    for pivot in range(size):
        own = rows[pivot]
        factor = 1 / own[pivot]
        rows[pivot] = own = [value * factor if value else value for value in own]
        used = [column for column, value in enumerate(own) if value]
        for place, row in enumerate(rows):
            if place != pivot and row[pivot]:
                by = row[pivot]
                for column in used:
                    row[column] -= by * own[column]
    return [rows[place][size + place] for place in range(size)]
