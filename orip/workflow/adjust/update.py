"""`orip update`: values of the last adjustment become preliminary values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeVar

from msgspec import Struct

from orip.errors import InputError, NotSolvableError, ProjectWarning, UsageError
from orip.files.control.text import CONTROL_EXTENSIONS
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.records.camera import CAMERA_PARAMETERS, OWN_PARAMETERS, lens_key
from orip.records.definition import ANTENNA_KEYS, ANTENNA_PARAMETERS
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Estimates, Solution
from orip.records.results.stations import BeforeUpdate, RecordBefore
from orip.solving.updated_values import (
    ChangedValue,
    EstimatedParameter,
    KeptValue,
    estimates_of,
    rows_of,
    updated_camera,
    updated_photo,
    updated_points,
)
from orip.structs import replace
from orip.wording import first_names
from orip.workflow.adjust.prelim import read_preliminary_text
from orip.workflow.adjust.undo_update import before_update_file, record_before, text_before
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.state import Part, StoredParts
from orip.workflow.project.texts import control_digests

UPDATED_FROM: tuple[Part, ...] = ("definitions", "observations", "heads", "solutions")
"""What an update needs of the stores."""

What = Literal["cameras", "photos", "points"]
Verdict = ChangedValue | KeptValue
T = TypeVar("T", bound=NamedRecord)

_SHOWN_NAMES = 12

_OF_DEVIATION = 0.01
"""Part of its standard deviation up to which a parameter of an antenna counts as written already."""


class UpdateOutcome(Struct, frozen=True):
    """What `orip update` did.

    Parameters
    ----------
    bundle, run : str
        Of the solution that the values come from.
    what : {"cameras", "photos", "points"}
    path : Path
        The store or text that holds the preliminary values.
    considered : int
        Number of records of the solution that were considered.
    changed : tuple of str
        Names of the records that were changed.
    kept : tuple of KeptValue
        Unknowns that did not take their adjusted values.
    constant : int
        Number of considered records that have no unknown.
    antennas : tuple of KeptValue
        Adjusted parameters that are still to be written into orip.toml, told with all cameras.
    others : int
        Points of the file that the adjustment does not have; they stay.
    """

    project: ProjectFolder
    bundle: str
    run: str
    what: What
    path: Path
    considered: int
    changed: tuple[str, ...]
    values: tuple[ChangedValue, ...]
    kept: tuple[KeptValue, ...]
    constant: int
    antennas: tuple[KeptValue, ...]
    others: int
    warnings: tuple[ProjectWarning, ...]


def update(bundle: BundleState, what: What, names: Sequence[str] = (), *, force: bool = False) -> Change[UpdateOutcome]:
    """Take the values of the last adjustment as preliminary values, but only those of its unknowns.

    Cameras and photos go into their stores, where they count as changed against orip.toml; points into BUNDLE.PRE.

    Parameters
    ----------
    bundle : BundleState
        With `UPDATED_FROM`.
    what : {"cameras", "photos", "points"}
    names : sequence of str
        Records to update; empty: all of the solution.
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
    """
    bundle.state.require_initialised()
    solution = bundle.adjusted
    if not force:
        _require_converged(solution)
    warnings = tuple(_changed_since(bundle, solution))
    if what == "points":
        return _updated_points(bundle, solution, names, warnings)
    return _updated_records(bundle, solution, what, names, warnings)


def _require_converged(solution: Solution) -> None:
    if solution.status not in {"converged", "doubtful"}:
        ended = {"stopped": "was stopped", "not_determined": "is not determined"}.get(
            solution.status, "did not converge"
        )
        message = (
            f"the last adjustment of {solution.bundle} {ended}, so its values may be worse than the preliminary ones; "
            f"solve it, or use its values nevertheless with --force"
        )
        raise NotSolvableError(message)


# cameras and photos: records in the stores


def _updated_records(
    bundle: BundleState,
    solution: Solution,
    what: Literal["cameras", "photos"],
    names: Sequence[str],
    warnings: tuple[ProjectWarning, ...],
) -> Change[UpdateOutcome]:
    project, old = bundle.project, bundle.state.definitions
    estimates: Estimates = getattr(solution, what)
    rows = _rows(estimates, what, names)
    if what == "cameras":
        chosen = _estimates_by_key(estimates, rows, CAMERA_PARAMETERS)
        cameras, verdicts = _updated(old.cameras, _with_lenses(chosen, old), updated_camera, what)
        new = replace(old, cameras=cameras)
        verdicts += _additional(solution, chosen)
    else:
        chosen = _estimates_by_key(estimates, rows, PHOTO_PARAMETERS)
        photos, verdicts = _updated(old.photos, chosen, updated_photo, what)
        new = replace(old, photos=photos)
    values = tuple(verdict for verdict in verdicts if isinstance(verdict, ChangedValue))
    outcome = UpdateOutcome(
        project, solution.bundle, solution.run, what,
        path=project.cameras if what == "cameras" else project.photos,
        considered=len(rows),
        changed=tuple(dict.fromkeys(value.name for value in values)),
        values=values,
        kept=tuple(verdict for verdict in verdicts if isinstance(verdict, KeptValue)),
        constant=_constant(estimates, rows),
        antennas=tuple(_antennas(bundle, solution)) if what == "cameras" and not names else (),
        others=0,
        warnings=warnings,
    )  # fmt: skip
    before = BeforeUpdate(what, solution.bundle, solution.run, _before(old, new))
    kept = (before_update_file(project, before),) if before.records else ()
    return Change(bundle.state, outcome, StoredParts(new), project.record_stores, edited_texts=kept)


def _before(old: StoredDefinitions, new: StoredDefinitions) -> tuple[RecordBefore, ...]:
    """Return the cameras and photos that an update changes, as they were."""
    of_cameras = zip(old.cameras, new.cameras, strict=True)
    of_photos = zip(old.photos, new.photos, strict=True)
    return (
        *(record_before(was.record, now.record) for was, now in of_cameras if was != now),
        *(record_before(was.record, now.record) for was, now in of_photos if was != now),
    )


def _with_lenses(
    chosen: dict[str, tuple[EstimatedParameter, ...]], old: StoredDefinitions
) -> dict[str, tuple[EstimatedParameter, ...]]:
    """Return estimates also of cameras that were not adjusted or chosen, but whose lens another one has."""
    found = dict(chosen)
    for stored in old.cameras:
        key, lens = record_key(stored.record.name), lens_key(stored.record)
        if key in chosen and lens not in found:
            found[lens] = tuple(
                estimate._replace(sd=math.nan) if estimate.parameter in OWN_PARAMETERS else estimate
                for estimate in chosen[key]
            )
    return found


def _estimates_by_key(
    estimates: Estimates, rows: Iterable[int], parameters: Sequence[str]
) -> dict[str, tuple[EstimatedParameter, ...]]:
    return {record_key(estimates.names[row]): estimates_of(estimates, row, parameters) for row in rows}


def _updated(
    stored: Sequence[StoredRecord[T]],
    estimates: dict[str, tuple[EstimatedParameter, ...]],
    updated: Callable[[T, Sequence[EstimatedParameter]], tuple[T, list[Verdict]]],
    what: What,
) -> tuple[tuple[StoredRecord[T], ...], list[Verdict]]:
    """Return the records with their new values; each stays bound to the text that it came from."""
    gone = [key for key in estimates if key not in {record_key(item.record.name) for item in stored}]
    if gone:
        names = first_names(gone, _SHOWN_NAMES)
        message = f"no longer defined: {what} {names} of the last adjustment; run 'orip solve' first"
        raise InputError.single(message)
    records: list[StoredRecord[T]] = []
    verdicts: list[Verdict] = []
    for item in stored:
        key = record_key(item.record.name)
        record, found = updated(item.record, estimates[key]) if key in estimates else (item.record, [])
        records.append(replace(item, record=record))
        verdicts += found
    return tuple(records), verdicts


def _antennas(bundle: BundleState, solution: Solution) -> Iterator[KeptValue]:
    """Tell adjusted parameters of antennas that orip.toml, which no update writes, does not have yet.

    Those with an a-priori error stay as they were measured: the adjusted value is no new measurement.
    """
    for antenna in bundle.project.definition.antennas:
        given = dict(zip(ANTENNA_PARAMETERS, antenna.values, strict=True))
        own = {row.name: row for row in solution.antennas if row.antenna == antenna.name and not row.strip}
        for key, names in ANTENNA_KEYS.items():
            rows = [own[name] for name in names if name in own]
            if getattr(antenna, f"{key}_error") is not None:
                continue
            if any(abs(row.value - given[row.name]) > _OF_DEVIATION * row.sd for row in rows if math.isfinite(row.sd)):
                values = ", ".join(f"{row.value:.6g}" for row in rows)
                value = f"[{values}]" if len(names) > 1 else values
                yield KeptValue(
                    antenna.name, key, f"orip.toml alone has it: write {key} = {value} in [[antenna]] there"
                )


def _additional(solution: Solution, chosen: dict[str, tuple[EstimatedParameter, ...]]) -> Iterator[KeptValue]:
    for name in dict.fromkeys(parameter.camera for parameter in solution.additional):
        if record_key(name) in chosen:
            yield KeptValue(name, "additional parameters", "they start at 0 in every adjustment")


# points: a text


def _updated_points(
    bundle: BundleState, solution: Solution, names: Sequence[str], warnings: tuple[ProjectWarning, ...]
) -> Change[UpdateOutcome]:
    project, rows = bundle.project, _rows(solution.points, "points", names)
    text = read_preliminary_text(project, solution.bundle)
    found = updated_points(text.points, solution, set(names) if names else None)
    known = set(solution.points.names)
    outcome = UpdateOutcome(
        project, solution.bundle, solution.run, "points",
        path=text.path,
        considered=len(rows),
        changed=found.changed,
        values=found.values,
        kept=found.kept,
        constant=_constant(solution.points, rows),
        antennas=(),
        others=0 if names else sum(point.name not in known for point in text.points),
        warnings=warnings,
    )  # fmt: skip
    if not found.changed:
        return Change(bundle.state, outcome, locks=project.record_stores)
    edited = text.edited(found.points, solution.ground_unit)
    before = BeforeUpdate("points", solution.bundle, solution.run, text=text_before(text.path, edited))
    texts = (before_update_file(project, before), edited)
    return Change(bundle.state, outcome, locks=project.record_stores, edited_texts=texts)


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


def _changed_since(bundle: BundleState, solution: Solution) -> Iterator[ProjectWarning]:
    """Warn of control and measurements that are not those of the solution; records change with every update."""
    project = bundle.project
    base = project.control_base(bundle.name)
    watched = [project.shown(project.folder / f"{base}.{extension}") for extension in CONTROL_EXTENSIONS]
    now = dict(control_digests(project, base))
    path = project.shown(project.observations(solution.bundle))
    if bundle.is_measured:
        now[path] = bundle.digest_of_observations
    before = dict(solution.inputs)
    for name in [*watched, path]:
        if now.get(name) != before.get(name):
            text = "has changed since the last adjustment, whose values are used nevertheless"
            yield ProjectWarning("out-of-date", name, text)
