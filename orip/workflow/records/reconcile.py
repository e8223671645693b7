"""Records of orip.toml against those of the stores: which has changed, and what the stores should hold."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, Generic, Literal, TypeVar

from msgspec import Struct
from msgspec.structs import asdict

from orip.errors import Complaint, InputError
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.stores.digest import record_digest
from orip.records.camera import CAMERA_PARAMETERS, RADIAL_PLACES, Camera
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder

Prefer = Literal["text", "store"]
Action = Literal["added", "changed", "removed", "detached"]

T = TypeVar("T", bound=NamedRecord)


class AppliedChange(Struct, frozen=True):
    """What applying the text does to one record."""

    kind: str
    name: str
    action: Action


class Conflict(Struct, frozen=True):
    """A record that text and store have both changed; `text` names the values on both sides."""

    kind: str
    name: str
    text: str


class Reconciled(Struct, Generic[T], frozen=True):
    """The records that the store should hold (unchanged where there is a conflict), the changes, and the conflicts."""

    records: tuple[StoredRecord[T], ...]
    changes: tuple[AppliedChange, ...]
    conflicts: tuple[Conflict, ...]


def counted_changes(changes: Sequence[AppliedChange]) -> str:
    """Return '1 camera changed, 15 photos added'."""
    counts = Counter((change.kind, change.action) for change in changes)
    return ", ".join(f"{counted(count, kind)} {action}" for (kind, action), count in counts.items())


def reconcile(
    kind: str,
    texts: Sequence[T],
    stored: Sequence[StoredRecord[T]],
    project: str,
    prefer: Prefer | None,
    shared: bool,
) -> Reconciled[T]:
    """Apply the records of a text to those of a store, each only where the text has changed.

    Parameters
    ----------
    kind : str
        What the records are, for messages.
    project : str
        Name of the project that the text belongs to.
    prefer : {"text", "store"} or None
        Which side wins where both have changed; None: neither, that is a conflict.
    shared : bool
        The store may serve other projects: their records stay, and records gone from this text stay too.
    """
    by_key = {record_key(item.record.name): item for item in stored}
    records: list[StoredRecord[T]] = []
    changes: list[AppliedChange] = []
    conflicts: list[Conflict] = []
    for text in texts:
        old = by_key.pop(record_key(text.name), None)
        verdict = _verdict(text, old, project, prefer)
        if isinstance(verdict, str):
            conflicts.append(Conflict(kind, text.name, verdict))
            records += [old] if old is not None else []
            continue
        records.append(verdict)
        if old is None or verdict.record != old.record:
            changes.append(AppliedChange(kind, text.name, "added" if old is None else "changed"))
    for old in by_key.values():
        gone = old.text_digest is not None and old.origin == project
        edited = gone and record_digest(old.record) != old.text_digest
        if not gone:
            records.append(old)
        elif shared or (edited and prefer == "store"):
            records.append(StoredRecord(old.record))
            changes.append(AppliedChange(kind, old.record.name, "detached"))
        elif edited and prefer is None:
            conflicts.append(Conflict(kind, old.record.name, "was removed from the text but was changed in the store"))
            records.append(old)
        else:
            changes.append(AppliedChange(kind, old.record.name, "removed"))
    return Reconciled(tuple(records), tuple(changes), tuple(conflicts))


def _verdict(text: T, old: StoredRecord[T] | None, project: str, prefer: Prefer | None) -> StoredRecord[T] | str:
    """Return the record to keep, or what the conflict is."""
    digest = record_digest(text)
    applied = StoredRecord(text, digest, project)
    if old is None:
        return applied
    if old.text_digest == digest:
        return old
    kept = record_digest(old.record)
    if kept == digest:
        return applied
    foreign = old.origin is not None and old.origin != project
    if (kept == old.text_digest and not foreign) or prefer == "text":
        return applied
    if prefer == "store":
        return StoredRecord(old.record, digest, project)
    if foreign:
        found = f"comes from project {old.origin}"
    elif old.text_digest is None:
        found = "is in the store already, from no text of this project"
    else:
        found = "was changed both in the text and in the store"
    return f"{found}: {'; '.join(differences(text, old.record))}"


def differences(text: object, store: object) -> list[str]:
    """Return 'C is 8.6 in the text and 8.595 in the store' for each value in which two records differ."""
    found = []
    in_store = asdict(store)  # type: ignore[arg-type]
    for field, value in asdict(text).items():  # type: ignore[arg-type]
        for name, a, b in _named_values(field, value, in_store[field]):
            if a != b:
                found.append(f"{name} is {_shown(a)} in the text and {_shown(b)} in the store")
    return found


_PARTS = {
    ("parameters", len(CAMERA_PARAMETERS)): CAMERA_PARAMETERS,
    ("orientation", len(PHOTO_PARAMETERS)): PHOTO_PARAMETERS,
}


def _named_values(name: str, a: Any, b: Any) -> list[tuple[str, Any, Any]]:
    names = _PARTS.get((name, len(a))) if isinstance(a, tuple) else None
    return list(zip(names, a, b, strict=True)) if names else [(name, a, b)]


def _shown(value: Any) -> str:
    if value is None or value == ():
        return "not given"
    if isinstance(value, tuple):
        return "[" + ", ".join(_shown(getattr(item, "name", item)) for item in value) + "]"
    return str(value)


class TextApplied(Struct, frozen=True):
    """The definitions after orip.toml is applied, what that changes, and a complaint for every conflict."""

    definitions: StoredDefinitions
    changes: tuple[AppliedChange, ...]
    complaints: tuple[Complaint, ...]


def apply_text(project: ProjectFolder, old: StoredDefinitions, prefer: Prefer | None) -> TextApplied:
    """Apply the records of orip.toml to those of the stores; nothing is written."""
    text, name = project.definition, project.definition.name
    cameras = reconcile(
        "camera", [with_polynomial(camera) for camera in text.cameras], old.cameras, name, prefer, shared=True
    )
    temticks = reconcile("temtick", text.temticks, old.temticks, name, prefer, shared=True)
    templates = reconcile("template", text.templates, old.templates, name, prefer, shared=False)
    photos = reconcile("photo", text.photos, old.photos, name, prefer, shared=False)
    bundles = reconcile("bundle", text.bundles, old.bundles, name, prefer, shared=False)
    outcomes = (cameras, temticks, templates, photos, bundles)
    return TextApplied(
        StoredDefinitions(cameras.records, temticks.records, templates.records, photos.records, bundles.records),
        tuple(change for outcome in outcomes for change in outcome.changes),
        tuple(_complaints(project, (conflict for outcome in outcomes for conflict in outcome.conflicts))),
    )


def with_polynomial(camera: Camera) -> Camera:
    """Return the camera with its distortion converted to the polynomial, if it was given in another form.

    Raises
    ------
    InputError
        If that form has no polynomial.
    """
    if camera.distortion_isp is None and camera.distortion_curve is None:
        return camera
    try:
        polynomial = _polynomial(camera)
    except (ValueError, ArithmeticError) as fault:
        form = "distortion_curve" if camera.distortion_isp is None else "distortion_isp"
        message = f"{form} of camera '{camera.name}' has no polynomial ({fault}); correct it"
        raise InputError.single(message) from fault
    parameters = list(camera.parameters)
    parameters[RADIAL_PLACES] = polynomial
    return replace(camera, parameters=tuple(parameters))


def _polynomial(camera: Camera) -> list[float]:
    from orip.interior.distortion import polynomial_from_curve, polynomial_from_isp  # few cameras have them

    if camera.distortion_isp is not None:
        coefficients = polynomial_from_isp(camera.distortion_isp)
    else:
        coefficients, _ = polynomial_from_curve(camera.distortion_curve or ())
    polynomial: list[float] = coefficients.tolist()
    if not all(map(math.isfinite, polynomial)):
        message = "its numbers are too large"
        raise ArithmeticError(message)
    return polynomial


def _complaints(project: ProjectFolder, conflicts: Iterable[Conflict]) -> list[Complaint]:
    remedy = "keep one of them with 'orip init --prefer text' or 'orip init --prefer store'"
    return [
        Complaint(
            f"{conflict.kind} {conflict.name} {conflict.text}; {remedy}",
            project.shown(project.text),
            project.lines.get((conflict.kind, record_key(conflict.name))),
        )
        for conflict in conflicts
    ]
