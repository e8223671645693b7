"""The plate processor with what is loaded into it, and the time that its stages take to where they are driven."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from math import dist, floor
from typing import NamedTuple

from msgspec import Struct

from orip.multimodel.oriented_block import OrientedBlock, oriented_block
from orip.multimodel.processor import Loaded, first_state
from orip.multimodel.state import Condition, Position, ProcessorState
from orip.records.drive_table import (
    DriveCamera,
    DriveFault,
    DriveModel,
    DrivePhoto,
    DriveTable,
    StageLimits,
    Triple,
)
from orip.structs import replace

# Without a table the stages can be driven in plate coordinates and be read, as the measurement of templates and photos
# needs it: `bare_stages` is a block of one model that stands for the two of them. Whatever asks for an orientation is
# refused then.

TableLoader = Callable[[bytes], Loaded | tuple[DriveFault, ...]]
"""Makes a block from the bytes of a drive table, or tells all that is wrong with it."""

NO_MODEL = "-"
"""Name of the model without a table."""

_REACH = 20_000.0
"""Plate units; where on their stages films or digital frames lie, only a table tells."""

Stages = tuple[StageLimits, StageLimits]
"""Limits of the (upper, lower) stage."""

_DSR = StageLimits(-120.0, 120.0, -120.0, 120.0, 0.001)

DSR_STAGES: Stages = (_DSR, _DSR)
"""The Kern DSR: 240 mm of travel in x and y, read out to 1 µm; plate coordinates are 0 in the middle."""


class MeasuringMark(NamedTuple):
    """Where the measuring mark is: the active model, the plates, and the place in the object if it was driven there."""

    model: str
    plates: tuple[Position, Position]
    xyz: Triple | None
    condition: Condition


class Station(Struct, frozen=True):
    """A plate processor.

    Parameters
    ----------
    state : ProcessorState
        Where everything is, or is going to.
    table : bytes
        The drive table as it was loaded; empty: none.
    digest : str
        Its SHA-256, hexadecimal.
    on_the_way : ProcessorState or None
        What shows while the stages are on their way.
    is_paced : bool
        Travel takes time.
    stages : Stages or None
        How far the stages go, mm, whatever a table says; one in pixels is of no such stages. None: as the table says.
    """

    block: OrientedBlock
    state: ProcessorState
    table: bytes = b""
    digest: str = ""
    on_the_way: ProcessorState | None = None
    is_paced: bool = False
    stages: Stages | None = None

    @property
    def is_ready(self) -> bool:
        """Return whether a table is loaded."""
        return bool(self.table)

    @property
    def shown(self) -> ProcessorState:
        """Return the state that read-outs show."""
        return self.on_the_way or self.state

    @property
    def mark(self) -> MeasuringMark:
        """Return where the measuring mark is."""
        state = self.state
        return MeasuringMark(self.block.models[state.model].name, state.plates, state.mark, state.condition)

    def loaded(self, data: bytes, load: TableLoader) -> Station | tuple[DriveFault, ...]:
        """Return the station with another table, or all that is wrong with that."""
        found = load(data)
        if not isinstance(found, Loaded):
            return found
        table = found.block.table
        if self.stages is not None and table.plate_unit == "mm":
            upper, lower = self.stages
            block = oriented_block(replace(table, upper=upper, lower=lower))
            found = Loaded(block, first_state(block))
        digest = hashlib.sha256(data).hexdigest()
        return Station(*found, data, digest, is_paced=self.is_paced, stages=self.stages)

    def at(self, mark: MeasuringMark) -> Station | None:
        """Return the station with its measuring mark elsewhere; None if it has no such model or position."""
        model = self.block.model_index(mark.model)
        limits = (self.block.table.upper, self.block.table.lower)
        for (x, y), stage in zip(mark.plates, limits, strict=True):
            if not (stage.x_min <= x <= stage.x_max and stage.y_min <= y <= stage.y_max):
                return None
        if model is None:
            return None
        state = replace(self.state, model=model, plates=mark.plates, mark=mark.xyz, condition=mark.condition)
        return replace(self, state=state)


def bare_stages(*, is_paced: bool = False, stages: Stages | None = None) -> Station:
    """Return a station without a table, in the middle of its stages, guiding the upper one."""
    anywhere = StageLimits(-_REACH, _REACH, -_REACH, _REACH, 0.001)
    upper, lower = stages or (anywhere, anywhere)
    camera = DriveCamera("-", (1.0, *(0.0,) * 10), (0.0, 0.0), "ideal")
    level, unit = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    photos = (
        DrivePhoto("LEFT", "-", None, "UPPER", (0.0, 0.0, 1.0), level, unit),
        DrivePhoto("RIGHT", "-", None, "LOWER", (1.0, 0.0, 1.0), level, unit),
    )
    model = DriveModel(NO_MODEL, 1, 1, "LEFT", "RIGHT", "NORMAL")
    table = DriveTable("-", "-", "", "mm", "-", upper, lower, (camera,), (), photos, (model,), (0.0, 0.0, 0.0))
    state = ProcessorState(0, (_middle(upper), _middle(lower)), None, "IN", guide="UPPER")
    return Station(oriented_block(table), state, is_paced=is_paced, stages=stages)


def _middle(stage: StageLimits) -> Position:
    return 0.5 * (stage.x_min + stage.x_max), 0.5 * (stage.y_min + stage.y_max)


Plates = tuple[Position, Position]


class Pace(NamedTuple):
    """Speed of a stage, plate units a second, and how often a second its place is set."""

    speed: float
    rate_hz: float


class Travel(NamedTuple):
    """Where the stages were, (upper, lower), when they set off, and the time then, s."""

    origin: Plates
    began_s: float


def on_the_way(pace: Pace, travel: Travel, goal: ProcessorState, now_s: float) -> ProcessorState | None:
    """Return what shows of stages that go to their places straight and at equal speed; None: they have arrived."""
    covered = pace.speed * floor((now_s - travel.began_s) * pace.rate_hz) / pace.rate_hz
    pairs = zip(travel.origin, goal.plates, strict=True)
    upper, lower = (_between(origin, end, covered) for origin, end in pairs)
    if (upper, lower) == goal.plates:
        return None
    return replace(goal, plates=(upper, lower), mark=None)


def _between(origin: Position, end: Position, covered: float) -> Position:
    length = dist(origin, end)
    if covered >= length:
        return end
    part = covered / length
    return origin[0] + part * (end[0] - origin[0]), origin[1] + part * (end[1] - origin[1])
