"""`orip stations`: exposure stations from the files of GNSS and INS."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from orip.cli.options import DryRunOption, Invocation, add_group, command
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.records.control import Station
    from orip.records.epochs import Quality
    from orip.stations.imported import ImportedStations


_ACCEPTED: dict[str, tuple[Quality, ...]] = {
    "fixed": ("fixed", ""),
    "float": ("fixed", "float", ""),
    "all": ("fixed", "float", "code", ""),
}


class FileOptions(NamedTuple):
    """Options that name further files."""

    events: Annotated[
        Path | None,
        typer.Option(
            "--events", metavar="FILE", help="When photos were taken: .MRK, _events.pos, observations, a table."
        ),
    ] = None
    photos: Annotated[
        Path | None,
        typer.Option("--photos", metavar="PATH", help="Times of photos: a table, or the folder of the image files."),
    ] = None
    deviations: Annotated[
        Path | None, typer.Option("--deviations", metavar="FILE", help="Standard deviations of an SBET (SMRMSG).")
    ] = None
    mount: Annotated[
        str | None, typer.Option("--mount", metavar="WHAT", help="Roll, pitch, heading turn a body, or a gimbal.")
    ] = None
    column: Annotated[
        list[str] | None, typer.Option("--column", metavar="KEY=HEADING", help="Which column of a table is what.")
    ] = None


class MatchOptions(NamedTuple):
    """Options of matching events and photos."""

    names: Annotated[
        str | None, typer.Option("--names", metavar="PATTERN", help="Photos by the number of the event: 'DJI_{:04d}'.")
    ] = None
    offset: Annotated[
        float | None, typer.Option("--offset", metavar="SECONDS", help="Event less photo time; else found.")
    ] = None
    tolerance: Annotated[
        float, typer.Option("--tolerance", metavar="SECONDS", help="Within which a photo belongs to an event.")
    ] = 0.75
    accept: Annotated[
        str, typer.Option("--accept", metavar="QUALITY", help="Used are positions: fixed, float (too), all.")
    ] = "fixed"
    no_strips: Annotated[bool, typer.Option("--no-strips", help="Do not divide the flight into strips.")] = False


class WriteOptions(NamedTuple):
    """Options of what is written."""

    error: Annotated[
        str, typer.Option("--error", metavar="E,N,U", help="Standard deviations where the file has none, m.")
    ] = "0.03,0.03,0.05"
    angle_error: Annotated[
        float, typer.Option("--angle-error", metavar="DEGREES", help="That of angles where the file has none.")
    ] = 0.5
    camera: Annotated[str | None, typer.Option("--camera", metavar="NAME", help="Camera of new photos.")] = None
    replace: Annotated[bool, typer.Option("--replace", help="Replace stations that the .STA file has.")] = False
    dry_run: DryRunOption = False


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    text = "Exposure stations from GNSS and INS.\n\nExample: orip stations import DJI_Timestamp.MRK"
    add_group(app, "stations", text, _register)


def _register(group: typer.Typer) -> None:
    @command(group, "import")
    def import_command(
        invocation: Invocation,
        file: Annotated[Path, typer.Argument(metavar="FILE", help="Positions, or a trajectory.")],
        files: FileOptions,
        match: MatchOptions,
        write: WriteOptions,
    ) -> None:
        """Write positions of photos into the .STA file, and photos that are new into orip.toml.

        FILE is a solution of RTKLIB (.pos), an image log of DJI (.MRK), a trajectory (.sbet, .out), a table with a
        heading (.csv, .txt), an image file or a folder of them.

        Example: orip stations import flight.pos --events DJI_Timestamp.MRK
        """
        from orip.stations.exposures import Matching
        from orip.stations.imported import ImportFiles, ImportSettings, import_stations
        from orip.workflow.project.commit import carry_out
        from orip.workflow.records.commands import read_records

        columns = _columns(files.column or [])
        named = ImportFiles(file, files.events, files.photos, files.deviations, columns, _mount(files.mount))
        matching = Matching(
            match.names, match.offset, match.tolerance, _accepted(match.accept), finds_strips=not match.no_strips
        )
        settings = ImportSettings(matching, _errors(write.error), write.angle_error, write.camera, write.replace)
        edit = partial(import_stations, files=named, settings=settings, dry_run=write.dry_run)
        tell(invocation.terminal, carry_out(read_records(invocation.folder), edit).outcome)


def _columns(words: list[str]) -> dict[str, str]:
    from orip.stations.table import HEADINGS

    columns = {}
    for word in words:
        key, equals, heading = word.partition("=")
        if not equals or key not in HEADINGS:
            message = f"--column {word}: write KEY=HEADING; keys are: {', '.join(HEADINGS)}"
            raise UsageError(message)
        columns[key] = heading
    return columns


def _mount(word: str | None) -> Literal["body", "gimbal"] | None:
    if word not in {None, "body", "gimbal"}:
        message = f"--mount {word}: write body or gimbal"
        raise UsageError(message)
    return "gimbal" if word == "gimbal" else "body" if word else None


def _accepted(word: str) -> tuple[Quality, ...]:
    if word not in _ACCEPTED:
        message = f"--accept {word}: write one of {', '.join(_ACCEPTED)}"
        raise UsageError(message)
    return _ACCEPTED[word]


def _errors(text: str) -> tuple[float, float, float]:
    from orip.files.text.decimal_numbers import is_number, parse_number

    parts = text.split(",")
    if len(parts) != 3 or not all(is_number(part) and parse_number(part) > 0.0 for part in parts):
        message = f"--error {text}: write three numbers above 0, east, north and up, such as 0.02,0.02,0.04"
        raise UsageError(message)
    east, north, up = map(parse_number, parts)
    return east, north, up


def tell(terminal: Terminal, outcome: ImportedStations) -> None:
    """Print what was imported."""
    terminal.warn(outcome.warnings)
    if terminal.json:
        terminal.document(
            "stations-import",
            {
                "command": "stations import",
                "file": outcome.shown,
                "dry_run": outcome.dry_run,
                "stations": [station.photo for station in outcome.stations],
                "replaced": outcome.replaced,
                "new_photos": list(outcome.photos),
                "warnings": warning_rows(outcome.warnings),
            },
        )
        return
    would = "would be " if outcome.dry_run else ""
    strips = len({station.strip for station in outcome.stations if station.strip})
    replaced = f", {outcome.replaced} of them {would}replaced" if outcome.replaced else ""
    in_strips = f" in {strips} strip{'s' * (strips != 1)}" if strips else ""
    count = len(outcome.stations)
    terminal.say(f"import   {count} station{'s' * (count != 1)}{in_strips} {would}written to {outcome.shown}{replaced}")
    compared = sum(_is_compared(station) for station in outcome.stations)
    if compared:
        terminal.say(f"         {compared} of them only compared: their errors are negative")
    if outcome.photos:
        new = len(outcome.photos)
        terminal.say(f"         {new} photo{'s' * (new != 1)} {would}added to orip.toml; 'orip init' takes them over")


def _is_compared(station: Station) -> bool:
    return station.position_error[0] < 0.0 or station.angle_error[0] < 0.0
