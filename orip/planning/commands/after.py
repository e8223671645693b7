"""`orip plan flown` and `orip plan clock`: what was flown beside its plan, and an exposure log in GPS time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from orip.cli.options import BundleOption, ForceOption, Invocation, command
from orip.errors import Complaint, InputError
from orip.planning.commands.follow import register_follow
from orip.wording import first_names

if TYPE_CHECKING:
    from orip.arrays import FloatArray
    from orip.planning.clock import ClockFit
    from orip.planning.designed import Given
    from orip.planning.flown import Flown

_NAMED = 8


def register_after(group: typer.Typer) -> None:
    """Add the commands."""
    register_follow(group)
    _register_flown(group)
    _register_clock(group)


def _register_flown(group: typer.Typer) -> None:
    @command(group, "flown")
    def flown_command(
        invocation: Invocation,
        again: Annotated[
            Path | None, typer.Option("--again", metavar="FILE", help="Write what is to be flown again, as a .PLAN.")
        ] = None,
        photos: Annotated[
            int, typer.Option("--photos", min=2, help="Photos that are to show each place, as far as planned.")
        ] = 3,
        bundle: BundleOption = None,
        force: ForceOption = False,
    ) -> None:
        """Compare the stations of the .STA file with the plan: what is missing, gaps in the overlap, what to fly again.

        'orip stations import' makes the .STA file of .MRK, .pos and image files.

        Example: orip plan flown --again AGAIN.PLAN
        """
        from orip.files.control.stations_text import stations_text
        from orip.planning.designed import design_of, logged_stations, planned_stations, read_plan, require_other_file
        from orip.planning.flown import compare_flight
        from orip.planning.plan import frame_of
        from orip.workflow.project.outputs import TextOutput, require_replaceable, write_output

        given = read_plan(invocation.folder, bundle)
        project, log = given.state.project, logged_stations(given)
        planned = planned_stations(given)
        frame = frame_of(given.camera, "height")
        size, nodes = np.array([frame.along, frame.across]), design_of(given, planned).points
        found = compare_flight(planned, log, size, frame.c, nodes, photos)
        if again is not None and found.again:
            path = project.folder / again
            text = "! to be flown again, by 'orip plan flown'\n" + stations_text(found.again)
            require_other_file(given, path)
            require_replaceable(project, path, force=force)
            write_output(project, TextOutput(path, lambda: [text], "free the file, then repeat the command"))
        _tell_flown(invocation, found, len(planned), given)


def _register_clock(group: typer.Typer) -> None:
    @command(group, "clock", reads_only=True)
    def clock_command(
        invocation: Invocation,
        file: Annotated[
            Path, typer.Argument(metavar="FILE", help="Lines PPS reading [second] and PHOTO name reading.")
        ],
    ) -> None:
        """Take camera pulses of a computer's clock to GPS time; print the table that 'orip stations import' reads.

        FILE has the receiver's marks, one a second (PPS and the clock's reading; with one of them also its GPS second),
        and the pulses of the camera (PHOTO, name, reading). Offset and drift are estimated, wrong marks named.

        Example: orip plan clock exposures.log > times.csv
        """
        from orip.planning.clock import fit_clock, seconds_of_marks

        path = invocation.folder / file
        readings, known, names, pulses, lines = _read_log(path, str(file))
        order = np.argsort(readings, kind="stable")
        place = {int(mark): row for row, mark in enumerate(order.tolist())}
        seconds = seconds_of_marks(readings[order], [(place[mark], second) for mark, second in known])
        fit = fit_clock(readings[order], seconds)
        times, sd = fit.times(pulses)
        wrong = sorted(lines[int(order[mark])] for mark in fit.wrong)
        _tell_clock(invocation, fit, names, times, sd, wrong, str(file))


def _read_log(path: Path, shown: str) -> tuple[FloatArray, list[tuple[int, float]], list[str], FloatArray, list[int]]:
    """Return readings of marks, those with their second, names and readings of photos, and the marks' lines."""
    from orip.files.text.lines import FieldReader, field_lines, read_lines

    text = read_lines(path, shown)
    complaints: list[Complaint] = list(text.complaints)
    readings: list[float] = []
    known: list[tuple[int, float]] = []
    names: list[str] = []
    pulses: list[float] = []
    lines: list[int] = []
    for line in field_lines(text.value):
        reader = FieldReader(line, shown)
        kind = reader.text(0).upper()
        if kind == "PPS" and reader.has_fields((2, 3), "PPS reading, then its GPS second if it is known"):
            if reader.count == 3:
                known.append((len(readings), reader.decimal(2)))
            readings.append(reader.decimal(1))
            lines.append(line.number)
        elif kind == "PHOTO" and reader.has_fields((3,), "PHOTO name reading"):
            names.append(reader.name(1))
            pulses.append(reader.decimal(2))
        elif kind not in {"PPS", "PHOTO"}:
            reader.complain("a line begins with PPS or PHOTO", 0)
        complaints += reader.complaints
    if not complaints and len(readings) < 2:
        complaints.append(Complaint("it has no marks of the receiver; write lines PPS reading, one a second", shown))
    if complaints:
        raise InputError(complaints)
    return np.array(readings), known, names, np.array(pulses), lines


def _tell_flown(invocation: Invocation, found: Flown, planned: int, given: Given) -> None:
    names = [station.photo for station in found.again]
    off = float(np.median(found.off)) if len(found.off) else None
    terminal = invocation.terminal
    if terminal.json:
        terminal.document(
            "plan-flown",
            {
                "command": "plan flown",
                "planned": planned,
                "flown": len(found.flown),
                "again": names,
                "missed_strips": list(found.strips),
                "off_median": off,
                "places": len(found.nodes),
                "gaps": len(found.gaps),
                "gaps_after_again": len(found.open_gaps),
            },
        )
        return
    unit = given.state.project.definition.ground_unit
    lines = [f"{planned} photos planned, {len(found.flown)} flown, {len(names)} missed"]
    if off is not None:
        lines[0] += f"; {off:.2g} {unit} beside the plan (median)"
    alone = [station.photo for station in found.again if station.strip not in found.strips]
    if found.strips:
        lines.append(f"missed strips: {', '.join(found.strips)}")
    if alone:
        lines.append(f"missed photos: {first_names(alone, _NAMED)}")
    lines.append(
        f"too few photos show {len(found.gaps)} of {len(found.nodes)} places; with what is to be flown again "
        f"{len(found.open_gaps)}"
    )
    terminal.data("\n".join(lines))


def _tell_clock(
    invocation: Invocation,
    fit: ClockFit,
    names: list[str],
    times: FloatArray,
    sd: FloatArray,
    wrong: list[int],
    shown: str,
) -> None:
    terminal = invocation.terminal
    if terminal.json:
        rows = [
            {"photo": name, "time": float(time), "sd": float(error)}
            for name, time, error in zip(names, times, sd, strict=True)
        ]
        terminal.document(
            "plan-clock",
            {
                "command": "plan clock",
                "drift": fit.drift,
                "drift_sd": fit.rate_sd,
                "jitter": fit.jitter,
                "marks": len(fit.residuals),
                "wrong_lines": wrong,
                "photos": rows,
            },
        )
        return
    table = ["photo,time,sd_time"]
    table += [f"{name},{time:.6f},{error:.6f}" for name, time, error in zip(names, times, sd, strict=True)]
    terminal.data("\n".join(table))
    terminal.say(
        f"clock    gains {1e6 * fit.drift:.3f} ± {1e6 * fit.rate_sd:.3f} ppm; a reading is good to "
        f"{1e3 * fit.jitter:.3f} ms, {len(fit.residuals)} marks"
    )
    for line in wrong:
        terminal.say(f"         {shown}:{line}: this mark does not fit, and was left out")
