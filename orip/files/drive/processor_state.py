"""What an emulated plate processor keeps over a restart: its drive table and where the measuring mark is, as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal, NoReturn

import msgspec
from msgspec import Struct
from msgspec.structs import asdict

from orip.errors import InputError
from orip.files.text.atomic import replace_text
from orip.files.text.lines import existing_bytes

SCHEMA = "orip.plate-processor/1"

Position = tuple[float, float]


class SavedProcessorState(Struct, frozen=True, forbid_unknown_fields=True, tag_field="schema", tag=SCHEMA):
    """The state of a plate processor.

    Parameters
    ----------
    table : str
        Text of the drive table; empty: none.
    model : str
        The active one.
    plates : tuple (upper, lower) of positions (x, y)
        Plate units.
    mark : tuple (X, Y, Z) or None
        Place of the measuring mark in the object; None: where the rays meet.
    condition : {"IN", "OUTSIDE", "LIMIT"}
    """

    table: str
    model: str
    plates: tuple[Position, Position]
    mark: tuple[float, float, float] | None
    condition: Literal["IN", "OUTSIDE", "LIMIT"]


def write_processor_state(path: Path, state: SavedProcessorState) -> None:
    """Write a state; the file is whole at any instant.

    Raises
    ------
    OSError
        If the folder or the disk refuses.
    """
    replace_text(path, json.dumps({"schema": SCHEMA, **asdict(state)}, indent=1, allow_nan=False) + "\n")


def read_processor_state(path: Path, shown: str) -> SavedProcessorState | None:
    """Read a state; None if there is no such file yet.

    Raises
    ------
    InputError
        If the file cannot be read or holds no state.
    """
    data = existing_bytes(path, shown)
    if data is None:
        return None
    try:
        return msgspec.json.decode(data, type=SavedProcessorState)
    except (msgspec.MsgspecError, ValueError, RecursionError) as fault:
        raise_no_state(shown, str(fault))


def raise_no_state(shown: str, reason: str) -> NoReturn:
    """Raise the error of a file that holds no state."""
    message = (
        f"this is not the state of a plate processor, or a damaged one ({reason}); remove the file to begin with an "
        "empty plate processor, or name another one"
    )
    raise InputError.single(message, shown)
