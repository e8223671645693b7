"""`orip export`: the result of an adjustment in the format of another program."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from orip.errors import InputError, UsageError
from orip.exchange.format import Conventions, Format, Given
from orip.exchange.formats import FORMATS_WRITTEN, format_named
from orip.exchange.names_table import read_names, read_original
from orip.files.text.atomic import remove_leftovers, replace_bytes, reporting_failure
from orip.files.text.new_folder import is_one_file_name
from orip.files.text.regular_file import is_there
from orip.files.text.shown import shown_token
from orip.records.exchanged import ExchangedProject
from orip.wording import counted
from orip.workflow.exchange.original import in_terms_of
from orip.workflow.exchange.result import exchanged_result
from orip.workflow.exchange.temporary import write_whole_folder
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.named_output import require_replaceable
from orip.workflow.project.state import Part

EXPORTED_FROM: tuple[Part, ...] = ("definitions", "marks", "observations", "heads", "solutions")


class ExportedResult(Struct, frozen=True):
    """What an export writes.

    Parameters
    ----------
    format : Format
    project : ExchangedProject
    files : mapping of str to bytes
        By their names in the folder, or the only one.
    target : Path
        Folder, or file if the format is a file.
    is_usual : bool
        The target has the name that orip gives it.
    source : ProjectFolder
        The project that was adjusted.
    original : Path or None
        The project that the result is written into a copy of.
    notes : tuple of str
    """

    format: Format
    project: ExchangedProject
    files: Mapping[str, bytes]
    target: Path
    is_usual: bool
    source: ProjectFolder
    original: Path | None
    notes: tuple[str, ...]


def export(
    bundle: BundleState,
    format_name: str | None,
    target: Path | None,
    original: Path | None = None,
    *,
    corrects_distortion: bool = False,
) -> ExportedResult:
    """Return the last solution of a bundle in the format of another program; nothing is written.

    Parameters
    ----------
    bundle : BundleState
        With `EXPORTED_FROM`.
    format_name : str or None
        None: that of the project that was imported.
    target : Path or None
        None: named after the format, in the project's folder.
    original : Path or None
        None: where the project was imported from, if it is still there.
    corrects_distortion : bool
        Measurements are corrected for what the cameras of the format do not hold; the original, which has others, is
        not copied.

    Raises
    ------
    UsageError
        If the format is not known, or is read only, or measurements are corrected in a copy of an original.
    InputError
        If the bundle has not been adjusted, or the original is damaged.
    """
    folder = bundle.project.folder
    imported = read_original(folder)
    name = _named(format_name, None if imported is None else imported.format)
    found = format_named(name, FORMATS_WRITTEN)
    if found.write is None or found.conventions is None:
        message = f"the format '{found.name}' is read, not written; 'orip export --list' shows those that are written"
        raise UsageError(message)
    if original is not None and corrects_distortion:
        message = "--original and --exact-distortion exclude each other: the original has the measurements as they were"
        raise UsageError(message)
    is_own = imported is not None and imported.format == found.name and not corrects_distortion
    if original is None and imported is not None and is_own and is_there(imported.path):
        original = imported.path
    project = exchanged_result(bundle, read_names(folder), found.conventions, corrects_distortion=corrects_distortion)
    notes = list(project.notes)
    is_copied = found.conventions.is_copied
    if original is not None:
        if is_copied is None or is_copied(original):
            project = in_terms_of(project, found, original) if found.conventions.has_terms_of_original else project
        else:
            notes.append(f"The original ({original}) is not copied; what is written has the result alone.")
            original, is_own = None, False
    if original is None and imported is not None and is_own:
        notes.append(f"The original ({imported.path}) is not there; what is written has the result alone.")
    notes += _lost(bundle, project, found.conventions) if original is None else ()
    if found.conventions.is_drawn and project.crs is None:
        notes.append("The project has no crs: coordinates are its own, not longitude and latitude or those of a map.")
    files = found.write(project, original)
    _require_files_of_its_own(files, found)
    default = folder / (next(iter(files)) if found.is_file else f"{found.name}_adjusted")
    is_usual = target is None
    return ExportedResult(found, project, files, target or default, is_usual, bundle.project, original, tuple(notes))


def _lost(bundle: BundleState, project: ExchangedProject, conventions: Conventions) -> Iterator[str]:
    """Yield a sentence about what the format has no place for."""
    control = bundle.state.texts.control.value
    counts: dict[Given, int] = {
        "control points": sum(point.kind == "control" for point in control.points),
        "check points": sum(point.kind == "check" for point in control.points),
        "stations": len(project.stations),
        "distances": len(control.distances),
        "tie points": int(project.points.is_track.sum()),
        "measurements": len(project.rays.photo),
    }
    lost = [counted(counts[what], what.removesuffix("s")) for what in conventions.lacks if counts[what]]
    if lost:
        yield f"Not written, as the format has no place for it: {', '.join(lost)}."


def _require_files_of_its_own(files: Mapping[str, bytes], found: Format) -> None:
    """Let no name from the data make a file beside the destination, whatever a format does with names."""
    outside = [name for name in files if not is_one_file_name(name)]
    if outside:
        message = (
            f"'{shown_token(outside[0])}' cannot be a file of {found.name}: it leads out of its folder, or no file can "
            f"have the name; correct the names of cameras and photos, also those in names.csv"
        )
        raise InputError.single(message)


def write_export(exported: ExportedResult, *, force: bool = False) -> None:
    """Write what is exported: a file in the place of an earlier one, or a whole new folder.

    Parameters
    ----------
    exported : ExportedResult
    force : bool
        Also in the place of another file.

    Raises
    ------
    UsageError
        If the folder has something in it, or the file would replace what is no earlier export or of the project.
    OripError
        If it cannot be written.
    """
    target = exported.target
    with reporting_failure(str(target), "name another one"):
        if exported.format.is_file:
            data = next(iter(exported.files.values()))
            usual = (target,) if exported.is_usual else ()
            require_replaceable(exported.source, target, force=force, usual=usual, begins=data)
            with suppress(OSError):
                remove_leftovers(target.parent)
            replace_bytes(target, data)
            return
        rule = "a result is exported into a new or empty folder: name another"
        write_whole_folder(target, exported.files, rule)


def _named(name: str | None, imported: str | None) -> str:
    if name is not None:
        return name
    if imported is not None:
        return imported
    written = ", ".join(one.name for one in FORMATS_WRITTEN)
    message = f"name the format: 'orip export FORMAT', one of {written}"
    raise UsageError(message)
