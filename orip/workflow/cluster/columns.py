"""Where the columns of a divided block are: in files beside its sub-blocks, not in the memory of the client."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

from orip.files.blocking.sub_blocks import FOLDER
from orip.set_aside import columns_in_files


def columns_of_project(project: Path) -> AbstractContextManager[None]:
    """Keep what is set aside within the block in files of a project's folder."""
    return columns_in_files(project / FOLDER)
