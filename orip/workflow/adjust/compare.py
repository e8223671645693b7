"""`orip compare`: the figures of two results against each other."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from orip.errors import Complaint, InputError, UsageError
from orip.files.result.reader import read_result
from orip.records.names import record_key
from orip.records.results.tests import ResultFigures
from orip.solving.differences import Comparison, Tolerance, compare_figures
from orip.workflow.project.folder import PROJECT_FILE
from orip.workflow.project.texts import open_checked_project


class CompareOutcome(Struct, frozen=True):
    """The files that were compared, as they are shown, and what came out."""

    a: str
    b: str
    tolerance: Tolerance
    comparison: Comparison


def compare(folder: Path, a: Path, b: Path, tolerance: Tolerance) -> CompareOutcome:
    """Compare two results. Reads only.

    Parameters
    ----------
    folder : Path
        What relative paths are relative to.
    a, b : Path
        A result.json, a project folder with one, or the name of a bundle of the project in `folder`.

    Raises
    ------
    InputError
        If a file is not a result; both are checked.
    UsageError
        If a folder has several results.
    """
    complaints: list[Complaint] = []
    results: list[ResultFigures] = []
    shown: list[str] = []
    for given in (a, b):
        try:
            path, name = _result_file(folder, given)
            results.append(read_result(path, name))
            shown.append(name)
        except InputError as error:
            complaints += error.complaints
    if complaints:
        raise InputError(list(dict.fromkeys(complaints)))
    return CompareOutcome(shown[0], shown[1], tolerance, compare_figures(results[0], results[1], tolerance))


def _folder_of_results(path: Path, given: Path) -> tuple[Path, Path]:
    """Return where the results of a project folder are, and how messages name that; of another folder itself."""
    if not (path / PROJECT_FILE).is_file():
        return path, given
    results = open_checked_project(path).results
    return results, given / results.relative_to(path)


def _result_file(folder: Path, given: Path) -> tuple[Path, str]:
    path = folder / given
    if not path.exists():
        if (of_bundle := _result_of_bundle(folder, str(given))) is not None:
            return of_bundle
        message = "there is no such file, folder or bundle; name a result.json, a project folder, or a bundle"
        raise InputError.single(message, str(given))
    if not path.is_dir():
        return path, str(given)
    path, given = _folder_of_results(path, given)
    found = sorted(file.name for file in path.iterdir() if file.name.endswith("result.json")) if path.is_dir() else []
    if not found:
        message = "there is no result.json in this folder; run 'orip solve' there first"
        raise InputError.single(message, str(given))
    if len(found) > 1:
        message = f"the folder '{given}' has several results; name one of them: {', '.join(found)}"
        raise UsageError(message)
    return path / found[0], str(given / found[0])


def _result_of_bundle(folder: Path, name: str) -> tuple[Path, str] | None:
    """Return the result of a bundle of the project in a folder; None where there is no such project or bundle.

    Raises
    ------
    InputError
        If the bundle has none.
    """
    if not (folder / PROJECT_FILE).is_file():
        return None
    project = open_checked_project(folder)
    bundle = next((one for one in project.bundle_names if record_key(one) == record_key(name)), None)
    if bundle is None:
        return None
    path = project.outputs(bundle).result
    if not path.is_file():
        message = f"bundle {bundle} has no result yet; run 'orip solve {bundle}' first"
        raise InputError.single(message, project.shown(path))
    return path, project.shown(path)
