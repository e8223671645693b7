"""A new project that is going to be defined by commands: its orip.toml holds the names, the stores hold all records."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from orip.errors import Complaint, InputError, UsageError
from orip.files.project.ignored import IGNORE_FILE, IGNORED
from orip.files.project.reader import parse_project
from orip.files.project.toml_text import toml_table
from orip.files.text.atomic import replace_text, reporting_failure
from orip.workflow.project.folder import PROJECT_FILE

_HEADING = """\
# Cameras, templates, photos and bundles of this project are defined by commands (orip camera add ...) and kept in
# its stores; 'orip export-toml' writes them here. They may as well be written here by hand: see 'orip init --help'.
"""


@dataclass(frozen=True, slots=True)
class ProjectMade:
    """A project that was made: its name, its folder."""

    name: str
    folder: Path


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
    faults = parse_project(text).complaints
    if faults:
        raise InputError([Complaint(fault.message) for fault in faults])
    path = folder / PROJECT_FILE
    if path.exists() or path.is_symlink():
        message = f"{folder} has an {PROJECT_FILE} already: name another folder, 'orip init NAME DIR'"
        raise UsageError(message)
    with reporting_failure(str(path), "name another folder"):
        folder.mkdir(parents=True, exist_ok=True)
        ignore = folder / IGNORE_FILE
        if not (ignore.exists() or ignore.is_symlink()):
            replace_text(ignore, IGNORED)
        replace_text(path, text)
    return ProjectMade(name, folder)
