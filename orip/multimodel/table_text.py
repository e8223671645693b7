"""The drive table's text, BUNDLE.DRV: written and read without loss, and refused if a byte of it changed."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Iterator, Mapping
from typing import NamedTuple, TypeVar
from urllib.parse import quote, unquote

from orip.files.text.shown import printable, shown_token
from orip.records.camera import AdditionalSet, DistortionArgument, Projection
from orip.records.drive_table import (
    STAGES,
    DriveCamera,
    DriveCode,
    DriveFault,
    DriveModel,
    DriveParameterSet,
    DrivePhoto,
    DriveTable,
    DriveTemplate,
    Optics,
    PlateUnit,
    StageLimits,
)
from orip.records.photo import Stage

Word = TypeVar("Word", bound=str)
Record = TypeVar("Record")

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WHOLE = re.compile(r"[1-9][0-9]{0,8}")
_UNITS = re.compile(r"UNITS PLATE (mm|px) PHOTO mm OBJECT (\S.*)")
_OPTICS: tuple[Optics, ...] = ("NORMAL", "SWAPPED")
_SETS: tuple[AdditionalSet, ...] = ("EBNER", "GRUEN")
_NOBODY = "-"
_PRINTABLE = " !\"#$&'()*+,-./:;<=>?@[\\]^_`{|}~"
"""Besides letters and digits; not the percent sign, which begins a code."""

_ARGUMENTS: dict[str, DistortionArgument] = {"IDEAL": "ideal", "MEASURED": "measured"}
_PROJECTIONS: dict[str, Projection] = {"PERSPECTIVE": "perspective", "EQUIDISTANT": "equidistant"}


def user_text(user: str) -> str:
    """Return the name of a user as the table has it: percent-encoded (RFC 3986) where it is not printable ASCII."""
    if user in ("", _NOBODY):
        return f"%{ord(_NOBODY):X}" if user else _NOBODY
    return quote(user, safe=_PRINTABLE)


def user_of(text: str) -> str:
    """Return the name that `user_text` has written."""
    return "" if text == _NOBODY else unquote(text)


class TableLines:
    """Reads the lines before END.

    Parameters
    ----------
    lines : list of str
        Without their line ends; what was not ASCII stands as U+FFFD.
    """

    def __init__(self, lines: list[str]) -> None:
        self.faults: list[DriveFault] = []
        self._lines = lines
        self._next = 0
        self._words: list[str] = []

    def table(self) -> DriveTable:
        """Return the table; it means something only if there are no faults."""
        self._literal("ORIPDRIVE 3")
        block, project, user = self._text("BLOCK"), self._text("PROJECT"), user_of(self._text("USER"))
        plate_unit, object_unit = self._units()
        upper, lower = self._limits("UPPER"), self._limits("LOWER")
        cameras = self._cameras()
        templates = self._templates()
        photos = self._photos()
        models = self._models()
        start = self._start()
        if self._next < len(self._lines):
            self._next += 1
            self._format_fault("this line is out of order, or of no kind that is known here")
        return DriveTable(
            block, project, user, plate_unit, object_unit, upper, lower, cameras, templates, photos, models, start
        )

    def _cameras(self) -> tuple[DriveCamera, ...]:
        cameras: dict[str, tuple[Projection, list[float]]] = {}
        while self._starts("CAMERA", 8):
            projection = _PROJECTIONS.get(self._word(2, tuple(_PROJECTIONS)), "perspective")
            self._once(cameras, "camera", self._words[1], (projection, self._floats(3)))
        distortions: dict[str, tuple[DistortionArgument, list[float]]] = {}
        while self._starts("DISTORTION", 12):
            argument = _ARGUMENTS.get(self._word(2, tuple(_ARGUMENTS)), "ideal")
            self._once(distortions, "distortion of camera", self._words[1], (argument, self._floats(3)))
        sets: dict[str, DriveParameterSet] = {}
        while self._starts("SET", None):
            base, *values = self._floats(3)
            parameters = DriveParameterSet(self._word(2, _SETS), base, tuple(values))
            self._once(sets, "set of camera", self._words[1], parameters)
        self._same("camera", "DISTORTION", cameras, distortions)
        self._known("SET", "camera", sets, cameras)
        return tuple(
            DriveCamera(
                name,
                (*first[:3], *distortions[name][1]),
                (first[3], first[4]),
                distortions[name][0],
                sets.get(name),
                projection,
            )
            for name, (projection, first) in cameras.items()
            if name in distortions
        )

    def _templates(self) -> tuple[DriveTemplate, ...]:
        templates: dict[str, DriveTemplate] = {}
        while self._starts("TEMPLATE", 3):
            name = self._words[1]
            self._once(templates, "template", name, DriveTemplate(name, self._word(2, STAGES)))
        return tuple(templates.values())

    def _photos(self) -> tuple[DrivePhoto, ...]:
        heads: dict[str, tuple[str, str | None, Stage, list[float]]] = {}
        while self._starts("PHOTO", 17):
            _, name, camera, template, *_ = self._words
            head = camera, None if template == "-" else template, self._word(4, STAGES), self._floats(5)
            self._once(heads, "photo", name, head)
        affines: dict[str, list[float]] = {}
        while self._starts("AFFINE", 8):
            self._once(affines, "affine of photo", self._words[1], self._floats(2))
        self._same("photo", "AFFINE", heads, affines)
        return tuple(
            DrivePhoto(
                name, camera, template, stage, (numbers[0], numbers[1], numbers[2]), tuple(numbers[3:]),
                tuple(affines[name]),
            )
            for name, (camera, template, stage, numbers) in heads.items()
            if name in affines
        )  # fmt: skip

    def _models(self) -> tuple[DriveModel, ...]:
        models: dict[str, DriveModel] = {}
        while self._starts("MODEL", 7):
            _, name, _, _, left, right, _ = self._words
            model = DriveModel(name, self._whole(2), self._whole(3), left, right, self._word(6, _OPTICS))
            self._once(models, "model", name, model)
        return tuple(models.values())

    def _start(self) -> tuple[float, float, float]:
        if not self._starts("START", 4):
            self._missing("START <X> <Y> <Z>")
            return math.nan, math.nan, math.nan
        x, y, z = self._floats(1)
        return x, y, z

    def _limits(self, stage: Stage) -> StageLimits:
        form = f"STAGE {stage} <x min> <x max> <y min> <y max> <least count>"
        if not self._starts(f"STAGE {stage}", 7):
            self._missing(form)
            return StageLimits(*(math.nan,) * 5)
        return StageLimits(*self._floats(2))

    def _units(self) -> tuple[PlateUnit, str]:
        match = _UNITS.fullmatch(self._peek())
        if match is None:
            self._missing("UNITS PLATE mm|px PHOTO mm OBJECT <ground unit>")
            return "mm", ""
        self._take()
        return ("px" if match.group(1) == "px" else "mm"), match.group(2)

    def _literal(self, line: str) -> None:
        if self._peek() == line:
            self._take()
        else:
            self._missing(line)

    def _text(self, keyword: str) -> str:
        """Return what stands after a keyword, blanks and all."""
        if not self._peek().startswith(f"{keyword} "):
            self._missing(f"{keyword} <name>")
            return ""
        self._take()
        return self._lines[self._next - 1].removeprefix(f"{keyword} ")

    # one line

    def _peek(self) -> str:
        return self._lines[self._next] if self._next < len(self._lines) else ""

    def _take(self) -> None:
        line = self._lines[self._next]
        self._words = line.split(" ")
        self._next += 1
        if not (line.isascii() and line.isprintable()):
            self._format_fault("a character is not printable ASCII")

    def _starts(self, start: str, count: int | None) -> bool:
        """Take the next line if it starts so; without the right number of words (None: 4 or more) it is skipped."""
        while self._peek().startswith(f"{start} "):
            self._take()
            if len(self._words) == count or (count is None and len(self._words) >= 4):
                return True
            wanted = "4 or more" if count is None else count
            self._format_fault(f"{len(self._words)} words separated by single blanks; {wanted} are needed")
        return False

    def _word(self, index: int, allowed: tuple[Word, ...]) -> Word:
        for word in allowed:
            if self._words[index] == word:
                return word
        self._format_fault(f"'{shown_token(self._words[index])}' is not one of {', '.join(allowed)}")
        return allowed[0]

    def _whole(self, index: int) -> int:
        if _WHOLE.fullmatch(self._words[index]):
            return int(self._words[index])
        self._format_fault(f"'{shown_token(self._words[index])}' is not a whole number from 1")
        return 1

    def _floats(self, first: int) -> list[float]:
        """Return the words from one on as numbers."""
        return [self._float(word) for word in self._words[first:]]

    def _float(self, word: str) -> float:
        value = float(word) if _NUMBER.fullmatch(word) else math.nan
        if not math.isfinite(value):
            self._format_fault(f"'{shown_token(word)}' is not a finite number")
        return value

    # what is wrong

    def _once(self, records: dict[str, Record], what: str, name: str, record: Record) -> None:
        if name in records:
            self._fault(DriveCode.TABLE_INCONSISTENT, f"line {self._next}: {what} {name} is there twice")
        records[name] = record

    def _same(self, what: str, keyword: str, records: Mapping[str, object], others: Mapping[str, object]) -> None:
        for name in records:
            if name not in others:
                self._fault(DriveCode.TABLE_INCONSISTENT, f"{what} {name} has no line {keyword}")
        self._known(keyword, what, others, records)

    def _known(self, keyword: str, what: str, names: Mapping[str, object], records: Mapping[str, object]) -> None:
        for name in names:
            if name not in records:
                self._fault(DriveCode.TABLE_INCONSISTENT, f"{keyword} of {what} {name}, which is not in the table")

    def _missing(self, form: str) -> None:
        self._fault(DriveCode.TABLE_FORMAT, f"line {self._next + 1} is not: {form}")

    def _format_fault(self, text: str) -> None:
        self._fault(DriveCode.TABLE_FORMAT, f"line {self._next}: {text}")

    def _fault(self, code: DriveCode, text: str) -> None:
        self.faults.append(DriveFault(code, printable(text)))


# ORIPDRIVE 3
#     BLOCK <bundle>
#     PROJECT <project>
#     USER <user, percent-encoded where it is not ASCII; - for none>
#     UNITS PLATE mm|px PHOTO mm OBJECT <ground unit>
#     STAGE UPPER <x min> <x max> <y min> <y max> <least count>
#     STAGE LOWER …
#     CAMERA <name> PERSPECTIVE|EQUIDISTANT <C> <DX> <DY> <FX> <FY>
#     DISTORTION <camera> IDEAL|MEASURED <A1> <A3> <A5> <A7> <A9> <P1> <P2> <B1> <B2>
#     SET <camera> EBNER|GRUEN <base> <values>
#     TEMPLATE <name> UPPER|LOWER
#     PHOTO <name> <camera> <template or -> UPPER|LOWER <X0> <Y0> <Z0> <r11> <r12> <r13> <r21> … <r33>
#     AFFINE <photo> <a0> <a1> <a2> <b0> <b1> <b2>
#     MODEL <name> <row> <column> <left photo> <right photo> NORMAL|SWAPPED
#     START <X> <Y> <Z>
#     END <number of lines before this> <CRC-32 of all bytes before this line>
#
# The kinds of lines come in this order, words are separated by single blanks, lines end in LF, and all is ASCII. Here
# only the form is read; whether the parts agree is for `orip.multimodel.processor`.


MOST_LINES = 100_000
LONGEST_LINE = 4096
"""Bytes; the longest line, of a set of 44 parameters with 24 characters each, has some 1100."""

MOST_BYTES = 64 * 1024 * 1024

_END = re.compile(rb"END (0|[1-9][0-9]*) ([0-9a-f]{8})\n")


class ReadTable(NamedTuple):
    """A table that was read, or None and why not: one fault or several, each with its code."""

    table: DriveTable | None
    faults: tuple[DriveFault, ...]


def drive_table_text(table: DriveTable) -> str:
    """Return the text of a table; reading it gives an equal table."""
    lines = list(_lines(table))
    body = "".join(f"{line}\n" for line in lines)
    return f"{body}END {len(lines)} {zlib.crc32(body.encode('ascii')):08x}\n"


def read_drive_table(data: bytes) -> ReadTable:
    """Read a table from the bytes of its text."""
    fault = _size_fault(data) or _damage(data)
    if fault is not None:
        return ReadTable(None, (fault,))
    lines = data.decode("ascii", errors="replace").split("\n")[:-2]
    reader = TableLines(lines)
    table = reader.table()
    return ReadTable(None if reader.faults else table, tuple(reader.faults))


def _size_fault(data: bytes) -> DriveFault | None:
    if len(data) > MOST_BYTES:
        return DriveFault(DriveCode.TABLE_TOO_LARGE, f"{len(data)} bytes; at most {MOST_BYTES} are read")
    lines = data.split(b"\n")
    if len(lines) - 1 > MOST_LINES:
        return DriveFault(DriveCode.TABLE_TOO_LARGE, f"{len(lines) - 1} lines; at most {MOST_LINES} are read")
    for number, line in enumerate(lines, start=1):
        if len(line) > LONGEST_LINE:
            text = f"line {number} has {len(line)} bytes; at most {LONGEST_LINE} are read"
            return DriveFault(DriveCode.TABLE_TOO_LARGE, text)
    return None


def _damage(data: bytes) -> DriveFault | None:
    """Say whether the text is not what was written, by its last line."""
    start = data.rfind(b"\n", 0, max(len(data) - 1, 0)) + 1
    end = _END.fullmatch(data, start)
    if end is None:
        return DriveFault(DriveCode.TABLE_DAMAGED, "the last line is not END with the number of lines and the CRC-32")
    found, stated = data.count(b"\n", 0, start), int(end.group(1))
    if found != stated:
        return DriveFault(DriveCode.TABLE_DAMAGED, f"{found} lines before END, which states {stated}")
    crc = b"%08x" % zlib.crc32(data[:start])
    if crc != end.group(2):
        text = f"the CRC-32 is {crc.decode()}, END states {end.group(2).decode()}; the text is damaged or was edited"
        return DriveFault(DriveCode.TABLE_DAMAGED, text)
    return None


def _lines(table: DriveTable) -> Iterator[str]:
    yield "ORIPDRIVE 3"
    yield f"BLOCK {table.block}"
    yield f"PROJECT {table.project}"
    yield f"USER {user_text(table.user)}"
    yield f"UNITS PLATE {table.plate_unit} PHOTO mm OBJECT {table.object_unit}"
    yield f"STAGE UPPER {_limits(table.upper)}"
    yield f"STAGE LOWER {_limits(table.lower)}"
    for camera in table.cameras:
        yield f"CAMERA {camera.name} {camera.projection.upper()} {_numbers(*camera.parameters[:3], *camera.frame)}"
    for camera in table.cameras:
        yield f"DISTORTION {camera.name} {camera.distortion_at.upper()} {_numbers(*camera.parameters[3:])}"
    for camera in table.cameras:
        yield from _set(camera)
    for template in table.templates:
        yield f"TEMPLATE {template.name} {template.stage}"
    for photo in table.photos:
        yield _photo(photo)
    for photo in table.photos:
        yield f"AFFINE {photo.name} {_numbers(*photo.affine)}"
    for model in table.models:
        yield _model(model)
    yield f"START {_numbers(*table.start)}"


def _limits(limits: StageLimits) -> str:
    return _numbers(limits.x_min, limits.x_max, limits.y_min, limits.y_max, limits.least_count)


def _set(camera: DriveCamera) -> Iterator[str]:
    if camera.additional is not None:
        parameters = camera.additional
        yield f"SET {camera.name} {parameters.name} {_numbers(parameters.base, *parameters.values)}"


def _photo(photo: DrivePhoto) -> str:
    numbers = _numbers(*photo.centre, *photo.rotation)
    return f"PHOTO {photo.name} {photo.camera} {photo.template or '-'} {photo.stage} {numbers}"


def _model(model: DriveModel) -> str:
    return f"MODEL {model.name} {model.row} {model.column} {model.left} {model.right} {model.optics}"


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.17g}" for value in values)
