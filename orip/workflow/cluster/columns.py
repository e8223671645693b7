"""Where the columns of a divided block are: in files beside its sub-blocks, not in the memory of the client."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from orip.files.blocking.sub_blocks import FOLDER
from orip.files.text.atomic import reporting_failure
from orip.files.text.own_files import make_folder
from orip.set_aside import columns_in_files


@contextmanager
def columns_of_project(project: Path) -> Iterator[None]:
    """Keep what is set aside within the block in files of a project's folder.

    Raises
    ------
    OripError
        If the folder for them cannot be made, or a link stands in its place.
    """
    folder = project / FOLDER
    with reporting_failure(folder, "remove the cause, then repeat the command"):
        make_folder(folder)
    with columns_in_files(folder):
        yield
