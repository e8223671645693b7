"""`orip export`: the result in the format of another program, in a folder that appears when all of it is written."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from msgspec import Struct

from orip.errors import InputError, UsageError
from orip.exchange.conversion.cameras import convert_camera, export_camera
from orip.exchange.conversion.ground import from_local_ground, local_ground
from orip.exchange.conversion.image_axes import UnsuitableCameraError
from orip.exchange.format import Conventions, Format, Given
from orip.exchange.formats import FORMATS_WRITTEN, format_named
from orip.exchange.project.result import exchanged_result
from orip.exchange.sources.names import read_names, read_original
from orip.files.text.atomic import (
    is_one_file_name,
    remove_leftovers,
    replace_bytes,
    reporting_failure,
    temporary_beside,
    was_left,
    write_new_folder,
)
from orip.files.text.own_files import make_named_folder, remove_folder, rename, replace_empty_folder
from orip.files.text.regular_file import file_of, is_there
from orip.files.text.shown import shown_token
from orip.records.exchanged import ExchangedCamera, ExchangedProject
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import require_replaceable
from orip.workflow.project.state import Part

_REMEDY = "name another folder"
_CANNOT_GIVE_WAY = {errno.EBUSY, errno.EXDEV, errno.EACCES, errno.EPERM, errno.EROFS}
"""A folder in which a disk is mounted, or beside which nothing may be made."""


@contextmanager
def folder_in_the_making(folder: Path) -> Iterator[Path]:
    """Give a path beside a folder that does not exist yet, or is empty; what is made there then takes its place.

    If anything goes wrong, nothing is left behind.

    Raises
    ------
    UsageError
        If the folder has something in it.
    OripError
        If it cannot be made.
    """
    target = file_of(folder)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        message = f"{folder} has something in it already; name a new or empty folder"
        raise UsageError(message)
    with reporting_failure(str(folder), _REMEDY):
        make_named_folder(target.parent)
        remove_leftovers(target.parent)
        temporary = temporary_beside(target)
    try:
        yield temporary
        with reporting_failure(str(folder), _REMEDY):
            _put_in_place(temporary, target)
    except BaseException:  # an interrupt must not leave the temporary folder behind either
        with suppress(OSError):
            remove_folder(temporary)
        raise


def _put_in_place(temporary: Path, target: Path) -> None:
    """Give a folder its name; an empty one that has it gives way, and there is one of them at any instant."""
    if target.exists():
        replace_empty_folder(temporary, target)
    else:
        rename(temporary, target)


def write_whole_folder(folder: Path, texts: Mapping[str, str | bytes], rule: str) -> None:
    """Write files into a folder that does not exist yet, or is empty: all of them at one instant, or none.

    A folder that somebody works in, or where a disk is mounted, stays the same folder: its files arrive one after the
    other, and when that was interrupted the same command goes on from there.

    Parameters
    ----------
    texts : mapping of file name to text or bytes
        The one that makes sense of the others last.
    rule : str
        What is said of a folder that has something in it.

    Raises
    ------
    UsageError
        If the folder has something in it.
    OSError
        If it cannot be written.
    """
    target = file_of(folder)
    if target.is_dir():
        remove_leftovers(target)
    if target.exists() and (not target.is_dir() or any(not was_left(path, texts) for path in target.iterdir())):
        message = f"{folder} has something in it already; {rule}"
        raise UsageError(message)
    if target.is_dir() and (any(target.iterdir()) or _is_worked_in(target)):
        write_new_folder(target, texts)
        return
    make_named_folder(target.parent)
    temporary = temporary_beside(target)
    try:
        write_new_folder(temporary, texts)
        _put_in_place(temporary, target)
    except BaseException as error:  # an interrupt must not leave the temporary folder behind either
        with suppress(OSError):
            remove_folder(temporary)
        if not isinstance(error, OSError) or error.errno not in _CANNOT_GIVE_WAY or not target.is_dir():
            raise
        write_new_folder(target, texts)


def _is_worked_in(folder: Path) -> bool:
    """Tell whether it is the folder of this process, and so of the shell that has started it."""
    try:
        return folder.samefile(Path.cwd())
    except OSError:
        return False


_SAME = 1e-9
"""Relative to the focal length, of parameters that were converted twice and written as texts."""


def in_terms_of(project: ExchangedProject, found: Format, original: Path) -> ExchangedProject:
    """Return a result as a copy of its original needs it.

    A camera that orip does not hold exactly would come back as the nearest one of orip; it comes back as it was unless
    the adjustment has changed it.

    Raises
    ------
    InputError
        If the original is damaged.
    """
    if found.read is None:
        return project
    parsed = found.read(original, str(original))
    source = parsed.value
    if source is None:
        raise InputError(parsed.complaints)
    given = {camera.name: camera for camera in source.cameras}
    cameras = tuple(
        given[camera.name] if camera.name in given and _is_unchanged(camera, given[camera.name], found) else camera
        for camera in project.cameras
    )
    project = replace(project, cameras=cameras)
    ground = local_ground(source) if source.frame.kind == "geocentric" and project.crs is None else None
    return project if ground is None else from_local_ground(project, ground, source.control_crs)


def _is_unchanged(camera: ExchangedCamera, given: ExchangedCamera, found: Format) -> bool:
    """Return whether a camera is what an import and an export make of a given one."""
    conventions = found.conventions
    if conventions is None or camera.lens not in (conventions.lens, conventions.fisheye_lens):
        return False
    terms = conventions.terms if camera.lens == conventions.lens else conventions.fisheye_terms
    try:
        converted = convert_camera(given, given.name, accepts_any_fit=True).camera
        there = export_camera(
            converted, given.name, camera.lens, given.lens_axes, given.ray_axes, terms=terms, accepts_any_fit=True
        ).camera
    except UnsuitableCameraError:
        return False
    size = max(abs(value) for value in there.parameters.values())
    return all(
        abs(camera.parameters.get(name, 0.0) - value) <= _SAME * (1.0 if abs(value) < 1.0 else size)
        for name, value in there.parameters.items()
    )


EXPORTED_FROM: tuple[Part, ...] = ("definitions", "marks", "observations", "heads", "solutions")


class ExportedResult(Struct, frozen=True):
    """What an export writes.

    Parameters
    ----------
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
    control = bundle.control
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
    if project.rigs and conventions.lens is not None and not conventions.has_rigs:
        yield "The format has no rigs: their photos are written one by one, where the rigs have them."


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
