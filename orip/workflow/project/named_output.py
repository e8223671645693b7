"""Files that the user names for an output: they never replace what belongs to the project, and others only if asked."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator
from itertools import islice
from pathlib import Path

from orip.errors import UsageError
from orip.files.project.file_names import IGNORE_FILE
from orip.files.text.regular_file import open_regular
from orip.workflow.project.folder import PROJECT_FILE, ProjectFolder
from orip.workflow.project.texts import is_measurement_file

_OF_PROJECTS = re.compile(r"\.(CAM|TIK|PHO|TEM|EXT|EXO|MEA|PNT|ELE|LEN|DIR|STA|PRE|DRV|OUT)", re.IGNORECASE)
"""What stores, texts and listings of a project are called; in its folder no other file is."""
_BESIDE = frozenset({IGNORE_FILE, "names.csv", "exchange.toml", "before_update.json", PROJECT_FILE})
_SHORTEST_LINE, _COMPARED = 40, 200
"""Bytes: a first line that is longer tells a kind of file by itself, else so much of the beginning is compared."""


def require_replaceable(
    project: ProjectFolder,
    path: Path,
    *,
    force: bool,
    usual: Collection[Path] = (),
    begins: bytes = b"",
    is_text: bool = False,
) -> None:
    """Refuse to write an output where something else would be lost.

    Nothing replaces the project's own texts, stores and results. Another file is replaced where that was asked for, if
    orip itself calls the output so, or if it begins as the output does: then it is an earlier one.

    Parameters
    ----------
    project : ProjectFolder
    path : Path
        The output.
    force : bool
        The user has said that a file may be replaced.
    usual : collection of Path
        Names that orip itself gives to the output.
    begins : bytes
        The beginning of the output; none: an earlier one cannot be told from other files.
    is_text : bool
        The output is a text of the kinds that projects have, and may be called as they are where none is.

    Raises
    ------
    UsageError
        With what is there, and what to do.
    """
    if path in usual:
        return
    is_there = os.path.lexists(path)
    if (is_there or not is_text) and _belongs_to_project(project, path):
        message = f"{project.shown(path)} is a file of the project itself, which no output replaces; name another file"
        raise UsageError(message)
    if is_there and not force and not _begins_alike(path, begins):
        message = f"{project.shown(path)} already exists; name another file, or replace it with --force"
        raise UsageError(message)


def _belongs_to_project(project: ProjectFolder, path: Path) -> bool:
    place, folders = _place(path), {_place(project.folder), _place(project.results), _place(project.photos.parent)}
    has_name = _OF_PROJECTS.fullmatch(path.suffix) is not None or path.name.casefold() in _BESIDE
    if has_name and str(Path(place).parent) in folders:
        return True
    inside, root = Path(os.path.realpath(path.parent)) / path.name, Path(os.path.realpath(project.folder))
    if inside.is_relative_to(root) and is_measurement_file(project, project.folder / inside.relative_to(root)):
        return True
    return place in set(map(_place, _files_of(project)))


def _files_of(project: ProjectFolder) -> Iterator[Path]:
    """Yield the stores and results of a project, whether they are there or not."""
    yield from project.record_stores
    yield project.interior_listing
    for name in project.bundle_names:
        yield project.observations(name)
        yield project.drive_table(name)
        yield project.report(name)
        yield from project.outputs(name).all
        yield from project.outputs_of_other_name(name).all


def _place(path: Path) -> str:
    """Return where a file is, itself no link that is followed, so that two names of one place are equal."""
    return str(Path(os.path.realpath(path.parent)) / path.name).casefold()


def _begins_alike(path: Path, begins: bytes) -> bool:
    first = begins[: begins.find(b"\n") + 1]
    wanted = first[:_COMPARED] if len(first) > _SHORTEST_LINE else begins[:_COMPARED]
    if len(wanted) <= _SHORTEST_LINE or path.is_symlink():
        return False
    try:
        with open_regular(path) as stream:
            return stream.read(len(wanted)) == wanted
    except (OSError, ValueError):
        return False


def first_bytes(pieces: Iterable[str | bytes | memoryview]) -> bytes:
    """Return the beginning of an output that is written in pieces."""
    return b"".join(one.encode() if isinstance(one, str) else bytes(one) for one in islice(pieces, 1))[:_COMPARED]
