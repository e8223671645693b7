"""The text outputs: written after the stores have committed, and never over what belongs to the project."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from orip.errors import OripError, UsageError
from orip.files.identification import run_of_listing, run_of_result
from orip.files.project.file_names import IGNORE_FILE
from orip.files.stores.contents import observations
from orip.files.stores.contents.stores import read_bundles
from orip.files.stores.digest import run_of
from orip.files.stores.store import Store
from orip.files.stores.transaction import reading, remove_empty
from orip.files.text.atomic import lines_in_pieces, remove_leftovers, replace_in_pieces, reporting_failure
from orip.files.text.own_files import make_folder, remove_file
from orip.files.text.regular_file import beginning, file_digest, open_regular
from orip.records.measurement import PhotoObservations, no_observations
from orip.records.names import record_key
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import PROJECT_FILE, ProjectFolder
from orip.workflow.project.state import read_state
from orip.workflow.project.texts import is_measurement_file

if TYPE_CHECKING:
    from orip.interior.in_force import Interior
    from orip.records.results.solution import Reliability, Solution


class TextOutput(Struct, frozen=True):
    """A file that a command writes as a whole: a text, or arrays.

    Parameters
    ----------
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
            defined = [bundle.record.name for bundle in read_bundles(stores[project.exterior])]
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


_OF_PROJECTS = re.compile(r"\.(CAM|TIK|PHO|TEM|EXT|EXO|MEA|PNT|ELE|LEN|DIR|STA|PRE|DRV|STE|GEO|OUT)", re.IGNORECASE)
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


_HEAD = 4096
"""Number of characters at the beginning of an output that include its run id."""

_REMEDY = (
    "the results are safe in the record stores: remove the cause, then 'orip init' (or measure, solve, run) writes the "
    "missing outputs"
)


def solution_outputs(project: ProjectFolder, solution: Solution, measured: PhotoObservations) -> tuple[TextOutput, ...]:
    """Return all outputs of a solution; result.json comes last, so that its run id vouches for residuals.csv.

    Parameters
    ----------
    measured : PhotoObservations
        Those that were adjusted.
    """
    # slow to import, and most commands write no solution
    from orip.bundle.results.reliability import reliability_of, suspect_rows
    from orip.files.listings.bundle import bundle_listing_lines
    from orip.files.listings.errors import error_listing_lines
    from orip.files.result.json_text import result_pieces

    files = project.outputs(solution.bundle)
    found = reliability_of(solution)
    misfits = suspect_rows(solution, project.definition.test_level).tolist()
    return (
        TextOutput(files.residuals_of(solution), lambda: residuals_in_pieces(solution, found), _REMEDY),
        TextOutput(files.listing, lambda: lines_in_pieces(bundle_listing_lines(solution, found, measured)), _REMEDY),
        TextOutput(files.errors, lambda: lines_in_pieces(error_listing_lines(solution, misfits)), _REMEDY),
        TextOutput(files.result, lambda: result_pieces(solution, files.residuals_of(solution).name), _REMEDY),
    )


def superseded_outputs(project: ProjectFolder, solution: Solution) -> tuple[Path, ...]:
    """Return the file of residuals that an earlier solution had in the other form."""
    files = project.outputs(solution.bundle)
    return tuple(path for path in files.all if path not in files.written(solution))


def residuals_in_pieces(solution: Solution, found: Reliability) -> Iterable[str | bytes | memoryview]:
    """Return the residuals of a solution as a text table, or as arrays where they are many."""
    if solution.is_large:
        from orip.files.result.residuals import residuals_npz_pieces

        return residuals_npz_pieces(solution.residuals, found)
    from orip.files.result.residuals import residuals_csv_pieces

    return residuals_csv_pieces(solution.residuals, found)


def interior_output(project: ProjectFolder, interior: Interior, run: str) -> TextOutput:
    """Return INTERIOR_RESULT.OUT."""
    definition = project.definition

    def listing() -> list[str]:
        from orip.files.listings.errors import interior_listing

        return [interior_listing(interior.adjustments, definition.name, definition.user, run)]

    return TextOutput(project.interior_listing, listing, _REMEDY)


def stale_solution_outputs(project: ProjectFolder, bundle: str, run: str) -> tuple[Path, ...]:
    """Return the outputs of a bundle that are missing or not those of the run in the store."""
    files = project.outputs(bundle)
    stale = [path for path in (files.listing, files.errors) if run_of_listing(beginning(path, _HEAD)) != run]
    if run_of_result(beginning(files.result, _HEAD)) != run:
        stale += [files.result, files.residuals]
    elif not (files.residuals.is_file() or files.residual_arrays.is_file()):
        stale.append(files.residuals)
    return tuple(stale)


def is_interior_listing_stale(project: ProjectFolder, run: str) -> bool:
    """Tell whether INTERIOR_RESULT.OUT is missing or not that of the run in the stores."""
    return run_of_listing(beginning(project.interior_listing, _HEAD)) != run


def rewrite_stale_outputs(project: ProjectFolder) -> None:
    """Write again the outputs that do not belong to what is in the stores."""
    _rewrite_interior_listing(project)
    heads = read_state(project, {"heads"}, project.bundle_names)
    for bundle in project.bundle_names:
        head = heads.head(bundle)
        if head is not None and stale_solution_outputs(project, bundle, head.run):
            _rewrite_solution_outputs(project, bundle)


def _rewrite_solution_outputs(project: ProjectFolder, bundle: str) -> None:
    found = BundleState(read_state(project, {"solutions", "observations"}, [bundle]), bundle)
    if found.solution is None:
        return
    path = project.shown(project.observations(bundle))
    is_adjusted = found.is_measured and dict(found.solution.inputs).get(path) == found.digest_of_observations
    # measurements that have changed since do not belong to the listing
    measured = found.observations if is_adjusted else no_observations(bundle)
    for output in solution_outputs(project, found.solution, measured):
        write_output(project, output)
    for other in superseded_outputs(project, found.solution):
        with suppress(OSError):
            remove_file(other, project.folder)


def outputs_of_other_names(project: ProjectFolder) -> Sequence[Path]:
    """Return outputs that were written while the project had one bundle, and now has several, or the reverse."""
    current = {path for bundle in project.bundle_names for path in project.outputs(bundle).all}
    other = (path for bundle in project.bundle_names for path in project.outputs_of_other_name(bundle).all)
    return [path for path in dict.fromkeys(other) if path not in current and path.is_file()]


def _rewrite_interior_listing(project: ProjectFolder) -> None:
    with reading([project.photos]) as stores:
        run = run_of(stores[project.photos])
    if run is not None and is_interior_listing_stale(project, run):
        interior = read_state(project, {"definitions", "marks"}, ()).interior
        write_output(project, interior_output(project, interior, run))
