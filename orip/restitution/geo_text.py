"""Restituted features as text (.GEO): a line for each feature, below it one for each vertex."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from orip.errors import Complaint
from orip.files.log.stereo import lines_by_feature, read_header, repeated_features
from orip.files.text.lines import FieldReader, field_lines, read_lines
from orip.files.text.shown import Parsed
from orip.records.stereo import LEAST_VERTICES
from orip.restitution.feature import Feature, Stereo, Triple, Vertex

# LINE ROAD 17
#   X Y Z  sX sY sZ  left right py
#
# A vertex has its coordinates, then its standard deviations, then where it was measured, as far as that is known.

ENDING = ".GEO"

_COUNTS = (3, 6, 9)
_FORM = "X Y Z, then sX sY sZ, then left photo, right photo and y-parallax, as far as known"
_DECIMALS = 6
_HEADING = "! Restituted by orip: X Y Z  sX sY sZ (ground units)  left and right photo, y-parallax (mm)\n"


def read_features(path: Path, shown: str) -> Parsed[tuple[Feature, ...]]:
    """Read restituted features; a file that is absent has none.

    Parameters
    ----------
    shown : str
        The file as the user would name it.
    """
    text = read_lines(path, shown, may_be_absent=True)
    complaints: list[Complaint] = list(text.complaints)
    features: list[Feature] = []
    for lines in lines_by_feature(field_lines(text.value)):
        head = FieldReader(lines[0], shown)
        found = read_header(head)
        if found is not None:
            rows = [(reader, _read_vertex(reader)) for reader in (FieldReader(line, shown) for line in lines[1:])]
            vertices = tuple(vertex for _, vertex in rows if vertex is not None)
            least = LEAST_VERTICES[found.kind]
            if len(rows) < least:
                head.complain(f"this {found.kind} has {len(rows)} of at least {least} vertices; write the others")
            complaints += [complaint for reader, _ in rows for complaint in reader.complaints]
            place = lines[0].number, lines[-1].number
            features.append(Feature(found.kind, found.code, found.name, vertices, place))
        complaints += head.complaints
    complaints += repeated_features([(one.code, one.name, one.lines[0]) for one in features], shown)
    return Parsed(tuple(features), tuple(complaints))


def text_with(before: str | None, there: Sequence[Feature], new: Sequence[Feature]) -> str:
    """Return a text with new features, each in the place of the one with its code and name, else at the end.

    Parameters
    ----------
    before : str or None
        The text as it is; None: there is none yet.
    there : sequence of Feature
        As they were read from it.
    """
    lines = (before or _HEADING).splitlines(keepends=True)
    if lines and not lines[-1].endswith(("\n", "\r")):
        lines[-1] += "\n"
    replaced = {feature.key: feature.lines for feature in there}
    lines += [line for feature in new if feature.key not in replaced for line in _lines(feature)]
    for feature in sorted(new, key=lambda one: replaced.get(one.key, (0, 0)), reverse=True):
        if feature.key in replaced:
            first, last = replaced[feature.key]
            lines[first - 1 : last] = _lines(feature)
    return "".join(lines)


def _read_vertex(reader: FieldReader) -> Vertex | None:
    if not reader.has_fields(_COUNTS, _FORM):
        return None
    xyz = _triple(reader, 0)
    sd = _triple(reader, 3) if reader.count > _COUNTS[0] else None
    for index, value in enumerate(sd or (), start=3):
        if value < 0.0:
            reader.complain("a standard deviation is not below 0", index)
    stereo = None
    if reader.count == _COUNTS[2]:
        stereo = Stereo(reader.name(6), reader.name(7), reader.decimal(8))
    return Vertex(xyz, sd, stereo)


def _triple(reader: FieldReader, first: int) -> Triple:
    x, y, z = (reader.decimal(index) for index in range(first, first + 3))
    return x, y, z


def _lines(feature: Feature) -> Iterator[str]:
    yield f"{feature.kind} {feature.code} {feature.name}\n"
    for vertex in feature.vertices:
        cells = [f"{value:z14.{_DECIMALS}f}" for value in vertex.xyz]
        if vertex.sd is not None and all(map(math.isfinite, vertex.sd)):
            cells += [f"{value:10.{_DECIMALS}f}" for value in vertex.sd]
            if vertex.stereo is not None:
                cells += [f"{vertex.stereo.left:>8}", f"{vertex.stereo.right:>8}", f"{vertex.stereo.y_parallax:z9.4f}"]
        yield "  " + " ".join(cells) + "\n"
