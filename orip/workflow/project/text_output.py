"""Text files that a command writes after its stores have committed, and texts of the user's that it edits."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from orip.files.text.atomic import replace_in_pieces, reporting_failure
from orip.files.text.digest import file_digest
from orip.files.text.own_files import make_folder
from orip.workflow.project.folder import ProjectFolder


class TextOutput(Struct, frozen=True):
    """A file that a command writes as a whole: a text, or arrays.

    Parameters
    ----------
    path : Path
    pieces : callable
        Gives the text or bytes; called when it is written.
    remedy : str
        What to do if it cannot be written, the last part of the message.
    """

    path: Path
    pieces: Callable[[], Iterable[str | bytes | memoryview]]
    remedy: str


class EditedText(Struct, frozen=True):
    """A text of the user's with an edit.

    Parameters
    ----------
    path : Path
    before : str or None
        Digest of the text that was edited; None: there was none.
    text : str
        With the edit.
    remedy : str
        As of a `TextOutput`.
    """

    path: Path
    before: str | None
    text: str
    remedy: str

    def output(self) -> TextOutput:
        """Return the file to write."""
        return TextOutput(self.path, lambda: [self.text], self.remedy)


def write_output(project: ProjectFolder, output: TextOutput) -> None:
    """Write a text file.

    Raises
    ------
    OripError
        If it cannot be written; it is unchanged then.
    """
    with reporting_failure(project.shown(output.path), output.remedy):
        if output.path.parent == project.results:
            _make_folder(project)
        replace_in_pieces(output.path, output.pieces())


def _make_folder(project: ProjectFolder) -> None:
    """Make the folder of the outputs where they have one of their own; a link could lead out of the project."""
    if project.results != project.folder:
        make_folder(project.results)


def digest_of_text(path: Path) -> str | None:
    """Return the digest of a text file; None if there is none or it cannot be read."""
    with suppress(OSError):
        return file_digest(path)
    return None
