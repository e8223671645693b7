"""Writing a measurement log (.MEA) while it is being measured: every measurement is on the disk before the next one.

What one command measures is a chapter at the end of the file: a comment, and below it one block for each photo or
template. With every measurement the file is replaced as a whole, so that whoever reads it, or finds it after the
machine went down, has a log that can be replayed, with everything that was measured until then.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal, Protocol

from orip.files.text.atomic import replace_text, reporting_failure, require_no_link
from orip.files.text.lines import existing_text
from orip.records.observations.measurement import TransformationKind
from orip.records.project.photo import Stage

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


def template_header(template: str, kind: TransformationKind, stage: Stage) -> str:
    """Return the first line of a block of tick marks."""
    return f"TEMPLATE {template} {kind} {stage}"


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
