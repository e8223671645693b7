"""Text files that a command writes after its stores have committed, and what killed runs have left."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from orip.errors import OripError
from orip.files.stores.contents import exterior, observations
from orip.files.stores.store import Store
from orip.files.stores.transaction import reading, remove_empty
from orip.files.text.atomic import remove_leftovers, replace_in_pieces, reporting_failure
from orip.files.text.own_files import make_folder
from orip.files.text.regular_file import file_digest
from orip.records.names import record_key
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


def remove_leftovers_of_kills(project: ProjectFolder) -> None:
    """Remove temporary files whose process has ended, and stores of renamed bundles that are empty now.

    What cannot be removed stays: it has no effect.
    """
    with suppress(OSError, OripError):
        for folder in {project.folder, project.results}:
            if folder.is_dir() and not folder.is_symlink():
                remove_leftovers(folder)
        with reading([project.exterior]) as stores:
            defined = [bundle.record.name for bundle in exterior.read(stores[project.exterior])]
        # orip.toml may still have the old name of a bundle that was renamed
        for path in _stores_of_no_bundle(project, defined):
            remove_empty(path, _has_nothing)


def _stores_of_no_bundle(project: ProjectFolder, bundles: Sequence[str]) -> list[Path]:
    """Return the stores of photo observations that belong to no bundle by their names."""
    keys = {record_key(name) for name in bundles}
    folder = project.observations("").parent
    return [path for path in sorted(folder.glob("*.EXO")) if record_key(path.stem) not in keys]


def _has_nothing(store: Store) -> bool:
    return observations.read(store) is None
