"""What an emulated plate processor keeps over a restart: its drive table and where the measuring mark is, as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Literal, NoReturn

from msgspec import Struct
from pydantic import ConfigDict, FiniteFloat, TypeAdapter, ValidationError

from orip.errors import InputError
from orip.files.text.atomic import replace_text
from orip.files.text.lines import existing_bytes

SCHEMA = "orip.plate-processor/1"

Position = tuple[FiniteFloat, FiniteFloat]


class SavedProcessorState(Struct, frozen=True):
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

    __pydantic_config__ = ConfigDict(extra="forbid")

    table: str
    model: str
    plates: tuple[Position, Position]
    mark: tuple[FiniteFloat, FiniteFloat, FiniteFloat] | None
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
        document = json.loads(data)
        if not isinstance(document, dict) or document.pop("schema", None) != SCHEMA:
            raise_no_state(shown, f"it does not begin with the schema {SCHEMA}")
        return TypeAdapter(SavedProcessorState).validate_json(json.dumps(document), strict=True)
    except ValidationError as fault:
        first = fault.errors()[0]
        raise_no_state(shown, f"{'.'.join(map(str, first['loc']))}: {first['msg']}")
    except (ValueError, RecursionError) as fault:
        raise_no_state(shown, str(fault))


def raise_no_state(shown: str, reason: str) -> NoReturn:
    """Raise the error of a file that holds no state."""
    message = (
        f"this is not the state of a plate processor, or a damaged one ({reason}); remove the file to begin with an "
        "empty plate processor, or name another one"
    )
    raise InputError.single(message, shown)
