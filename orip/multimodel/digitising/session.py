"""A session of digitising: driving to what is sought, waiting for the operator, and the account of what he did."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from msgspec import Struct, field

from orip.errors import ProjectWarning
from orip.files.log.writing import Log
from orip.multimodel.digitising.operator import Instrument, Named, Operator, Tell, Visit
from orip.multimodel.link.client import ProcessorFault
from orip.multimodel.readout import ObjectReadout
from orip.multimodel.state import Driven, Event, Guide, Position, Rotation, Side, Status
from orip.records.drive_table import STAGES, DriveCode
from orip.records.photo import Stage

Outcome = Literal["digitised", "skipped", "kept"]
"""Skipped: nothing is measured there, and what was measured before is gone. Kept: nothing has changed."""

Ending = Literal["complete", "ended by the operator", "no further input"]

Known = Literal["measured before", "predicted", "middle", "nowhere"]
"""Where a place that is driven to comes from; nowhere: the stage stays where it is, and the operator finds it."""


_DIGITS = tuple("0123456789")
"""Keys that name a point."""


class DriveTarget(NamedTuple):
    """Where to drive to, in plate coordinates, and where that comes from."""

    known: Known
    xy: Position | None


class Entry(Struct, frozen=True):
    """What was done about a mark or point.

    Parameters
    ----------
    what : {"tick", "mark", "point", "temtick", "fiducial", "ground point"}
    owner : str
        Its template (of a tick), temtick, camera (of a fiducial), model (of a ground point) or photo.
    outcome : {"digitised", "skipped", "kept"}
    known : str
        Where the place driven to came from.
    driven : pair or None
        Where that was, in plate coordinates.
    xy : pair or None
        What was digitised, as in the log.
    """

    what: str
    owner: str
    name: str
    outcome: Outcome
    known: Known
    driven: Position | None
    xy: Position | None


class Decision(NamedTuple):
    """What the operator decided, with the plates if he digitised; None: he, or his script, ends the session."""

    outcome: Outcome | None
    plates: tuple[Position, Position] | None = None

    def at(self, stage: Stage) -> Position | None:
        """Return what was digitised on a stage."""
        return self.plates[STAGES.index(stage)] if self.plates is not None else None


class Session(Struct):
    """A session in progress.

    Parameters
    ----------
    tell : function of a line
    entries : list of Entry
        The account so far.
    """

    link: Instrument
    operator: Operator
    log: Log
    tell: Tell
    entries: list[Entry] = field(default_factory=list)
    ending: Ending = "complete"
    warnings: list[ProjectWarning] = field(default_factory=list)

    @property
    def digitised(self) -> int:
        """Return how many marks and points were digitised."""
        return sum(entry.outcome == "digitised" for entry in self.entries)

    def enter(self, entry: Entry) -> None:
        """Add an entry to the account, and report it."""
        self.entries.append(entry)
        xy = "" if entry.xy is None else f"{entry.xy[0]:z12.4f} {entry.xy[1]:z11.4f}"
        self.tell(f"{entry.outcome:<10} {entry.what} {entry.name} of {entry.owner} {xy}".rstrip())

    def drive(self, stage: Stage, place: DriveTarget) -> DriveTarget:
        """Drive a stage to a place; a place beyond its limits is none, and the operator has to look for it."""
        if place.xy is None:
            return place
        try:
            self.link.drive_plate(stage, *place.xy)
        except ProcessorFault as fault:
            if fault.code != DriveCode.OUTSIDE_STAGE:
                raise
            return DriveTarget("nowhere", None)
        return place

    def decision(self, visit: Visit, *, left_switch: Callable[[], None] | None = None) -> Decision:
        """Return what the operator decides about a visit.

        `left_switch` is what the left foot switch does; None: it skips. What was pressed before the stages were where
        they are does not count.
        """
        while True:
            found = self.decision_or_name(visit, left_switch=left_switch)
            if isinstance(found, Decision):
                return found
            self.tell(f"{found.name}: there is nothing to be named here")

    def decision_or_name(self, visit: Visit, *, left_switch: Callable[[], None] | None = None) -> Decision | Named:
        """Return what the operator decides about a visit, or which other point he names; on the keypad by its digits.

        Where the visit is to a new point, ENTER alone (kept) says that there are no more.
        """
        while self.link.next_event() is not None:
            pass
        digits = ""
        while True:
            event = self.operator.act(self.link, visit)
            if isinstance(event, Named):
                return event
            if event is None:
                self.ending = "no further input"
                return Decision(None)
            if event.kind == "LEFT" and left_switch is not None:
                left_switch()
            elif visit.is_new and event.key in _DIGITS:
                digits += event.key
                self.tell(f"name {digits} …")
            elif digits and event.key == "ENTER":
                return Named(digits)
            else:
                return self._decided(event)

    def _decided(self, event: Event) -> Decision:
        if event.kind == "RIGHT":
            return Decision("digitised", event.plates)
        if event.kind == "LEFT":
            return Decision("skipped")
        if event.key == "ENTER":
            return Decision("kept")
        self.ending = "ended by the operator"
        return Decision(None)


class Rehearsal:
    """A plate processor that goes wherever it is sent, and an operator who digitises what he is shown."""

    def __init__(self) -> None:
        self._plates: dict[Stage, Position] = dict.fromkeys(STAGES, (0.0, 0.0))

    def act(self, _link: Instrument, _visit: Visit) -> Event:
        """Digitise."""
        return Event("RIGHT", plates=(self._plates["UPPER"], self._plates["LOWER"]))

    def request(self, line: str) -> str:
        """Do nothing."""
        return line

    def digest(self) -> str:
        """Return no digest: no table is loaded."""
        return ""

    def download(self, _table: bytes) -> str:
        """Load nothing."""
        return ""

    def drive_plate(self, stage: Stage, x: float, y: float) -> Driven:
        """Drive nothing: the place is taken as reached."""
        self._plates[stage] = x, y
        return self._driven()

    def change_model(self, _name: str) -> Driven:
        """Change nothing."""
        return self._driven()

    def position(self, _system: Literal["OBJECT"]) -> ObjectReadout:
        """Return no position in the object."""
        return ObjectReadout((0.0, 0.0, 0.0), 0.0)

    def plates(self) -> tuple[Position, Position]:
        """Return where they were driven to."""
        return self._plates["UPPER"], self._plates["LOWER"]

    def status(self) -> Status:
        """Return that nothing is set."""
        return Status("-", "BOTH", "OUTSIDE", None, (0, 0), False)

    def is_moving(self) -> bool:
        """Return that the stages are at rest."""
        return False

    def guide(self, _system: Guide) -> Status:
        """Set nothing."""
        return self.status()

    def automatic(self, _on: bool) -> Status:
        """Set nothing."""
        return self.status()

    def lock(self, _side: Side | None) -> Status:
        """Lock nothing."""
        return self.status()

    def prism(self, _side: Side | None, degrees: Rotation) -> Status:
        """Turn nothing."""
        return self.status()._replace(prisms=(degrees, degrees))

    def next_event(self) -> Event | None:
        """Have no events."""
        return None

    def _driven(self) -> Driven:
        return Driven("-", self._plates["UPPER"], self._plates["LOWER"])
