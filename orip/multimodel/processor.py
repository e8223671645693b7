"""The plate processor: a drive table is loaded as a whole or not at all, and its first model becomes the active one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.multimodel.movement import drive_object
from orip.multimodel.oriented_block import OrientedBlock, oriented_block
from orip.multimodel.state import Position, ProcessorState
from orip.multimodel.table_checks import table_faults
from orip.records.drive_table import DriveFault, DriveTable


class Loaded(NamedTuple):
    """A table that has been loaded: the block, and the state to begin with."""

    block: OrientedBlock
    state: ProcessorState


def load(table: DriveTable) -> Loaded | tuple[DriveFault, ...]:
    """Load a table; if anything is wrong in it, all faults are returned."""
    faults = table_faults(table)
    if faults:
        return faults
    with np.errstate(all="ignore"):  # a table may have numbers of any size, as long as they agree
        block = oriented_block(table)
        return Loaded(block, first_state(block))


def first_state(block: OrientedBlock) -> ProcessorState:
    """Return the state after loading: the first model, driven to START; in the middle of the stages if that fails."""
    middles: list[Position] = [
        (0.5 * (limits.x_min + limits.x_max), 0.5 * (limits.y_min + limits.y_max))
        for limits in (block.table.upper, block.table.lower)
    ]
    upper, lower = middles
    state, _ = drive_object(block, ProcessorState(0, (upper, lower), None, "OUTSIDE"), block.table.start)
    return state
