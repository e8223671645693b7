"""`orip digitise fiducials` and `ticks`: marks for the records of a camera or temtick, measured on a bare stage.

The coordinates of fiducial marks are plate coordinates that are taken into the system of the marks when the log is
replayed (`orip.interior.mounting`); tick marks keep their plate coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, TypeVar

import numpy as np
from msgspec import Struct

from orip.errors import InputError, ProjectWarning, UsageError
from orip.files.log.writing import fiducials_header, measurement_line, ticks_header
from orip.interior.mounting import fiducials_from_plate
from orip.multimodel.digitising.operator import Named, Sought, Visit
from orip.multimodel.digitising.order import next_name
from orip.multimodel.digitising.session import Entry, Session
from orip.multimodel.digitising.setup import Digitised, DigitisingSetup
from orip.multimodel.state import Position
from orip.records.camera import Camera, Mark
from orip.records.measurement import MeasuredMarks
from orip.records.names import name_fault, near_names, record_key
from orip.records.photo import Stage, Temtick
from orip.structs import replace

FEWEST_FIDUCIALS = 4
FEWEST_TICKS = 2
"""With fewer marks a record is of no use; the log has them from then on, so that it can always be replayed."""

Owner = TypeVar("Owner", Camera, Temtick)


class _Record(Struct, frozen=True):
    """Whose marks are digitised.

    `transformed` takes plate coordinates to those of the record, and raises ValueError where they make none.
    """

    what: Literal["FIDUCIAL", "TEMTICK"]
    name: str
    stage: Stage
    header: str
    fewest: int
    transformed: Callable[[MeasuredMarks], tuple[Mark, ...]]

    @property
    def title(self) -> str:
        """Return what is digitised."""
        return f"fiducials {self.name}" if self.what == "FIDUCIAL" else f"ticks {self.name}"


def digitise_fiducials(
    setup: DigitisingSetup,
    camera: str,
    arrangement: Literal["corners", "midsides"],
    stage: Stage,
    names: Sequence[str] = (),
) -> Digitised:
    """Digitise the fiducial marks of a camera in one photo: four or more, named or numbered.

    Parameters
    ----------
    arrangement : {"corners", "midsides"}
        Where the four marks are that make the fiducial system.
    stage : {"UPPER", "LOWER"}
        Where the photo lies.
    names : sequence of str
        In their order; none: they are numbered, until the operator says that there are no more.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    films = setup.films()
    record = _defined(films.definitions.cameras, "camera", camera)
    if record.sensor is not None:
        message = f"camera {record.name} has a sensor, and a digital frame has no fiducial marks"
        raise InputError.single(message)
    marks = _Record(
        "FIDUCIAL", record.name, stage, fiducials_header(record.name, arrangement), FEWEST_FIDUCIALS,
        lambda measured: fiducials_from_plate(measured, arrangement),
    )  # fmt: skip
    with setup.session(films, f"all of it is in {films.shown_log}; repeat the command") as session:
        _digitise(session, marks, names)
    return setup.outcome(films, session)


def digitise_ticks(setup: DigitisingSetup, temtick: str, stage: Stage, names: Sequence[str] = ()) -> Digitised:
    """Digitise the tick marks of a temtick record on one template; parameters are those of `digitise_fiducials`.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    films = setup.films()
    record = _defined(films.definitions.temticks, "temtick", temtick)

    def transformed(measured: MeasuredMarks) -> tuple[Mark, ...]:
        return tuple(Mark(name, x, y) for name, (x, y) in zip(measured.names, measured.measured.tolist(), strict=True))

    marks = _Record("TEMTICK", record.name, stage, ticks_header(record.name), FEWEST_TICKS, transformed)
    with setup.session(films, f"all of it is in {films.shown_log}; repeat the command") as session:
        _digitise(session, marks, names)
    return setup.outcome(films, session)


def _defined(records: Mapping[str, Owner], kind: str, name: str) -> Owner:
    found = records.get(record_key(name))
    if found is None:
        message = f"{kind} {name} is not defined; {near_names(name, (record.name for record in records.values()))}"
        raise UsageError(message)
    return found


def _digitise(session: Session, record: _Record, names: Sequence[str]) -> None:
    faults = [fault for name in names if (fault := name_fault(name)) is not None]
    if faults or len(set(names)) < len(names):
        message = "; ".join(faults) or f"a mark is named twice: {' '.join(names)}"
        raise UsageError(message)
    found: dict[str, Position] = {}
    session.log.chapter(f"orip digitise {record.title}")
    session.link.guide(record.stage)
    waiting, named = list(names), ""
    while session.ending == "complete" and (waiting or not names):
        name = named or (waiting[0] if waiting else next_name("1", found))
        session.tell(f"at {record.title} mark {name} on the {record.stage} stage")
        sought = Sought(record.what, record_key(record.name), name, record.stage)
        decision = session.decision_or_name(Visit((sought,), "FOOT LEFT" if names else "KEY ENTER", is_new=not names))
        named = decision.name if isinstance(decision, Named) else ""
        if isinstance(decision, Named) or decision.outcome is None:
            continue
        if decision.outcome == "kept" and not names:
            break
        waiting = waiting[1:]
        xy = decision.at(record.stage)
        if xy is not None:
            found[name] = xy
            _put(session, record, found)
        session.enter(Entry(record.what.lower(), record.name, name, decision.outcome, "nowhere", None, xy))
    if len(found) < record.fewest:
        text = f"{len(found)} marks digitised of at least {record.fewest}; nothing is written"
        session.warnings.append(ProjectWarning("too-few-marks", record.title, text))
        session.entries[:] = [replace(entry, outcome="skipped", xy=None) for entry in session.entries]


def _put(session: Session, record: _Record, found: Mapping[str, Position]) -> None:
    """Write the marks as soon as they suffice for the record, and report their coordinates in it."""
    measured = MeasuredMarks(
        tuple(found), np.array(list(found.values())), np.zeros(len(found), dtype=bool), np.full((len(found), 2), np.nan)
    )
    if len(found) < record.fewest:
        return
    try:
        marks = record.transformed(measured)
    except ValueError as fault:
        session.tell(f"  not written yet: {fault}")
        return
    session.log.put(record.header, [measurement_line(name, xy) for name, xy in found.items()])
    session.tell("  " + "  ".join(f"{mark.name} {mark.x:z.4f} {mark.y:z.4f}" for mark in marks))
