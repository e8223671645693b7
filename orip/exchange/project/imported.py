"""`orip import`: a project of another program as a new project folder."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from msgspec import Struct

from orip.errors import Complaint, InputError, UsageError
from orip.exchange.format import Format
from orip.exchange.formats import FORMATS, FORMATS_READ, files_of_formats, format_named, guessed_source
from orip.exchange.project.block import ExchangeSettings, ImportedBlock, imported_block
from orip.exchange.project.exported import write_whole_folder
from orip.exchange.project.texts import ImportedTexts, ImportSource, imported_texts
from orip.exchange.sources.names import SOURCE_FILE, place_from
from orip.files.control.reader import read_control
from orip.files.log.text import read_measurements
from orip.files.project.file_names import IGNORE_FILE, IGNORED
from orip.files.project.reader import parse_project
from orip.files.project.toml_text import toml_table
from orip.files.text.atomic import reporting_failure
from orip.files.text.shown import has_hidden, shown_token
from orip.records.control import ControlDistance, ControlPoint
from orip.records.exchanged import ExchangedProject

_NO_TITLES = {"sparse", "opensfm", "params", "1_initial", "model", "text", "binary", ""}
"""Names of folders that projects of other programs have in common."""

_DEFINITION, _CONTROL = "orip.toml", (".PNT", ".LEN", ".STA")

LEAST_PRECISION, LARGEST_PRECISION = 1e-4, 1e5
"""Limits of the a-priori error that may be given, pixels."""

_PLACES_NAMED = 3
"""Of those at which the same is wrong."""


class ImportedProject(Struct, frozen=True):
    """A project that was imported, or can be.

    Parameters
    ----------
    title : str
        Of the project.
    """

    format: Format
    source: Path
    block: ImportedBlock
    content: ImportedTexts
    title: str

    @property
    def file_names(self) -> tuple[str, ...]:
        """Return the names of the files of the project folder, orip.toml last."""
        *names, definition = self.content.texts
        return (IGNORE_FILE, *names, SOURCE_FILE, definition)


def read_source(format_name: str | None, source: Path, settings: ExchangeSettings) -> ImportedProject:
    """Read a project of another program; nothing is written.

    Parameters
    ----------
    format_name : str or None
        None: it is guessed.
    source : Path
        File or folder.

    Raises
    ------
    UsageError
        If the format is not known, cannot be guessed or is written only.
    InputError
        With everything that is wrong in the files, or if poses, points and measurements do not fit one another.
    """
    if format_name is None:
        found, source = guessed_source(source)
    else:
        found = format_named(format_name, FORMATS_READ)
    if found.read is None:
        message = f"the format '{found.name}' is written, not read; 'orip import --list' shows those that are read"
        raise UsageError(message)
    if not source.exists():
        message = f"there is no '{source}'; name the file or folder of the other program"
        raise UsageError(message)
    if source.is_dir() and not found.recognises(source):
        files = files_of_formats(source, (found,))
        source = files[0][1] if len(files) == 1 else source
    parsed = found.read(source, str(source))
    if parsed.complaints or parsed.value is None:
        raise InputError(_merged(parsed.complaints))
    require_names(parsed.value, str(source))
    project = _with_references(found, parsed.value, settings)
    block = imported_block(project, str(source), settings)
    title = project.name or _title(source)
    origin = ImportSource(found.name, source.absolute().name, title, found.write is not None)
    content = imported_texts(block, origin, settings.precision)
    refused = list(_refused(content.texts, block, source))
    if refused:
        raise InputError(refused)
    return ImportedProject(found, source, block, content, title)


def import_folder(
    source: Path,
    folder: Path | None,
    format_name: str | None,
    frame: tuple[int, int] | None,
    precision: float | None,
    *,
    holds_cameras: bool,
    corrects_distortion: bool,
) -> Path:
    """Make a project folder of a project of another program, and return it.

    Parameters
    ----------
    folder : Path or None
        None: as the source is called, in the current folder.
    frame, precision, holds_cameras, corrects_distortion
        See `ExchangeSettings`.

    Raises
    ------
    UsageError
        If a value is impossible, the format is not known, or the folder has something in it.
    InputError
        See `read_source`.
    """
    if precision is not None and not LEAST_PRECISION <= precision <= LARGEST_PRECISION:
        message = f"precision is {precision!r}; it is in pixels, {LEAST_PRECISION:g} to {LARGEST_PRECISION:.0f}"
        raise UsageError(message)
    settings = ExchangeSettings(frame, corrects_distortion, holds_cameras, precision)
    imported = read_source(format_name, source, settings)
    target = folder if folder is not None else Path(f"{imported.title}_orip")
    write_project(imported, target)
    return target


def _refused(texts: Mapping[str, str], block: ImportedBlock, source: Path) -> Iterator[Complaint]:
    """Yield what `orip run` would refuse in the texts of a project, as it is in the source.

    Complaints that say the same are one, with the first places and their number.
    """
    found = list(parse_project(texts[_DEFINITION]).complaints)
    control = [name for name in texts if name.endswith(_CONTROL)]
    # a .PRE file has names of the measurements, and numbers that are known to be possible
    measurements = [name for name in texts if name.endswith(".MEA")]
    with TemporaryDirectory() as folder:
        for name in (*control, *measurements):
            (Path(folder) / name).write_text(texts[name], encoding="utf-8", newline="")
        found += read_control(Path(folder), control[0].rpartition(".")[0]).complaints if control else ()
        for name in measurements:
            found += read_measurements(Path(folder) / name, name).complaints
    if not found:
        return
    groups: dict[tuple[str, str], list[Complaint]] = {}
    for complaint in found:
        groups.setdefault((complaint.path.rpartition(".")[2], complaint.message), []).append(complaint)
    places = _Places(block, texts)
    for (_, message), several in groups.items():
        named = list(dict.fromkeys(places.of(one) for one in several))
        more = f" and {len(named) - _PLACES_NAMED} more" if len(named) > _PLACES_NAMED else ""
        line = min((line for one in several if (line := places.line(one))), default=None)
        own = "" if line is None or source.is_file() else f" (line {line} of its file)"
        where = f"{', '.join(named[:_PLACES_NAMED])}{more}{own}: "
        yield Complaint(where + places.in_source(message, several[0]), str(source), line if source.is_file() else None)


class _Places:
    """Where in the source the lines of a project's texts come from."""

    def __init__(self, block: ImportedBlock, texts: Mapping[str, str]) -> None:
        self._project = block.project
        self._lines = {name: text.splitlines() for name, text in texts.items()}
        self._photos = {name: photo.name for name, photo in zip(block.photos, block.project.photos, strict=True)}
        tracks = ((block.points[place], f"tie point {number}") for number, place in block.project.points.tracks.items())
        self._points = {**dict(tracks), **{name: f"point {given}" for given, name in block.marks.items()}}

    def of(self, complaint: Complaint) -> str:
        """Return what a complaint is about."""
        line = self._text(complaint)
        word = line.split(maxsplit=1)[0] if line.strip() else ""
        if complaint.path.endswith(".LEN"):
            return f"distance {word}"
        if complaint.path.endswith(".STA"):
            return f"position of photo {self._photos.get(word, word)}"
        if complaint.path.endswith(".PNT"):
            return self._points.get(word, word)
        if complaint.path.endswith(".MEA"):
            return f"{self._points.get(word, word)} in photo {self._photo_above(complaint)}"
        return complaint.path

    def line(self, complaint: Complaint, line: int | None = None) -> int | None:
        """Return the line of the source, of the complaint or of another line of its file; None: it is not known."""
        records: Sequence[ControlPoint] | Sequence[ControlDistance] = ()
        if complaint.path.endswith(".PNT"):
            records = self._project.control
        elif complaint.path.endswith(".LEN"):
            records = self._project.distances
        number = (line or complaint.line or 0) - 1
        return (records[number].line or None) if 0 <= number < len(records) else None

    def in_source(self, message: str, complaint: Complaint) -> str:
        """Return a message whose lines are those of the source."""
        return re.sub(r"\bline (\d+)", lambda found: f"line {self.line(complaint, int(found[1])) or found[1]}", message)

    def _text(self, complaint: Complaint) -> str:
        lines = self._lines.get(complaint.path, [])
        return lines[complaint.line - 1] if complaint.line is not None and complaint.line <= len(lines) else ""

    def _photo_above(self, complaint: Complaint) -> str:
        for line in reversed(self._lines[complaint.path][: complaint.line]):
            if line.startswith("POINTS "):
                name = line.split()[2]
                return self._photos.get(name, name)
        return ""


def _merged(complaints: Sequence[Complaint]) -> list[Complaint]:
    """Return complaints; the first one, with a count, of many that differ in numbers and names alone."""
    alike: dict[tuple[str, str], list[Complaint]] = {}
    for one in complaints:
        alike.setdefault((one.path, _DETAILS.sub("#", one.message)), []).append(one)
    found = []
    for group in alike.values():
        first = group[0]
        others = len(group) - 1
        if others < _MANY:
            found += group
        else:
            found.append(Complaint(f"{first.message} ({others} more like this)", first.path, first.line, first.column))
    return found


_DETAILS = re.compile(r"'[^']*'|[0-9]+")
_MANY = 3
"""Complaints of a kind beside the first one, which are counted and no more."""


def require_names(project: ExchangedProject, shown: str) -> None:
    """Refuse names that no text, table or message could hold as they are, whatever the format.

    Raises
    ------
    InputError
        With all of them.
    """
    faults = tuple(_faults_of_names(project, shown))
    if faults:
        raise InputError(faults)


def _faults_of_names(project: ExchangedProject, shown: str) -> Iterator[Complaint]:
    """Yield what is wrong with names, whatever the format: no text, table or message could hold them as they are."""
    kinds: Mapping[str, Iterable[str]] = {
        "camera": [camera.name for camera in project.cameras],
        "photo": [photo.name for photo in project.photos],
        "point": project.points.names,
        "control point": [point.name for point in project.control],
        "station": [station.photo for station in project.stations],
    }
    for kind, names in kinds.items():
        if " ".join(names).isprintable():  # there may be a million of them
            continue
        for name in dict.fromkeys(names):
            if has_hidden(name):
                what = "has a character that cannot be shown, or that is not UTF-8; rename it"
                yield Complaint(f"the {kind} '{shown_token(name)}' {what}", shown)


def _with_references(found: Format, project: ExchangedProject, settings: ExchangeSettings) -> ExchangedProject:
    if settings.reference is None:
        return project
    if found.add_references is None:
        named = " and ".join(one.name for one in FORMATS if one.add_references is not None)
        message = f"--reference is for {named}, and this is {found.name}"
        raise UsageError(message)
    parsed = found.add_references(project, settings.reference, str(settings.reference), settings.reference_columns)
    if parsed.complaints:
        raise InputError(parsed.complaints)
    return parsed.value


def write_project(imported: ImportedProject, folder: Path) -> None:
    """Write the folder of a project, as a whole or not at all.

    Raises
    ------
    UsageError
        If the folder has something in it.
    OripError
        If it cannot be written.
    """
    texts = texts_with_source(imported, folder)
    with reporting_failure(str(folder), "name another folder"):
        write_whole_folder(folder, texts, "a project is imported into a new or empty folder: name another")


def texts_with_source(imported: ImportedProject, folder: Path) -> dict[str, str]:
    """Return the texts of a project folder by their names, orip.toml last.

    Beside those of the project: what git ignores, and the place of the original.
    """
    texts = dict(imported.content.texts)
    definition = texts.popitem()
    original = {"format": imported.format.name, "path": place_from(folder, imported.source)}
    return {IGNORE_FILE: IGNORED, **texts, SOURCE_FILE: toml_table("[source]", original), **dict([definition])}


def _title(source: Path) -> str:
    """Return the name of a project after its folder."""
    path = source.absolute()
    if path.is_file():
        path = path.parent
    return next(
        (one.name for one in (path, *path.parents) if not one.name.isdigit() and one.name.lower() not in _NO_TITLES),
        "imported",
    )
