"""The state of the plate processor, and what it replies.

A command is a function ``command(block, state, …) -> (state, reply)``. Nothing is changed in place: a command that
cannot be done returns the state that it was given, and a `DriveFault`. Which module has which:

    orip.multimodel.movement    drive_object drive_model drive_plate drive_photo move change_model next_model forward
    orip.multimodel.panel       guide automatic lock prism foot key next_event
    orip.multimodel.readout     status which and positions; they change nothing and return the reply alone
    orip.multimodel.driving     drive_objects and profile: many points at once

`orip.multimodel.processor.load` makes the block and its first state from a drive table.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from msgspec import Struct

from orip.multimodel.model_loop import ModelLoop
from orip.multimodel.oriented_block import OrientedBlock
from orip.records.drive_table import STAGES, DriveFault, Triple
from orip.records.project.photo import Stage
from orip.structs import replace

Guide = Literal["UPPER", "LOWER", "BOTH", "MODEL", "OBJECT"]
GUIDES: tuple[Guide, ...] = ("UPPER", "LOWER", "BOTH", "MODEL", "OBJECT")
"""Guiding systems in the order of their numbers 1 to 5."""

Side = Literal["LEFT", "RIGHT"]
SIDES: tuple[Side, Side] = ("LEFT", "RIGHT")

Condition = Literal["IN", "OUTSIDE", "LIMIT"]
"""The mark is inside the active model; it is not; the plates are at the front."""

Rotation = Literal[0, 90]
"""Degrees by which a prism turns what the eye sees."""

Position = tuple[float, float]
"""Plate coordinates x, y."""

MOST_EVENTS = 1000
"""Most events in the queue; of more that nobody asks for the oldest are forgotten."""


class Event(NamedTuple):
    """What the operator did.

    Attributes
    ----------
    kind : {"RIGHT", "LEFT", "KEY"}
        Foot switches: right to digitise, left to skip or to lock; or a key.
    key : str
        ``0`` to ``15``, ``ENTER`` or ``ZERO``; empty for a foot switch.
    plates : tuple (upper, lower) of positions, or None
        Read-out of both stages at the moment of a RIGHT.
    """

    kind: Literal["RIGHT", "LEFT", "KEY"]
    key: str = ""
    plates: tuple[Position, Position] | None = None


class ProcessorState(Struct, frozen=True):
    """Everything that a command may change.

    Parameters
    ----------
    model : int
        Place of the active model in the block.
    plates : tuple (upper, lower) of positions
        Plate units, unrounded.
    mark : tuple (X, Y, Z) or None
        Where the measuring mark was driven to in the object; None after plates were moved individually: it is then
        where the two rays meet.
    condition : {"IN", "OUTSIDE", "LIMIT"}
    guide : Guide
    automatic : bool
        Models change at frame lines.
    locked : {"UPPER", "LOWER"} or None
        The stage that does not move. While one is locked, models do not change automatically: its photo would change.
    prisms : tuple (left, right)
    events : tuple of Event
        Oldest first.
    """

    model: int
    plates: tuple[Position, Position]
    mark: Triple | None
    condition: Condition
    guide: Guide = "OBJECT"
    automatic: bool = True
    locked: Stage | None = None
    prisms: tuple[Rotation, Rotation] = (0, 0)
    events: tuple[Event, ...] = ()

    @property
    def switches(self) -> bool:
        """Return whether the model may change when the mark leaves it."""
        return self.automatic and self.locked is None

    def plate(self, stage: Stage) -> Position:
        """Return the position of a stage."""
        return self.plates[STAGES.index(stage)]

    def with_plate(self, stage: Stage, position: Position) -> ProcessorState:
        """Return the state with one stage at another position."""
        upper, lower = self.plates
        return replace(self, plates=(position, lower) if stage == "UPPER" else (upper, position))


class Driven(NamedTuple):
    """Reply to a movement: the active model and the read-out of both stages."""

    model: str
    upper: Position
    lower: Position


class Status(NamedTuple):
    """Reply to settings: everything that is set; `lock` is the locked photo's side in the active model."""

    model: str
    guide: Guide
    condition: Condition
    lock: Side | None
    prisms: tuple[Rotation, Rotation]
    automatic: bool


Outcome = tuple[ProcessorState, Driven | DriveFault]
"""What a movement returns."""


def active_model(block: OrientedBlock, state: ProcessorState) -> ModelLoop:
    """Return the active model."""
    return block.models[state.model]


def driven(block: OrientedBlock, state: ProcessorState) -> Driven:
    """Return the reply to a movement that has led to a state."""
    return Driven(active_model(block, state).name, *read_out(block, state))


def read_out(block: OrientedBlock, state: ProcessorState) -> tuple[Position, Position]:
    """Return the plate positions rounded to the least counts."""
    return _rounded(state.plates[0], block.table.upper.least_count), _rounded(
        state.plates[1], block.table.lower.least_count
    )


def _rounded(position: Position, least_count: float) -> Position:
    x, y = position
    # adding zero takes the sign from a rounded -0
    return round(x / least_count) * least_count + 0.0, round(y / least_count) * least_count + 0.0
