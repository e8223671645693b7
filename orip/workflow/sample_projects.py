"""Sample projects, and a new project: empty, or with commented texts that its user fills in."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from msgspec import Struct

from orip.errors import Complaint, InputError, UsageError
from orip.files.project.file_names import IGNORE_FILE, IGNORED
from orip.files.project.reader import parse_project
from orip.files.project.starting_texts import BlockKind, Start, starting_texts
from orip.files.project.toml_text import toml_table
from orip.files.text.atomic import remove_leftovers, reporting_failure, was_left, write_new_folder
from orip.geometry.ground_crs import geodetic_of
from orip.workflow.project.folder import PROJECT_FILE

SAMPLES: Mapping[str, str] = {
    "zurich_city_hall": "15 terrestrial photos of a building, control and check points: data that do not fit",
    "dcs260_calibration": "5 photos of a grid plate: calibration of a camera",
    "drone_rtk": "60 photos of a drone with RTK, simulated: one bad fix, one shifted strip",
    "rendered_hill": "4 rendered photos of a hill, three stereo models: measured in the browser, up to a contour",
    "small_frame_block": "12 hand-held photos of a cliff, simulated: from film to drive table, with two blunders",
}
"""Name and description."""

_SUFFIXES = {".toml", ".md", ".MEA", ".PNT", ".PRE", ".LEN", ".STA", ".MRK", ".pos", ".py"}
_TRUTH = "truth.json"


class SampleWritten(Struct, frozen=True):
    """A sample project that was written: its name, its folder, and the names of its files."""

    name: str
    folder: Path
    files: tuple[str, ...]


def write_sample(name: str, folder: Path) -> SampleWritten:
    """Write a sample project into a folder that is new or empty; stores and results are left to `orip run`.

    If it is killed while it writes, there is no half project: a new folder appears as a whole, and in an existing one
    orip.toml is written last. When repeated, it goes on from there.

    Raises
    ------
    UsageError
        If there is no such sample, or the folder has something in it; nothing is written then.
    OSError
        If the folder or the disk refuses.
    """
    texts = {IGNORE_FILE: IGNORED, **sample_texts(name)}
    _require_room(folder, texts)
    write_new_folder(folder, texts)
    return SampleWritten(name, folder, tuple(texts))


def sample_texts(name: str) -> dict[str, str]:
    """Return the files of a sample project, orip.toml last.

    Raises
    ------
    UsageError
        If there is no such sample.
    """
    if name not in SAMPLES:
        width = max(map(len, SAMPLES))
        known = "".join(f"\n  {sample:{width}}  {text}" for sample, text in SAMPLES.items())
        message = f"no sample project is called {name!r}; write one of these:{known}"
        raise UsageError(message)
    given = [path for path in (_samples() / name).iterdir() if _is_given(path.name)]
    given.sort(key=lambda path: (path.name == PROJECT_FILE, path.name))
    return {path.name: path.read_bytes().decode("utf-8") for path in given}


def _samples() -> Path:
    """Return the folder of the sample projects: inside an installed package, beside it in a clone."""
    package = Path(__file__).parents[1]
    installed = package / "sample_projects"
    return installed if installed.is_dir() else package.parent / "sample_projects"


def _is_given(name: str) -> bool:
    """Tell whether a file belongs to the sample; orip may have written others there, if it was run in that folder."""
    return Path(name).suffix in _SUFFIXES or name == _TRUTH


def _require_room(folder: Path, texts: Mapping[str, str]) -> None:
    if folder.is_dir():
        remove_leftovers(folder)
        found = sorted(path.name for path in folder.iterdir() if not was_left(path, texts))
        if not found:
            return
        what = f"has something in it already ({found[0]}{', …' if len(found) > 1 else ''})"
    elif folder.exists() or folder.is_symlink():
        what = "is not a folder"
    else:
        return
    message = f"{folder} {what}; a sample is written into a new or empty folder: name another one"
    raise UsageError(message)


_HEADING = """\
# Cameras, templates, photos and bundles of this project are defined by commands (orip camera add ...) and kept in
# its stores; 'orip export-toml' writes them here. They may as well be written here by hand: see 'orip init --help'.
"""


class ProjectMade(Struct, frozen=True):
    """A project that was made: its name, its folder, its texts, and what to do next (an orip command, or words)."""

    name: str
    folder: Path
    files: tuple[str, ...]
    next: str


def make_project(name: str, user: str, folder: Path) -> ProjectMade:
    """Write the orip.toml of a new project, and a .gitignore; the folder is made where there is none.

    Parameters
    ----------
    name, user : str
        Of the project and its operator.
    folder : Path
        Files in it stay: measurements and control may be there already, and a .gitignore.

    Raises
    ------
    InputError
        If the names are not allowed; nothing is written then.
    UsageError
        If there is a project in the folder already.
    OripError
        If the folder or the disk refuses.
    """
    names = {"name": name, **({"user": user} if user else {})}
    text = f"{_HEADING}\n{toml_table('[project]', names)}"
    write_project_texts(folder, {PROJECT_FILE: text}, "orip init NAME DIR")
    return ProjectMade(name, folder, (PROJECT_FILE,), "camera add NAME c=...")


STARTS: Mapping[BlockKind, Start] = {
    "drone": Start(""),
    "object": Start(
        "", kind="object", focal_length=24.0, columns=6000, rows=4000, pixel=3.92, photo_error=0.3, control_error=0.001
    ),
    "film": Start("", kind="film", camera="RC30", focal_length=153.0, pixel=14.0, control_error=0.05),
}
"""What is usual for each kind of block."""


def make_started_project(start: Start, folder: Path) -> ProjectMade:
    """Write the commented texts of a new project, and a .gitignore; raises as `make_project` does."""
    texts = starting_texts(start)
    if start.crs:
        geodetic_of(start.crs)  # raises where it is not known, or no projected system
    write_project_texts(folder, texts, "orip new NAME DIR")
    return ProjectMade(start.name, folder, tuple(texts), _NEXT[start.kind])


_NEXT: Mapping[BlockKind, str] = {
    "drone": "stations import FILE",
    "object": "photo add NAME camera=...",
    "film": "photo add NAME camera=...",
}


def write_project_texts(folder: Path, texts: Mapping[str, str], example: str) -> None:
    """Write texts of a new project, all or, where one is there already, none.

    If it is killed while it writes, there is no half project: a new folder appears as a whole, and in an existing one
    orip.toml is written last. When repeated, it goes on from there.

    Raises
    ------
    InputError
        If orip.toml would be refused.
    UsageError
        If the folder has one of the files; `example` is the command that names another one.
    OripError
        If the folder or the disk refuses.
    """
    faults = parse_project(texts[PROJECT_FILE]).complaints
    if faults:
        raise InputError([Complaint(fault.message) for fault in faults])
    if os.path.lexists(folder) and not folder.is_dir():  # a link to nothing is not followed
        message = f"{folder} is not a folder: name another one, '{example}'"
        raise UsageError(message)
    ordered = {name: texts[name] for name in sorted(texts, key=PROJECT_FILE.__eq__)}
    there = [path for path in map(folder.joinpath, ordered) if os.path.lexists(path) and not was_left(path, ordered)]
    if there:
        message = f"{folder} has the file {there[0].name} already: name another folder, '{example}'"
        raise UsageError(message)
    ignored = {} if os.path.lexists(folder / IGNORE_FILE) else {IGNORE_FILE: IGNORED}
    with reporting_failure(str(folder / PROJECT_FILE), "name another folder"):
        write_new_folder(folder, {**ignored, **ordered})
