"""Stereo measurements as text (.STE): features, below each its vertices in two photos; read and written."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from orip.errors import Complaint, InputError, OripError
from orip.files.log.writing import DECIMALS
from orip.files.text.atomic import replace_text, reporting_failure, require_no_link
from orip.files.text.lines import FieldReader, TextLine, existing_text, field_lines, field_name_fault, read_lines
from orip.files.text.shown import Parsed
from orip.records.measurement import FEATURE_KINDS, LEAST_VERTICES, FeatureKind, StereoFeature, StereoVertex
from orip.records.names import record_key
from orip.structs import replace

# LINE ROAD 17
#   101  1234.5000  987.2500   102  910.2000  985.7500
#   101  1260.1000  990.0000   102  935.9000  988.2500  0.3
# POINT TREE 4
#   101  1500.0000  412.0000   102  1177.5000  409.7500

HEADER_FIELDS = 3
HEADER_FORM = "POINT, LINE or AREA, then code and name"

_VERTEX_FIELDS = (6, 7)
_VERTEX_FORM = "left photo, x, y, right photo, x, y, and an error of its own if it has one"


def feature_header(kind: FeatureKind, code: str, name: str) -> str:
    """Return the first line of a feature."""
    return f"{kind} {code} {name}"


def vertex_line(vertex: StereoVertex) -> str:
    """Return the line of a vertex."""
    (x1, y1), (x2, y2) = vertex.left_xy, vertex.right_xy
    left = f"{vertex.left:<8} {x1:z11.{DECIMALS}f} {y1:z11.{DECIMALS}f}"
    right = f"{vertex.right:<8} {x2:z11.{DECIMALS}f} {y2:z11.{DECIMALS}f}"
    return f"  {left}  {right}" + ("" if vertex.error is None else f"  {vertex.error:g}")


def read_stereo(path: Path, shown: str, *, is_growing: bool = False) -> Parsed[tuple[StereoFeature, ...]]:
    """Read stereo measurements; complaints about all that is wrong in the file.

    Parameters
    ----------
    shown : str
        The file as the user would name it.
    is_growing : bool
        It may be absent, and its last feature may lack vertices: they are still to be measured.
    """
    text = read_lines(path, shown, may_be_absent=is_growing)
    complaints: list[Complaint] = list(text.complaints)
    features: list[StereoFeature] = []
    by_feature = list(lines_by_feature(field_lines(text.value)))
    for lines in by_feature:
        head = FieldReader(lines[0], shown)
        feature = read_header(head)
        vertices = []
        for line in lines[1:] if feature is not None else lines[1:0]:
            reader = FieldReader(line, shown)
            vertex = _read_vertex(reader)
            complaints += reader.complaints
            if vertex is not None:
                vertices.append(vertex)
        is_open = is_growing and lines is by_feature[-1]
        if (
            feature is not None
            and not head.complaints
            and len(lines) - 1 < LEAST_VERTICES[feature.kind]
            and not is_open
        ):
            least = LEAST_VERTICES[feature.kind]
            head.complain(f"this {feature.kind} has {len(lines) - 1} of at least {least} vertices; measure the others")
        complaints += head.complaints
        if feature is not None:
            features.append(replace(feature, vertices=tuple(vertices)))
    complaints += repeated_features([(one.code, one.name, one.line) for one in features], shown)
    return Parsed(tuple(features), tuple(complaints))


def lines_by_feature(lines: Iterable[TextLine]) -> Iterator[list[TextLine]]:
    """Yield the lines of each feature, its header first."""
    found: list[TextLine] = []
    for line in lines:
        if found and _is_header(line):
            yield found
            found = []
        found.append(line)
    if found:
        yield found


def _is_header(line: TextLine) -> bool:
    """Tell whether a line begins a feature; a photo may be called as a kind is, and vertices have more fields."""
    return line.fields[0].text.upper() in FEATURE_KINDS and len(line.fields) not in _VERTEX_FIELDS


def read_header(reader: FieldReader) -> StereoFeature | None:
    """Return a feature without vertices; None, and complaints kept, where the line is none."""
    kind = reader.word(0, FEATURE_KINDS, "the beginning of a feature")
    if kind is None or not reader.has_fields((HEADER_FIELDS,), HEADER_FORM):
        return None
    return StereoFeature(kind, reader.name(1), reader.name(2), (), reader.number)


def repeated_features(named: Sequence[tuple[str, str, int]], shown: str) -> Iterator[Complaint]:
    """Yield complaints about features (code, name, line) that have the code and name of another one."""
    first: dict[tuple[str, str], int] = {}
    for code, name, line in named:
        before = first.setdefault((record_key(code), name), line)
        if before != line:
            yield Complaint(f"{code} {name} is already on line {before}; give one of them another name", shown, line)


def _read_vertex(reader: FieldReader) -> StereoVertex | None:
    if not reader.has_fields(_VERTEX_FIELDS, _VERTEX_FORM):
        return None
    left, right = reader.name(0), reader.name(3)
    x1, y1, x2, y2 = (reader.decimal(index) for index in (1, 2, 4, 5))
    error = reader.decimal(6) if reader.count == _VERTEX_FIELDS[1] else None
    if error is not None and not math.isnan(error) and not error > 0.0:
        reader.complain("the error of a measurement is above 0", 6)
    if record_key(left) == record_key(right):
        reader.complain("left and right are one photo; a vertex is measured in two", 3)
    return StereoVertex(left, (x1, y1), right, (x2, y2), error, reader.number)


# With every vertex the file is replaced as a whole: whoever reads it, or finds it after the machine went down, has all
# that was acknowledged and no half line. A line that was not finished is the last feature of the file, and goes on.

_HEADING = "! Measured in stereo: feature, below it left photo x y, right photo x y of each vertex\n"


class StereoFile:
    """A file of stereo measurements that grows; what others write to it meanwhile stays.

    Parameters
    ----------
    path : Path
        Need not exist.
    shown : str
        The file as the user would name it.

    Raises
    ------
    InputError
        With all that is wrong in the file.
    OripError
        If it is a link.
    """

    def __init__(self, path: Path, shown: str) -> None:
        self._path, self.shown = path, shown
        with reporting_failure(shown, "name another file"):
            require_no_link(path)
        self._text: str | None = None
        self._lengths: list[tuple[int, bool]] = []
        self.features: list[StereoFeature] = []
        self._catch_up()

    @property
    def unfinished(self) -> StereoFeature | None:
        """Return the last feature if it lacks vertices."""
        last = self.features[-1] if self.features else None
        return last if last is not None and len(last.vertices) < LEAST_VERTICES[last.kind] else None

    def put(self, kind: FeatureKind, code: str, name: str, vertex: StereoVertex) -> StereoFeature:
        """Write a vertex of a feature, which is the last one of the file or a new one, and return the feature.

        Raises
        ------
        OripError
            If code or name cannot be, or the feature cannot go on, or the file cannot be written: it is unchanged then.
        """
        self._catch_up()
        last = self.features[-1] if self.features else None
        goes_on = last is not None and (last.kind, last.code, last.name) == (kind, code, name)
        if last is None or not goes_on or kind == "POINT":
            self._require_new(kind, code, name)
            goes_on, last = False, StereoFeature(kind, code, name, ())
        before = self._text or ""
        start = before if before.endswith("\n") or not before else f"{before}\n"
        header = "" if goes_on else f"{feature_header(kind, code, name)}\n"
        self._write(f"{start or _HEADING}{header}{vertex_line(vertex)}\n")
        self._lengths.append((len(before), goes_on))
        grown = replace(last, vertices=(*last.vertices, vertex))
        self.features[len(self.features) - goes_on :] = [grown]
        return grown

    def undo(self) -> StereoFeature:
        """Take back the vertex that was written last, and return its feature with it.

        Raises
        ------
        OripError
            If this run has written none that is left, or another program has changed the file since.
        """
        self._catch_up()
        if not self._lengths:
            message = f"nothing that was measured in this run is left; edit {self.shown} by hand"
            raise OripError(message)
        length, went_on = self._lengths[-1]
        self._write((self._text or "")[:length])
        self._lengths.pop()
        taken = self.features.pop()
        if went_on:
            self.features.append(replace(taken, vertices=taken.vertices[:-1]))
        return taken

    def require_finished(self) -> None:
        """Refuse to leave the last feature if it lacks vertices.

        Raises
        ------
        OripError
        """
        if (last := self.unfinished) is not None:
            message = (
                f"{last.kind} {last.code} {last.name} has {len(last.vertices)} of at least {LEAST_VERTICES[last.kind]} "
                "vertices: measure the others, or undo"
            )
            raise OripError(message)

    def _require_new(self, kind: FeatureKind, code: str, name: str) -> None:
        for word in (code, name):
            if fault := field_name_fault(word):
                raise OripError(fault)
        if any((record_key(one.code), one.name) == (record_key(code), name) for one in self.features):
            message = f"{code} {name} is in {self.shown} already; give this {kind} another name"
            raise OripError(message)
        self.require_finished()

    def _catch_up(self) -> None:
        """Read what another program has written; what was measured before that is not undone any more."""
        found = existing_text(self._path, self.shown)
        if found == self._text:
            return
        read = read_stereo(self._path, self.shown, is_growing=True)
        if read.complaints:
            raise InputError(list(read.complaints))
        self._text, self.features, self._lengths = found, list(read.value), []

    def _write(self, text: str) -> None:
        with reporting_failure(self.shown, "the file is unchanged, and the vertex not recorded"):
            replace_text(self._path, text)
        self._text = text
