"""Covariances of control points as text (.COV), and coefficients of correlation at the end of lines of control."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from orip.errors import Complaint
from orip.files.text.lines import FieldReader, field_lines
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint, PointCorrelation
from orip.structs import replace

CORRELATION_KEYS = (
    "rXY", "rXZ", "rYZ", "rXO", "rXP", "rXK", "rYO", "rYP", "rYK", "rZO", "rZP", "rZK", "rOP", "rOK", "rPK",
)  # fmt: skip
"""Those of the position, and after them all others."""

_PLACES = tuple(("XYZOPK".index(key[1]), "XYZOPK".index(key[2])) for key in CORRELATION_KEYS)
_UNKNOWN = "-"


def read_covariance(
    reader: FieldReader, errors: Sequence[float], start: int, count: int
) -> tuple[tuple[float, ...], ...] | None:
    """Return the covariance matrix of errors from coefficients of correlation; see `read_correlations`."""
    matrix = read_correlations(reader, errors, start, count)
    if matrix is None:
        return None
    return tuple(
        tuple(abs(one * other) * coefficient for other, coefficient in zip(errors, row, strict=False))
        for one, row in zip(errors, matrix, strict=False)
    )


def read_correlations(
    reader: FieldReader, errors: Sequence[float | None], start: int, count: int
) -> tuple[tuple[float, ...], ...] | None:
    """Return the matrix of coefficients of correlation of errors, from some fields from one on.

    None where the line ends before, has dashes for all of them, or a complaint was made.

    Parameters
    ----------
    errors : sequence of 3 or 6 float or None
        None or NaN where they are not known.
    start, count : int
        The first field; how many there are at most: 3 or 15.
    """
    there = min(count, reader.count - start)
    for known in (3, 0):
        if there > known and all(reader.text(index) == _UNKNOWN for index in range(start + known, start + there)):
            there = known
    if there <= 0:
        return None
    import numpy as np  # most lines have no correlations

    size = 3 if there == 3 else 6
    matrix = np.eye(size)
    for index, place in zip(range(start, start + there), _PLACES, strict=False):
        matrix[place] = matrix[place[::-1]] = reader.decimal(index)
    if not np.isfinite(matrix).all():
        return None
    if np.linalg.eigvalsh(matrix)[0] <= 0.0:
        names = " ".join(CORRELATION_KEYS[:3]) + (f" ... {CORRELATION_KEYS[-1]}" if size > 3 else "")
        reader.complain(
            f"coefficients of correlation {names} that no {'three' if size == 3 else 'six'} errors can have; each is "
            "above -1 and below 1, and together they make a positive definite matrix. Correct them, or write '-' for "
            f"all {'three' if size == 3 else 'fifteen'}",
            start,
        )
        return None
    if any(error is None or math.isnan(error) or error == 0.0 for error in errors[:size]):
        of = "X, Y and Z" if size == 3 else "the position and of the angles"
        reader.complain(f"coefficients of correlation need errors of {of} that are not 0; write '-' for them", start)
        return None
    return tuple(tuple(row) for row in matrix.tolist())


def correlation_cells(covariance: Sequence[Sequence[float]] | None, decimals: int) -> list[str]:
    """Return all 15 coefficients of a covariance as fields; dashes for those that it does not have."""
    size = 0 if covariance is None else len(covariance)
    return [
        f"{covariance[row][column] / math.sqrt(covariance[row][row] * covariance[column][column]):.{decimals}f}"
        if covariance is not None and max(row, column) < size
        else _UNKNOWN
        for row, column in _PLACES
    ]


COVARIANCE_KEYS = ("point", "other", "cXX", "cXY", "cXZ", "cYX", "cYY", "cYZ", "cZX", "cZY", "cZZ")
"""Fields of a line: the first letter of a covariance is the coordinate of `point`, the second that of `other`."""

_FORM = "point other cXX cXY cXZ cYX cYY cYZ cZX cZY cZZ (other may be the point itself)"
_AXES = "XYZ"
_AGREE = 0.02
"""Part by which the root of a variance may differ from the a-priori error: figures are rounded."""

Triple = tuple[float, float, float]


def parse_covariances(
    text: Parsed[list[str]], shown: str, points: Sequence[ControlPoint]
) -> Parsed[tuple[PointCorrelation, ...]]:
    """Read covariances of pairs of control points, ground unit squared; pairs that are missing are uncorrelated.

    The a-priori errors are those of the points. What the file has of a point with itself has to agree with them.
    """
    found: list[PointCorrelation] = []
    complaints: list[Complaint] = list(text.complaints)
    given = {point.name: point for point in points}
    lines: dict[frozenset[str], int] = {}
    for line in field_lines(text.value):
        reader = FieldReader(line, shown)
        pair = _read_pair(reader, given)
        if pair is not None:
            first = lines.setdefault(frozenset((pair.first, pair.second)), line.number)
            if first != line.number:
                reader.complain(f"the covariances of these points are already on line {first}; keep one of the two")
        complaints += reader.complaints
        if pair is not None and not reader.complaints:
            found.append(pair)
    if found and not complaints:
        complaints += _impossible(found, given, lines, shown)
    return Parsed(tuple(found), tuple(complaints))


def with_own_correlations(
    points: Sequence[ControlPoint], pairs: Sequence[PointCorrelation]
) -> tuple[tuple[ControlPoint, ...], tuple[PointCorrelation, ...]]:
    """Return the points with what a file has of each of them with itself, and the pairs of different points."""
    own = {pair.first: pair.coefficients for pair in pairs if pair.first == pair.second}
    return (
        tuple(
            replace(point, correlations=(rows[0][1], rows[0][2], rows[1][2]))
            if (rows := own.get(point.name))
            else point
            for point in points
        ),
        tuple(pair for pair in pairs if pair.first != pair.second),
    )


def _read_pair(reader: FieldReader, given: Mapping[str, ControlPoint]) -> PointCorrelation | None:
    if not reader.has_fields((len(COVARIANCE_KEYS),), _FORM) or reader.is_heading(range(2, len(COVARIANCE_KEYS))):
        return None
    names = reader.name(0), reader.name(1)
    for index, name in enumerate(names):
        if name not in given and not reader.complaints:
            message = (
                f"'{reader.shown_text(index)}' is no control point; give it a line in the .PNT file, or remove this"
            )
            reader.complain(message, index)
    values = [reader.decimal(index) for index in range(2, len(COVARIANCE_KEYS))]
    if reader.complaints:
        return None
    one, other = given[names[0]], given[names[1]]
    rows = [tuple(_coefficient(reader, (one, other), (a, b), values[3 * a + b]) for b in range(3)) for a in range(3)]
    if one is other and not reader.complaints:
        _check_own(reader, one, rows)
    first, second, third = rows
    return PointCorrelation(one.name, other.name, (_triple(first), _triple(second), _triple(third)))


def _triple(values: tuple[float, ...]) -> Triple:
    first, second, third = values
    return first, second, third


def _coefficient(
    reader: FieldReader, points: tuple[ControlPoint, ControlPoint], axes: tuple[int, int], covariance: float
) -> float:
    """Return a coefficient of correlation from a covariance."""
    field = 2 + 3 * axes[0] + axes[1]
    errors = [point.errors[axis] for point, axis in zip(points, axes, strict=True)]
    if covariance == 0.0:
        return 0.0
    for point, axis, error in zip(points, axes, errors, strict=True):
        if not error:
            reader.complain(
                f"a covariance of {_AXES[axis]} of point '{point.name}', which has "
                f"{'no a-priori error' if error is None else 'an a-priori error of 0'} in the .PNT file; write 0 here, "
                "or an error above 0 there",
                field,
            )
            return 0.0
    first, second = (abs(error or 1.0) for error in errors)
    if points[0] is points[1] and axes[0] == axes[1]:
        if not (1.0 - _AGREE) * first <= max(covariance, 0.0) ** 0.5 <= (1.0 + _AGREE) * first:
            reader.complain(
                f"a variance of {covariance:g} and an a-priori error of {first:g} in the .PNT file; the error is the "
                f"root of the variance ({max(covariance, 0.0) ** 0.5:.4g}), so correct one of them",
                field,
            )
        return 1.0
    if abs(covariance) >= first * second:
        reader.complain(
            f"a covariance of {covariance:g} is not possible with a-priori errors of {first:g} and {second:g}: it lies "
            f"between -{first * second:.4g} and {first * second:.4g} (ground unit squared)",
            field,
        )
    return covariance / (first * second)


def _check_own(reader: FieldReader, point: ControlPoint, rows: Sequence[Sequence[float]]) -> None:
    if point.correlations is not None:
        reader.complain(f"point '{point.name}' has rXY rXZ rYZ in the .PNT file, too; keep one of the two")
    if any(abs(rows[a][b] - rows[b][a]) > 1e-3 for a in range(3) for b in range(a)):
        reader.complain("cXY and cYX, cXZ and cZX, cYZ and cZY of a point are equal two by two; correct them")


def _impossible(
    found: Sequence[PointCorrelation],
    given: Mapping[str, ControlPoint],
    lines: Mapping[frozenset[str], int],
    shown: str,
) -> list[Complaint]:
    """Return a complaint if all coefficients together are those of no errors."""
    import numpy as np  # few projects have covariances

    names = list(dict.fromkeys(name for pair in found for name in (pair.first, pair.second)))
    matrix = np.eye(3 * len(names))
    for number, name in enumerate(names):
        rxy, rxz, ryz = given[name].correlations or (0.0, 0.0, 0.0)
        at = slice(3 * number, 3 * number + 3)
        matrix[at, at] = [[1.0, rxy, rxz], [rxy, 1.0, ryz], [rxz, ryz, 1.0]]
    for pair in found:
        one, other = (slice(3 * names.index(name), 3 * names.index(name) + 3) for name in (pair.first, pair.second))
        block = np.array(pair.coefficients)
        np.fill_diagonal(block, 1.0) if pair.first == pair.second else None
        matrix[one, other], matrix[other, one] = block, block.T
    values, vectors = np.linalg.eigh(matrix)
    if values[0] > 0.0:
        return []
    worst = names[int(np.argmax(np.abs(vectors[:, 0]))) // 3]
    line = min(number for pair, number in lines.items() if worst in pair)
    text = (
        f"these covariances are those of no errors: with the a-priori errors they make a matrix that is not positive "
        f"definite, most of all at point '{worst}'; give all covariances of the group, in ground units squared, "
        "from one adjustment"
    )
    return [Complaint(text, shown, line)]
