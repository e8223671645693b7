"""`orip gnss positions`: positions of a receiver from its observations and those of a base."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer

from orip.cli.options import DryRunOption, Invocation, command
from orip.cli.terminal import warning_rows
from orip.errors import UsageError
from orip.stations.gnss.rtklib import SYSTEMS, Way

if TYPE_CHECKING:
    from collections.abc import Iterator

    from orip.arrays import FloatArray
    from orip.stations.gnss.processing import GnssResult
    from orip.stations.gnss.solution import SatelliteUse

_LEAST_DEVIATION = 1e-4
_WAYS: dict[str, Way] = {"static": "static", "kinematic": "kinematic", "epochs": "epochs"}
_WAY_TEXTS = {"static": "rover standing", "kinematic": "rover moving", "epochs": "every epoch by itself"}


class BaseOptions(NamedTuple):
    """Where the marks and the antennas are."""

    place: Annotated[
        str | None,
        typer.Option(
            "--base", metavar="X,Y,Z", help="Geocentric coordinates of the base's mark, m; else its header's."
        ),
    ] = None
    base_height: Annotated[
        float | None,
        typer.Option(
            "--base-height", metavar="METRES", min=-100.0, max=100.0, help="Antenna above mark; else header's."
        ),
    ] = None
    rover_height: Annotated[
        float | None,
        typer.Option(
            "--rover-height", metavar="METRES", min=-100.0, max=100.0, help="Antenna above mark; else header's."
        ),
    ] = None


class AntennaOptions(NamedTuple):
    """Calibrations of antennas."""

    antex: Annotated[
        Path | None, typer.Option("--antex", metavar="FILE", help="Calibrations of the antennas (and satellites).")
    ] = None
    rover_antenna: Annotated[
        str, typer.Option("--rover-antenna", metavar="TYPE", help="Type and radome; else the header's.")
    ] = ""
    base_antenna: Annotated[
        str, typer.Option("--base-antenna", metavar="TYPE", help="Type and radome; else the header's.")
    ] = ""


class UsedOptions(NamedTuple):
    """What is used of the observations."""

    elevation: Annotated[
        float, typer.Option("--elevation", metavar="DEGREES", help="Least elevation of satellites.")
    ] = 15.0
    systems: Annotated[
        str, typer.Option("--systems", metavar="LETTERS", help="GPS G, GLONASS R, Galileo E, QZSS J, BeiDou C.")
    ] = "GREJC"
    frequencies: Annotated[int, typer.Option("--frequencies", metavar="N", help="1, 2 or 3.")] = 2


def register_positions(group: typer.Typer) -> None:
    """Add the command."""

    @command(group, "positions")
    def positions_command(
        invocation: Invocation,
        rover: Annotated[Path, typer.Argument(metavar="ROVER", help="Observations: RINEX, UBX, RTCM 3.")],
        base: Annotated[Path, typer.Argument(metavar="BASE", help="Those of a receiver at a known place.")],
        orbits: Annotated[list[Path], typer.Argument(metavar="NAV...", help="Orbits: RINEX, SP3 and CLK.")],
        places: BaseOptions,
        antennas: AntennaOptions,
        used: UsedOptions,
        way: Annotated[
            str, typer.Option("--way", metavar="WAY", help="kinematic, static, or epochs: each alone.")
        ] = "kinematic",
        output: Annotated[
            Path | None, typer.Option("--output", "-o", metavar="FILE", help="Instead of ROVER.pos.")
        ] = None,
        point: Annotated[
            str | None, typer.Option("--point", metavar="NAME", help="Standing: write the place into the .PNT file.")
        ] = None,
        dry_run: DryRunOption = False,
    ) -> None:
        """Compute the positions of a receiver from its observations and those of a base, with RTKLIB.

        Forward and backward in time; where the two contradict each other, and what else is not to be trusted, is said.

        Example: orip gnss positions flight.obs base.obs flight.nav
        """
        from orip.files.text.atomic import write_output
        from orip.stations.gnss.processing import GnssFiles, process_gnss
        from orip.stations.in_project import require_solution

        folder = invocation.folder
        files = GnssFiles(
            folder / rover, folder / base, tuple(folder / path for path in orbits), _way(way), place_of(places.place),
            places.rover_height, places.base_height, elevation_of(used.elevation), systems_of(used.systems),
            frequencies_of(used.frequencies), None if antennas.antex is None else folder / antennas.antex,
            antennas.rover_antenna, antennas.base_antenna,
        )  # fmt: skip
        if point is not None and files.way != "static":
            message = "--point writes the place of a receiver that stands; add --way static"
            raise UsageError(message)
        target = folder / (output or Path(f"{rover.name.split('.')[0] or rover.name}.pos"))
        require_solution(target, [files.rover, files.base, *files.orbits, *([files.antex] if files.antex else [])])
        result = process_gnss(files)
        added = None if point is None else _add_point(invocation, result, point, dry_run=dry_run)
        if not dry_run:
            write_output(target, result.text)
        _tell(invocation, result, target, dry_run=dry_run)
        if added is not None:
            invocation.terminal.point("would add" if dry_run else "added", f"{point} to {added}")


def _way(word: str) -> Way:
    if word not in _WAYS:
        message = f"--way {word}: write one of {', '.join(_WAYS)}"
        raise UsageError(message)
    return _WAYS[word]


def place_of(text: str | None, option: str = "--base") -> tuple[float, float, float] | None:
    """Return geocentric coordinates; raises UsageError for what are none."""
    from orip.files.text.decimal_numbers import is_number, parse_number
    from orip.stations.gnss.processing import is_on_earth

    if text is None:
        return None
    parts = text.split(",")
    numbers = [parse_number(part) if is_number(part) else np.nan for part in parts]
    if len(numbers) != 3 or not is_on_earth(numbers):
        message = (
            f"{option} {text}: write geocentric X, Y and Z in metres, such as -3978242.4348,3382841.1715,3649902.7667"
        )
        raise UsageError(message)
    return numbers[0], numbers[1], numbers[2]


def elevation_of(degrees: float) -> float:
    """Return a least elevation; raises UsageError for what is none."""
    if not 0.0 <= degrees <= 60.0:
        message = f"--elevation {degrees:g}: write degrees from 0 to 60"
        raise UsageError(message)
    return degrees


def systems_of(letters: str) -> str:
    """Return letters of satellite systems; raises UsageError for others."""
    wanted = letters.upper().replace(",", "")
    if not wanted or set(wanted) - SYSTEMS.keys():
        message = f"--systems {letters}: write letters of {''.join(SYSTEMS)}, such as GE"
        raise UsageError(message)
    return wanted


def frequencies_of(count: int) -> int:
    """Return a number of frequencies; raises UsageError for others."""
    if not 1 <= count <= 3:
        message = f"--frequencies {count}: write 1, 2 or 3"
        raise UsageError(message)
    return count


def _tell(invocation: Invocation, result: GnssResult, target: Path, *, dry_run: bool) -> None:
    terminal = invocation.terminal
    terminal.warn(result.warnings)
    if terminal.json:
        terminal.document("gnss", _document(result, target, dry_run=dry_run))
        return
    for label, text in _lines(result):
        terminal.point(label, text)
    terminal.point("would write" if dry_run else "wrote", target.name)
    if not dry_run and result.settings.way != "static":
        events = result.rover.path.name if len(result.rover.events) else "FILE"
        terminal.point(
            "next", f"orip stations import {target.name} --events {events}   (.MRK, _events.pos, a table of times)"
        )


def _lines(result: GnssResult) -> Iterator[tuple[str, str]]:
    from orip.stations.gnss.processing import stretch_text

    joined = result.joined
    solution = joined.solution
    name, base = result.rover.marker or result.rover.shown, result.base.marker or result.base.shown
    engine = Path(result.engine).name
    yield (
        "gnss",
        f"{name} from {base}, {result.rover.span} (GPS time), {_WAY_TEXTS[result.settings.way]}; RTKLIB ({engine})",
    )
    x, y, z = result.settings.base
    is_of_header = np.array_equal(result.base.place, (x, y, z))
    whose = ", as in its header (else --base)" if is_of_header else ""
    yield "base", f"X {x:.4f}, Y {y:.4f}, Z {z:.4f} m{whose}"
    fixed = int(np.count_nonzero(solution.is_fixed))
    floating = int(np.count_nonzero(solution.quality == 2))
    kinds = f"{fixed} fixed, {floating} float, {len(solution) - fixed - floating} from code alone"
    satellites = f"{solution.satellites.min()} to {solution.satellites.max()} satellites"
    yield "epochs", f"{len(solution)} of {result.epochs_in_common}: {kinds}; {satellites}"
    compared = joined.difference[np.isfinite(joined.difference).all(axis=1)]
    if len(compared):
        sizes = 1000.0 * np.linalg.norm(compared, axis=1)
        rms = float(np.sqrt(np.mean(sizes**2)))
        yield (
            "compared",
            f"{len(compared)} epochs forward and backward differ by {rms:.1f} mm (RMS), {sizes.max():.1f} at most",
        )
    if result.satellites:
        yield "phases", _phases(result.satellites)
    if len(result.rover.events):
        yield "events", f"{len(result.rover.events)} of the receiver's event input"
    if result.settings.way == "static":
        yield from _standing_lines(result)
    for stretch in result.stretches[:_MOST_STRETCHES]:
        yield "doubted", stretch_text(stretch)
    if len(result.stretches) > _MOST_STRETCHES:
        yield "", f"+{len(result.stretches) - _MOST_STRETCHES} more; --json lists all"


_MOST_STRETCHES = 12


def _phases(satellites: tuple[SatelliteUse, ...]) -> str:
    """Say what residuals phases have, and where cycles slipped."""
    count = sum(one.epochs for one in satellites)
    rms = np.sqrt(sum(one.epochs * one.residual**2 for one in satellites) / max(count, 1))
    worst = max(satellites, key=lambda one: one.residual)
    slipped = ", ".join(f"{one.name} {one.slips}" for one in satellites if one.slips)
    slips = f"cycle slips: {slipped}" if slipped else "no cycle slips"
    return f"residuals {1000.0 * rms:.1f} mm (RMS), {worst.name} has {1000.0 * worst.residual:.1f} mm; {slips}"


def _standing_lines(result: GnssResult) -> Iterator[tuple[str, str]]:
    x, y, z = (f"{value:.4f}" for value in result.place)
    yield "place", f"X {x}, Y {y}, Z {z} m, sd {_millimetres(result.covariance)} mm (geocentric)"
    longitude, latitude = np.degrees(result.geographic[:2])
    height = f"height {result.geographic[2]:.4f} m above the ellipsoid"
    yield "", f"latitude {latitude:.9f}, longitude {longitude:.9f} degrees, {height}"
    yield "", f"sd {_millimetres(result.local_covariance)} mm (east, north, up)"
    vector = ", ".join(f"{value:.4f}" for value in result.vector)
    yield "baseline", f"{vector} m, length {float(np.linalg.norm(result.vector)):.4f} m"
    yield "closure", f"forward less backward in time {1000.0 * float(np.linalg.norm(result.closure)):.1f} mm"


def _millimetres(covariance: FloatArray) -> str:
    return ", ".join(f"{1000.0 * deviation:.1f}" for deviation in np.sqrt(np.diag(covariance)))


def _document(result: GnssResult, target: Path, *, dry_run: bool) -> dict[str, object]:
    solution = result.joined.solution
    stands = result.settings.way == "static"
    return {
        "command": "gnss positions",
        "file": target.name,
        "dry_run": dry_run,
        "way": result.settings.way,
        "engine": Path(result.engine).name,
        "base": list(result.settings.base),
        "epochs": len(solution),
        "epochs_in_common": result.epochs_in_common,
        "events": len(result.rover.events),
        "fixed": int(np.count_nonzero(solution.is_fixed)),
        "floating": int(np.count_nonzero(solution.quality == 2)),
        "place": result.place.tolist() if stands else None,
        "covariance": result.covariance.tolist() if stands else None,
        "closure": result.closure.tolist() if stands else None,
        "satellites": [
            {"name": one.name, "epochs": one.epochs, "residual": one.residual, "slips": one.slips}
            for one in result.satellites
        ],
        "doubted": [
            {"begin": part.begin, "end": part.end, "epochs": part.epochs, "why": part.why} for part in result.stretches
        ],
        "warnings": warning_rows(result.warnings),
    }


def _add_point(invocation: Invocation, result: GnssResult, name: str, *, dry_run: bool) -> str:
    """Write a place into the control points of the project; return the name of their file."""
    from orip.stations.in_project import Exposures, stations_in_project
    from orip.workflow.observations.control import add_control
    from orip.workflow.project.commit import carry_out
    from orip.workflow.records.commands import read_records

    state = read_records(invocation.folder)
    unknown = np.full((1, 3), np.nan)
    exposure = Exposures(
        (name,), result.geographic[None], True, result.local_covariance[None], np.full((1, 3, 3), np.nan), unknown,
        np.full(1, np.nan), (True,), ("",),
    )  # fmt: skip
    definition = state.project.definition
    (station,), warnings = stations_in_project(exposure, definition.crs, definition.ground_unit, (1.0, 1.0, 1.0), 1.0)
    invocation.terminal.warn(warnings)
    keys = ("X", "Y", "Z", "aX", "aY", "aZ")
    values = [*station.position, *(max(error, _LEAST_DEVIATION) for error in station.position_error)]
    words = [f"{key}={value:.4f}" for key, value in zip(keys, values, strict=True)]
    edit = partial(add_control, kind="points", name=name, words=words, dry_run=dry_run)
    return carry_out(state, edit).outcome.shown
