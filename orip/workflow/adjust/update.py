"""`orip update`: values of the last adjustment become preliminary values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Literal, TypeVar

from orip.errors import InputError, NotSolvableError, ProjectWarning, UsageError
from orip.files.control.preliminary_text import preliminary_text, read_preliminary
from orip.files.stores import observations, solutions
from orip.files.stores.definitions import Named, StoredRecord
from orip.files.stores.transaction import Stores, reading, writing
from orip.files.text.atomic import replace_text, reporting_failure
from orip.files.text.lines import read_lines
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.control import PreliminaryPoint
from orip.records.names import COMMENT_MARKS, record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.solution import Estimates, Solution
from orip.wording import first_names
from orip.workflow.adjust.updated_values import (
    ChangedValue,
    Estimate,
    KeptValue,
    estimates_of,
    rows_of,
    updated_camera,
    updated_photo,
    updated_points,
)
from orip.workflow.project.definitions import (
    StoredDefinitions,
    read_definitions,
    require_initialised,
    write_definitions,
)
from orip.workflow.project.folder import Project, open_project
from orip.workflow.project.run_id import digest_of_observations
from orip.workflow.project.texts import CONTROL_EXTENSIONS, ground_digests, raise_complaints

What = Literal["cameras", "photos", "points"]
Verdict = ChangedValue | KeptValue
T = TypeVar("T", bound=Named)

_SHOWN_NAMES = 12


@dataclass(frozen=True, slots=True)
class UpdateOutcome:
    """What `orip update` did.

    Parameters
    ----------
    project : Project
    bundle, run : str
        Of the solution that the values come from.
    what : {"cameras", "photos", "points"}
    path : Path
        The store or text that holds the preliminary values.
    considered : int
        Records of the solution that were looked at.
    changed : tuple of str
        Names of the records that were changed.
    values : tuple of ChangedValue
    kept : tuple of KeptValue
        Unknowns that did not take their adjusted values.
    constant : int
        Records looked at that have no unknown.
    others : int
        Points of the file that the adjustment does not have; they stay.
    warnings : tuple of ProjectWarning
    """

    project: Project
    bundle: str
    run: str
    what: What
    path: Path
    considered: int
    changed: tuple[str, ...]
    values: tuple[ChangedValue, ...]
    kept: tuple[KeptValue, ...]
    constant: int
    others: int
    warnings: tuple[ProjectWarning, ...]


def update(
    folder: Path, what: What, names: Sequence[str] = (), bundle: str | None = None, *, force: bool = False
) -> UpdateOutcome:
    """Take the values of the last adjustment as preliminary values, those of its unknowns alone.

    Cameras and photos go into their stores, where they count as changed against orip.toml; points into BUNDLE.PRE.

    Parameters
    ----------
    folder : Path
    what : {"cameras", "photos", "points"}
    names : sequence of str
        Records to update; empty: all of the solution.
    bundle : str or None
        None: the project's only one.
    force : bool
        Also from an adjustment that did not converge.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, a record of the solution is no longer defined, or BUNDLE.PRE is wrong.
    NotSolvableError
        If the adjustment did not converge or was stopped, without `force`.
    UsageError
        If a name is not in the solution.
    LockedError
    """
    project = open_project(folder)
    name = project.bundle_name(bundle)
    with reading({*project.record_stores, project.observations(name)}) as stores:
        require_initialised(project, read_definitions(project, stores))
        warnings = tuple(_newer(project, stores, _solution(project, stores, name, force=force)))
    # Read anew under the lock of the stores: another run may have changed them meanwhile.
    with writing(project.record_stores) as stores:
        solution = _solution(project, stores, name, force=force)
        if what == "points":
            outcome = _update_points(project, solution, names)
        else:
            outcome = _update_records(project, stores, solution, what, names)
    return replace(outcome, warnings=warnings)


def _solution(project: Project, stores: Stores, bundle: str, *, force: bool) -> Solution:
    solution = solutions.read(stores[project.exterior], bundle)
    if solution is None:
        message = f"bundle {bundle} has not been adjusted yet; run 'orip solve' first"
        raise InputError.single(message)
    if solution.status not in {"converged", "doubtful"} and not force:
        ended = "was stopped" if solution.status == "stopped" else "did not converge"
        message = (
            f"the last adjustment of {bundle} {ended}, so its values may be worse than the preliminary ones; "
            f"solve it, or take them all the same with --force"
        )
        raise NotSolvableError(message)
    return solution


# cameras and photos: records in the stores


def _update_records(
    project: Project, stores: Stores, solution: Solution, what: Literal["cameras", "photos"], names: Sequence[str]
) -> UpdateOutcome:
    old = read_definitions(project, stores)
    estimates: Estimates = getattr(solution, what)
    rows = _rows(estimates, what, names)
    new: StoredDefinitions
    if what == "cameras":
        chosen = _estimates_by_key(estimates, rows, CAMERA_PARAMETERS)
        cameras, verdicts = _updated(old.cameras, chosen, updated_camera, what)
        new = replace(old, cameras=cameras)
        verdicts += _additional(solution, chosen)
    else:
        chosen = _estimates_by_key(estimates, rows, PHOTO_PARAMETERS)
        photos, verdicts = _updated(old.photos, chosen, updated_photo, what)
        new = replace(old, photos=photos)
    write_definitions(project, stores, old, new)
    values = tuple(each for each in verdicts if isinstance(each, ChangedValue))
    return UpdateOutcome(
        project, solution.bundle, solution.run, what,
        path=project.cameras if what == "cameras" else project.photos,
        considered=len(rows),
        changed=tuple(dict.fromkeys(each.name for each in values)),
        values=values,
        kept=tuple(each for each in verdicts if isinstance(each, KeptValue)),
        constant=_constant(estimates, rows),
        others=0,
        warnings=(),
    )  # fmt: skip


def _estimates_by_key(
    estimates: Estimates, rows: Iterable[int], parameters: Sequence[str]
) -> dict[str, tuple[Estimate, ...]]:
    return {record_key(estimates.names[row]): estimates_of(estimates, row, parameters) for row in rows}


def _updated(
    stored: Sequence[StoredRecord[T]],
    estimates: dict[str, tuple[Estimate, ...]],
    updated: Callable[[T, Sequence[Estimate]], tuple[T, list[Verdict]]],
    what: What,
) -> tuple[tuple[StoredRecord[T], ...], list[Verdict]]:
    """Return the records with their new values; each stays bound to the text that it came from."""
    gone = [key for key in estimates if key not in {record_key(each.record.name) for each in stored}]
    if gone:
        names = first_names(gone, _SHOWN_NAMES)
        message = f"no longer defined: {what} {names} of the last adjustment; run 'orip solve' first"
        raise InputError.single(message)
    records: list[StoredRecord[T]] = []
    verdicts: list[Verdict] = []
    for each in stored:
        key = record_key(each.record.name)
        record, found = updated(each.record, estimates[key]) if key in estimates else (each.record, [])
        records.append(replace(each, record=record))
        verdicts += found
    return tuple(records), verdicts


def _additional(solution: Solution, chosen: dict[str, tuple[Estimate, ...]]) -> Iterator[KeptValue]:
    for name in dict.fromkeys(each.camera for each in solution.additional):
        if record_key(name) in chosen:
            yield KeptValue(name, "additional parameters", "they start at 0 in every adjustment")


# points: a text


def _update_points(project: Project, solution: Solution, names: Sequence[str]) -> UpdateOutcome:
    rows = _rows(solution.points, "points", names)
    path = project.preliminary(solution.bundle)
    shown = project.shown(path)
    found = read_preliminary(path, shown)
    raise_complaints(found.complaints)
    outcome = updated_points(found.records, solution, set(names) if names else None)
    if outcome.changed:
        write_points(path, shown, outcome.points, solution.ground_unit)
    known = set(solution.points.names)
    return UpdateOutcome(
        project, solution.bundle, solution.run, "points",
        path=path,
        considered=len(rows),
        changed=outcome.changed,
        values=outcome.values,
        kept=outcome.kept,
        constant=_constant(solution.points, rows),
        others=0 if names else sum(point.name not in known for point in found.records),
        warnings=(),
    )  # fmt: skip


def write_points(path: Path, shown: str, points: Sequence[PreliminaryPoint], ground_unit: str) -> None:
    """Replace a .PRE file; the comments that it begins with stay."""
    lines = read_lines(path, shown, may_be_absent=True).records
    comments = list(takewhile(lambda line: not line.strip() or line.strip().startswith(COMMENT_MARKS), lines))
    if not any(line.strip() for line in comments):
        comments = [f"! Preliminary coordinates, {ground_unit}: name X Y Z [sX sY sZ]"]
    with reporting_failure(shown, "it is as it was"):
        replace_text(path, "".join(f"{line}\n" for line in comments) + preliminary_text(points))


# what both need


def _rows(estimates: Estimates, what: What, names: Sequence[str]) -> list[int]:
    rows, missing = rows_of(estimates.names, names, exact=what == "points")
    if missing:
        present = first_names(estimates.names, _SHOWN_NAMES) or "none"
        message = f"the solution has no {what[:-1]} {first_names(missing, _SHOWN_NAMES)}; it has {present}"
        raise UsageError(message)
    return rows


def _constant(estimates: Estimates, rows: Sequence[int]) -> int:
    return sum(bool((estimates.sd[row] != estimates.sd[row]).all()) for row in rows)


def _newer(project: Project, stores: Stores, solution: Solution) -> Iterator[ProjectWarning]:
    """Warn of control and measurements that are not those of the solution; records change with every update."""
    base = project.definition.control_files
    watched = [project.shown(project.folder / f"{base}.{extension}") for extension in CONTROL_EXTENSIONS]
    now = dict(ground_digests(project, solution.bundle))
    path = project.observations(solution.bundle)
    measured = observations.read(stores[path])
    if measured is not None:
        now[project.shown(path)] = digest_of_observations(measured)
    before = dict(solution.inputs)
    for name in [*watched, project.shown(path)]:
        if now.get(name) != before.get(name):
            text = "has changed since the last adjustment, whose values are taken all the same"
            yield ProjectWarning("out-of-date", name, text)
