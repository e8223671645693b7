"""`orip drive emulate`: the emulated plate processor from its start to a signal, and the file that keeps its state."""

from __future__ import annotations

import asyncio
import errno
import json
import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Literal, NoReturn

import msgspec
from msgspec import Struct
from msgspec.structs import asdict

from orip.errors import InputError, LinkError, OripError, UsageError
from orip.files.text.atomic import replace_text, reporting_failure
from orip.files.text.lines import existing_bytes
from orip.multimodel.link.emulator import Emulator
from orip.multimodel.link.station import DSR_STAGES, MeasuringMark, Pace, Stages, Station, bare_stages
from orip.multimodel.table_step import load_drive_table
from orip.records.drive_table import StageLimits
from orip.web.access import listening_address, new_token, token_kept

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


FARTHEST_MM = 10_000.0
"""No stage goes farther."""


class EmulatorSettings(Struct, frozen=True):
    """How a plate processor is emulated.

    Parameters
    ----------
    listen : str
        ``host:port``; port 0: any that is free.
    state : Path or None
        File to keep table and mark in.
    pace : Pace or None
        None: movements take no time.
    is_remote_allowed : bool
        Programs on other machines may connect, if they have the token.
    stages : Stages or None
        How far the stages go; None: as a drive table says.
    """

    listen: str
    state: Path | None = None
    pace: Pace | None = None
    is_remote_allowed: bool = False
    stages: Stages | None = DSR_STAGES


def emulate(settings: EmulatorSettings, listening: Callable[[str, str], None], trouble: Callable[[str], None]) -> str:
    """Serve until SIGINT or SIGTERM, and return the signal's name.

    Parameters
    ----------
    listening : function of ``host:port`` and the token
        Called when clients may connect.
    trouble : function of a sentence
        Called when the state cannot be written; serving goes on.

    Raises
    ------
    UsageError
        If the address is none, or not this machine's alone.
    InputError
        If the state file is damaged.
    LinkError
        If the address cannot be listened at.
    OripError
        If the state file cannot be written.
    """
    host, port = _address(settings)
    station = bare_stages(stages=settings.stages)
    if settings.state is not None:
        station = _restored(station, settings.state)
    if settings.state is not None:
        _keep(settings.state, station)  # better to hear now than after a day's work that it cannot be

    def keep(changed: Station) -> None:
        try:
            _keep(settings.state, changed)
        except OripError as error:
            trouble(str(error))

    token, kept = new_token(), ExitStack()

    def told(address: tuple[str, int]) -> None:
        kept.enter_context(token_kept(*address, token))
        listening(_joined(*address), token)

    emulator = Emulator(station, load_drive_table, keep if settings.state else None, settings.pace, token=token)
    try:
        with kept:
            return asyncio.run(_serve_until_signal(emulator, host, port, told))
    except OSError as error:
        message = f"cannot listen on {settings.listen}: {error.strerror or error}; name another address with --listen"
        if error.errno == errno.EADDRINUSE:
            message = (
                f"{settings.listen} is in use by another program, perhaps another emulator; stop that one, or name "
                "another port with --listen"
            )
        raise LinkError(message) from error


async def _serve_until_signal(
    emulator: Emulator, host: str, port: int, listening: Callable[[tuple[str, int]], None]
) -> str:
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[str] = loop.create_future()

    def end(name: str) -> None:
        if not ended.done():
            ended.set_result(name)

    for stop_signal in (signal.SIGINT, signal.SIGTERM):
        try:
            loop.add_signal_handler(stop_signal, end, stop_signal.name)
        except NotImplementedError:  # Windows
            signal.signal(
                stop_signal, lambda number, _frame: loop.call_soon_threadsafe(end, signal.Signals(number).name)
            )
    await emulator.serve(host, port, lambda *address: listening(address), ended)
    return await ended


def _address(settings: EmulatorSettings) -> tuple[str, int]:
    otherwise = ", or allow those that have the token of this run with --allow-remote"
    return listening_address(settings.listen, None if settings.is_remote_allowed else otherwise)


def _joined(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def stages_of_words(text: str) -> Stages | None:
    """Return the stages that are named: ``dsr``, ``table``, or ``x_min,x_max,y_min,y_max`` of both in mm.

    Raises
    ------
    UsageError
        If they are none of these, or have no area.
    """
    named: dict[str, Stages | None] = {"dsr": DSR_STAGES, "table": None}
    if text.lower() in named:
        return named[text.lower()]
    try:
        x_min, x_max, y_min, y_max = map(float, text.split(","))
    except ValueError:
        x_min = x_max = y_min = y_max = 0.0
    if not (-FARTHEST_MM <= x_min < x_max <= FARTHEST_MM and -FARTHEST_MM <= y_min < y_max <= FARTHEST_MM):
        message = (
            f"'{text}' names no stages; write dsr, table, or x_min,x_max,y_min,y_max in mm, for example "
            "-120,120,-120,120"
        )
        raise UsageError(message)
    stage = StageLimits(x_min, x_max, y_min, y_max, DSR_STAGES[0].least_count)
    return stage, stage


def _restored(station: Station, path: Path) -> Station:
    kept = read_processor_state(path, str(path))
    if kept is None:
        return station
    if kept.table:
        loaded = station.loaded(kept.table.encode("utf-8"), load_drive_table)
        if not isinstance(loaded, Station):
            raise_no_state(str(path), f"its drive table: {loaded[0].text}")
        station = loaded
    restored = station.at(MeasuringMark(kept.model, kept.plates, kept.mark, kept.condition))
    if restored is None:
        raise_no_state(
            str(path), f"model {kept.model} or its plate positions are not within its drive table and the stages"
        )
    return restored


def _keep(path: Path | None, station: Station) -> None:
    if path is None:
        return
    mark = station.mark
    state = SavedProcessorState(station.table.decode("ascii"), mark.model, mark.plates, mark.xyz, mark.condition)
    with reporting_failure(path, "the plate processor's state is not kept"):
        write_processor_state(path, state)
