"""Writing a measurement log while it is measured, EDITS.MEA, and lists of points to digitise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from msgspec import Struct

from orip.errors import Complaint
from orip.files.log.blocks import ACTIONS, BLOCK_KINDS
from orip.files.text.atomic import replace_text, reporting_failure, require_no_link
from orip.files.text.lines import TextLine, existing_text, field_lines, field_name_fault, read_lines
from orip.files.text.shown import Parsed, shown_token
from orip.records.measurement import EditRecord, TransformationKind
from orip.records.photo import Stage

# What one command measures is a chapter at the end of the file: a comment, and below it one block for each photo or
# template. With every measurement the file is replaced as a whole, so that whoever reads it, or finds it after the
# machine went down, has a log that can be replayed, with everything that was measured until then.

DECIMALS = 4
"""Decimals of what is measured: a tenth of a micrometre, or of a thousandth of a pixel."""


class Log(Protocol):
    """Where measurements go."""

    def chapter(self, title: str) -> None:
        """Begin a chapter."""

    def put(self, header: str, lines: Iterable[str]) -> None:
        """Put a block in the place of the chapter's one with that header; without lines there is none."""

    def edit(self, line: str) -> None:
        """Write an edit after everything measured so far."""


class NoLog:
    """A log that nothing is written to, for a rehearsal."""

    def chapter(self, title: str) -> None:
        """Begin no chapter."""

    def put(self, header: str, lines: Iterable[str]) -> None:
        """Put nothing."""

    def edit(self, line: str) -> None:
        """Edit nothing."""


class LogFile:
    """A log in a file.

    Parameters
    ----------
    path : Path
        Need not exist.
    shown : str
        The file as the user would name it.
    heading : str
        A comment that a new file begins with; empty: none.

    Raises
    ------
    InputError
        If the file is there and cannot be read, or is not UTF-8.
    OripError
        If it is a link.
    """

    def __init__(self, path: Path, shown: str, heading: str = "") -> None:
        self._path, self._shown = path, shown
        with reporting_failure(shown, "name another log"):
            require_no_link(path)
        self._before = self._written = self._read()
        self._heading = f"! {heading}\n" if heading else ""
        self._chapter = "! digitised"
        self._blocks: dict[str, tuple[str, ...]] = {}

    def chapter(self, title: str) -> None:
        """Begin a chapter; it is written with its first measurement."""
        self._before = self._text()
        self._chapter = f"! {title}"
        self._blocks = {}

    def put(self, header: str, lines: Iterable[str]) -> None:
        """Put a block in the place of the chapter's one with that header, and write.

        Raises
        ------
        OripError
            If the file cannot be written; it is unchanged then.
        """
        self._catch_up()
        self._blocks[header] = tuple(lines)
        self._write()

    def edit(self, line: str) -> None:
        """Write an edit after everything measured so far; a new block begins after it."""
        self._catch_up()
        self._before = _ended(self._text()) + f"{line}\n"
        self._blocks = {}
        self._write()

    def _text(self) -> str:
        blocks = ["\n".join([header, *lines]) for header, lines in self._blocks.items() if lines]
        if not blocks:
            return self._before
        before = self._before or self._heading
        gap = "\n" if before else ""
        return _ended(before) + gap + "\n".join([self._chapter, *blocks]) + "\n"

    def _catch_up(self) -> None:
        """Keep what another process has written to the file: the whole chapter then follows it."""
        found = self._read()
        if found != self._written:
            self._before = self._written = found

    def _write(self) -> None:
        text = self._text()
        with reporting_failure(self._shown, "the file is unchanged since before this mark"):
            replace_text(self._path, text)
        self._written = text

    def _read(self) -> str:
        return existing_text(self._path, self._shown) or ""


def template_header(template: str, kind: TransformationKind, stage: Stage | None) -> str:
    """Return the first line of a block of tick marks."""
    return " ".join(["TEMPLATE", template, kind, *([] if stage is None else [stage])])


def photo_header(photo: str, kind: TransformationKind) -> str:
    """Return the first line of a block of fiducial marks."""
    return f"PHOTO {photo} {kind}"


def fiducials_header(camera: str, arrangement: Literal["corners", "midsides"]) -> str:
    """Return the first line of a block of digitised fiducial marks of a camera."""
    return f"FIDUCIALS {camera} {arrangement}"


def ticks_header(temtick: str) -> str:
    """Return the first line of a block of digitised tick marks of a temtick record."""
    return f"TICKS {temtick}"


def points_header(bundle: str, photo: str) -> str:
    """Return the first line of a block of photo points."""
    return f"POINTS {bundle} {photo}"


def measurement_line(
    name: str,
    xy: tuple[float, float],
    given: tuple[float, float] | None = None,
    *,
    is_disregarded: bool = False,
    decimals: int = DECIMALS,
) -> str:
    """Return the line of a measurement, plate mm or pixels; `given` are a mark's own coordinates.

    Decimals beyond the usual ones are written where they are not zero.
    """
    own = "" if given is None else f" = {given[0]:z.10g} {given[1]:z.10g}"
    x, y = (_with_decimals(value, decimals) for value in xy)
    return f"  {name:<8} {x:>11} {y:>11}{own}{' -' if is_disregarded else ''}"


def _with_decimals(value: float, decimals: int) -> str:
    text = f"{value:z.{decimals}f}"
    beyond = decimals - DECIMALS
    return f"{text[:-beyond]}{text[-beyond:].rstrip('0')}" if beyond else text


def kill_line(bundle: str, photo: str, point: str) -> str:
    """Return the edit that deletes what was measured of a point in a photo."""
    return f"KILL POINT {bundle} {photo} {point}"


def _ended(text: str) -> str:
    """Return the text so that a line can follow."""
    return text if not text or text.endswith(("\n", "\r")) else f"{text}\n"


HEADING = "! Edits and repeated measurements; replayed after all other measurement files."


class EditsText(Struct, frozen=True):
    """EDITS.MEA as it was read.

    Parameters
    ----------
    shown : str
        The file as the user would name it.
    text : str or None
        None: there is no such file yet.
    """

    path: Path
    shown: str
    text: str | None

    @property
    def line_count(self) -> int:
        """Return how many lines the file will have before what is appended: its own, or those of its heading."""
        return len(self._lines_end().splitlines())

    def digest_with(self, lines: Sequence[str]) -> str:
        """Return the SHA-256 of the file with lines appended."""
        return sha256(self.text_with(lines).encode()).hexdigest()

    @property
    def digest(self) -> str | None:
        """Return the SHA-256 of the file as it was read; None if there was none."""
        return None if self.text is None else sha256(self.text.encode()).hexdigest()

    def text_with(self, lines: Sequence[str]) -> str:
        """Return the text with lines appended; what is there stays to the letter."""
        return self._lines_end() + "".join(f"{line}{self._line_end}" for line in lines)

    def _lines_end(self) -> str:
        """Return the text so that a line can follow."""
        if self.text is None:
            return f"{HEADING}\n"
        return self.text if not self.text or self.text.endswith(("\n", "\r")) else self.text + self._line_end

    @property
    def _line_end(self) -> str:
        return "\r\n" if "\r\n" in (self.text or "") else "\n"


def read_edits(path: Path, shown: str) -> EditsText:
    """Read EDITS.MEA as it stands.

    Raises
    ------
    InputError
        If it cannot be read or is not UTF-8.
    """
    return EditsText(path, shown, existing_text(path, shown))


def edit_line(record: EditRecord) -> str:
    """Return the line of an edit, such as ``DISREGARD POINT MAIN P101 1001``."""
    bundle = [record.bundle] if record.bundle is not None else []
    new_name = [record.new_name] if record.new_name is not None else []
    return " ".join([record.action, record.what, *bundle, record.owner, record.name, *new_name])


# 1001                      a point, wherever it is to be found
#     POINTS MAIN P101          what follows is meant in that photo
#       1002   ! predicted 1.2 3.4
#       1003   35.2310  -12.0040
#
# What follows a name is ignored, as are blocks of templates and photos, and edits.

_POINTS = "POINTS"


class ListedPoint(NamedTuple):
    """A point, and where it is meant if the list says so; `line` is where it stands."""

    point: str
    photo: str | None
    bundle: str | None
    line: int


def read_work_list(path: Path, shown: str) -> Parsed[tuple[ListedPoint, ...]]:
    """Read a list of points.

    Parameters
    ----------
    shown : str
        The file as the user would name it.
    """
    text = read_lines(path, shown)
    listed = work_list(field_lines(text.value), shown)
    return Parsed(listed.value, (*text.complaints, *listed.complaints))


def work_list(lines: Iterable[TextLine], shown: str) -> Parsed[tuple[ListedPoint, ...]]:
    """Return the points of lines."""
    points: list[ListedPoint] = []
    complaints: list[Complaint] = []
    bundle: str | None = None
    photo: str | None = None
    counts = True
    for line in lines:
        words = [field.text for field in line.fields]
        keyword = words[0].upper()
        if keyword in ACTIONS:
            continue
        if keyword in BLOCK_KINDS and len(words) > 1:
            counts = keyword == _POINTS
            if counts and len(words) != 3:
                complaints.append(Complaint(f"write POINTS bundle photo, not {len(words)} words", shown, line.number))
            bundle, photo = words[1], words[-1]
            continue
        fault = field_name_fault(words[0])
        if fault is not None:
            complaints.append(Complaint(f"{shown_token(words[0])}: {fault}", shown, line.number))
        elif counts:
            points.append(ListedPoint(words[0], photo, bundle, line.number))
    return Parsed(tuple(points), tuple(complaints))
