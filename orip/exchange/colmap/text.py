"""Text models of COLMAP (.txt): numbers separated by blanks, ``#`` at the beginning of a comment line."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.errors import MOST_COMPLAINTS, Complaint
from orip.exchange.colmap.model import CAMERA_MODELS, ColmapCamera, ColmapImage, ColmapPoints, no_points
from orip.files.text.lines import decode_lines
from orip.files.text.shown import Parsed, shown_token

_LARGEST_WHOLE = float(1 << 53)
_IMAGE_FIELDS, _POINT_FIELDS = 10, 8
_WHOLE = re.compile(r"-?[0-9]{1,18}")


def cameras_from_text(data: bytes, shown: str) -> Parsed[tuple[ColmapCamera, ...]]:
    """Read cameras.txt: ``ID MODEL COLUMNS ROWS PARAMETERS``."""
    lines = decode_lines(data, shown)
    cameras, complaints = [], list(lines.complaints)
    for number, line in records(lines.value):
        found = _camera(line.split())
        if isinstance(found, str):
            complaints.append(Complaint(found, shown, number))
        else:
            cameras.append(found)
    return Parsed(tuple(cameras), tuple(complaints))


def images_from_text(data: bytes, shown: str) -> Parsed[tuple[ColmapImage, ...]]:
    """Read images.txt, two lines an image: ``ID QW QX QY QZ TX TY TZ CAMERA NAME``, and ``COLUMN ROW POINT`` repeated.

    The second line may be empty; a name may have blanks.
    """
    lines = decode_lines(data, shown)
    images, complaints = [], list(lines.complaints)
    left = enumerate(lines.value, 1)
    for number, line in left:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        _, keypoints = next(left, (0, ""))
        found = _image(line, keypoints)
        if isinstance(found, str):
            complaints.append(Complaint(found, shown, number))
        elif isinstance(found, _KeypointFault):
            complaints.append(Complaint(found.message, shown, number + 1, found.column))
        else:
            images.append(found)
        if len(complaints) > MOST_COMPLAINTS:
            break  # a file of another kind has a fault in each line
    return Parsed(tuple(images), tuple(complaints))


def points_from_text(data: bytes, shown: str) -> Parsed[ColmapPoints]:
    """Read points3D.txt: ``ID X Y Z R G B ERROR``, and ``IMAGE KEYPOINT`` repeated."""
    lines = decode_lines(data, shown)
    complaints = list(lines.complaints)
    heads: list[str] = []
    tracks: list[str] = []
    lengths, numbers = [], []
    for number, line in records(lines.value):
        fields = line.split()
        if len(fields) < _POINT_FIELDS or len(fields) % 2:
            message = f"this line has {len(fields)} fields; write ID X Y Z R G B ERROR, then pairs of IMAGE KEYPOINT"
            complaints.append(Complaint(message, shown, number))
            if len(complaints) > MOST_COMPLAINTS:
                break
            continue
        heads += fields[:_POINT_FIELDS]
        tracks += fields[_POINT_FIELDS:]
        lengths.append((len(fields) - _POINT_FIELDS) // 2)
        numbers.append(number)
    if complaints:
        return Parsed(no_points(), tuple(complaints))
    starts = np.concatenate([[0], np.cumsum(lengths, dtype=np.int64) * 2])
    head, track = _numbers(heads), _numbers(tracks)
    faults = _field_faults(heads, head, list(range(0, len(heads) + 1, _POINT_FIELDS)), numbers, shown)
    faults += _field_faults(tracks, track, starts.tolist(), numbers, shown)
    faults += _impossible_points(head.reshape(-1, _POINT_FIELDS), track, numbers, starts, shown)
    if faults:
        return Parsed(no_points(), tuple(faults))
    rows = head.reshape(-1, _POINT_FIELDS)
    return Parsed(
        ColmapPoints(
            rows[:, 0].astype(np.int64),
            rows[:, 1:4].copy(),
            rows[:, 4:7].astype(np.uint8),
            rows[:, 7].copy(),
            np.array(lengths, dtype=np.int64),
            track.reshape(-1, 2).astype(np.int64),
        )
    )


class _KeypointFault:
    """What is wrong in a line of keypoints, and in which column."""

    def __init__(self, message: str, column: int | None = None) -> None:
        self.message, self.column = message, column


def records(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Return the lines of records with their numbers."""
    return (
        (number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")
    )


def _camera(fields: Sequence[str]) -> ColmapCamera | str:
    if len(fields) < 4:
        return f"this line has {len(fields)} fields; write ID MODEL COLUMNS ROWS PARAMETERS"
    model = CAMERA_MODELS.get(fields[1])
    if model is None:
        return f"{shown_token(fields[1])} is not a camera model of COLMAP; known are: {', '.join(CAMERA_MODELS)}"
    if len(fields) != 4 + len(model.parameters):
        return (
            f"{fields[1]} has {len(model.parameters)} parameters ({' '.join(model.parameters)}), but {len(fields) - 4} "
            "are here"
        )
    identity, columns, rows = (whole_number(fields[n]) for n in (0, 2, 3))
    if identity is None or columns is None or rows is None:
        return "the ID, the columns and the rows of a camera are whole numbers"
    parameters = [decimal_number(field) for field in fields[4:]]
    known = [value for value in parameters if value is not None]
    if len(known) < len(parameters):
        return "a parameter of the camera is not a number"
    return ColmapCamera(identity, fields[1], columns, rows, tuple(known))


def _image(line: str, keypoints: str) -> ColmapImage | _KeypointFault | str:
    fields = line.split(maxsplit=_IMAGE_FIELDS - 1)
    if len(fields) < _IMAGE_FIELDS:
        return f"this line has {len(fields)} fields; write ID QW QX QY QZ TX TY TZ CAMERA NAME"
    identity, camera = whole_number(fields[0]), whole_number(fields[8])
    pose = [decimal_number(field) for field in fields[1:8]]
    known = [value for value in pose if value is not None]
    if identity is None or camera is None or len(known) < len(pose):
        return "the ID and the camera of an image are whole numbers, its pose is 7 numbers"
    texts = keypoints.split()
    if len(texts) % 3:
        return _KeypointFault(
            f"this line has {len(texts)} fields; write COLUMN ROW POINT for each keypoint, or nothing"
        )
    values = _numbers(texts)
    table = values.reshape(-1, 3)
    impossible = ~np.isfinite(values)
    impossible[2::3] |= (np.abs(table[:, 2]) > _LARGEST_WHOLE) | (table[:, 2] != np.floor(table[:, 2]))
    if impossible.any():
        place = int(np.flatnonzero(impossible)[0])
        what = "whole number" if place % 3 == 2 else "number"
        return _KeypointFault(f"{shown_token(texts[place])} is not a {what}", _column(keypoints, place))
    return ColmapImage(
        identity, tuple(known), camera, fields[9].strip(), table[:, :2].copy(), table[:, 2].astype(np.int64)
    )


def _impossible_points(
    head: FloatArray, track: FloatArray, numbers: Sequence[int], starts: IntArray, shown: str
) -> list[Complaint]:
    """Return complaints about ids, colours and tracks that are not whole numbers within their limits."""
    with np.errstate(invalid="ignore"):
        whole = np.isfinite(head) & (np.abs(head) <= _LARGEST_WHOLE) & (head == np.floor(head))
        colours = whole[:, 4:7] & (head[:, 4:7] >= 0) & (head[:, 4:7] <= 255)
        fit = whole[:, 0] & colours.all(axis=1)
        rays = np.isfinite(track) & (np.abs(track) <= _LARGEST_WHOLE) & (track == np.floor(track))
    line_of_ray = np.repeat(np.arange(len(numbers)), np.diff(starts))
    fit[line_of_ray[~rays]] = False
    message = "the ID of a point, its colours (0 to 255) and its track are whole numbers"
    return [Complaint(message, shown, numbers[row]) for row in np.flatnonzero(~fit)[:MOST_COMPLAINTS]]


def _numbers(texts: Sequence[str]) -> FloatArray:
    """Return texts as numbers; NaN for what is none."""
    try:
        return np.array(texts, dtype=np.float64)
    except ValueError:
        return np.array([math.nan if (value := decimal_number(text)) is None else value for text in texts])


def _field_faults(
    texts: Sequence[str], values: FloatArray, starts: Sequence[int], numbers: Sequence[int], shown: str
) -> list[Complaint]:
    """Return complaints about fields that are not numbers; line n has the fields from starts[n] on."""
    if np.isfinite(values).all():
        return []
    faults = []
    for number, (start, end) in zip(numbers, pairwise(starts), strict=True):
        bad = np.flatnonzero(~np.isfinite(values[start:end]))
        if bad.size:
            faults.append(Complaint(f"{shown_token(texts[start + int(bad[0])])} is not a number", shown, number))
        if len(faults) > MOST_COMPLAINTS:
            break
    return faults


def decimal_number(text: str) -> float | None:
    """Return the finite number that a field is; None if it is none."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def whole_number(text: str) -> int | None:
    """Return the whole number that a field is; None if it is none."""
    return int(text) if _WHOLE.fullmatch(text) else None


def _column(line: str, place: int) -> int:
    """Return the column, from 1, in which a field begins."""
    at = 0
    for field in line.split()[: place + 1]:
        at = line.index(field, at) + len(field)
    return at - len(field) + 1
