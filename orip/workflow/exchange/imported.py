"""`orip import`: a project of another program as a new project folder."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from msgspec import Struct

from orip.errors import Complaint, InputError, UsageError
from orip.exchange.format import Format
from orip.exchange.formats import FORMATS, FORMATS_READ, format_named, guessed_format
from orip.exchange.names_table import SOURCE_FILE, place_from
from orip.files.project.ignored import IGNORE_FILE, IGNORED
from orip.files.project.toml_text import toml_table
from orip.files.text.atomic import reporting_failure
from orip.files.text.shown import has_hidden, shown_token
from orip.records.exchanged import ExchangedProject
from orip.workflow.exchange.block import ExchangeSettings, ImportedBlock, imported_block
from orip.workflow.exchange.temporary import write_whole_folder
from orip.workflow.exchange.texts import ImportedTexts, ImportSource, imported_texts

_NO_TITLES = {"sparse", "opensfm", "params", "1_initial", "model", "text", "binary", ""}
"""Names of folders that projects of other programs have in common."""


class ImportedProject(Struct, frozen=True):
    """A project that was imported, or can be.

    Parameters
    ----------
    format : Format
    source : Path
    block : ImportedBlock
    content : ImportedTexts
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
    settings : ExchangeSettings

    Raises
    ------
    UsageError
        If the format is not known, cannot be guessed or is written only.
    InputError
        With everything that is wrong in the files, or if poses, points and measurements do not fit one another.
    """
    found = guessed_format(source) if format_name is None else format_named(format_name, FORMATS_READ)
    if found.read is None:
        message = f"the format '{found.name}' is written, not read; 'orip import --list' shows those that are read"
        raise UsageError(message)
    if not source.exists():
        message = f"there is no {source}; name the file or folder of the other program"
        raise UsageError(message)
    parsed = found.read(source, str(source))
    if parsed.complaints or parsed.value is None:
        raise InputError(parsed.complaints)
    require_names(parsed.value, str(source))
    project = _with_references(found, parsed.value, settings)
    block = imported_block(project, str(source), settings)
    title = project.name or _title(source)
    origin = ImportSource(found.name, source.absolute().name, title, found.write is not None)
    return ImportedProject(found, source, block, imported_texts(block, origin, settings.precision), title)


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
