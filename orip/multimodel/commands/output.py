"""What `orip digitise` and the commands over the link print."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isnan
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import asdict

from orip.cli.terminal import Terminal, warning_rows

if TYPE_CHECKING:
    from orip.multimodel.digitising.new_points import GroundDigitised
    from orip.multimodel.digitising.setup import Digitised
    from orip.multimodel.link.messages import ProfilePoint
    from orip.multimodel.project_link import WhereMark
    from orip.multimodel.state import Driven, Position
    from orip.records.interior import MarkAdjustment


def driven_line(driven: Driven) -> str:
    """Return the active model and the plate coordinates."""
    return f"model {driven.model}  upper {_pair(driven.upper)}  lower {_pair(driven.lower)}"


def driven_document(driven: Driven) -> dict[str, Any]:
    """Return the same for JSON."""
    return {"model": driven.model, "upper": list(driven.upper), "lower": list(driven.lower)}


def where_lines(found: WhereMark) -> Iterator[str]:
    """Yield where the mark is: model, ground, plates, photos."""
    status = found.status
    yield f"model   {status.model}  {status.condition}"
    if found.ground is not None:
        x, y, z = found.ground.xyz
        yield f"ground  {x:z.4f} {y:z.4f} {z:z.4f}  y-parallax {found.ground.y_parallax:z.4f} mm"
    elif found.photos:
        yield "ground  -  the rays of the two photos do not meet"
    for name, position in zip(("upper", "lower"), found.plates, strict=True):
        yield f"{name}   {_pair(position)}"
    for photo in found.photos:
        yield f"{photo.side.lower():6s}  photo {photo.photo}  {_pair(photo.xy)}"
    yield f"guide   {status.guide}  lock {status.lock or 'NONE'}  automatic {'ON' if status.automatic else 'OFF'}"


def where_document(found: WhereMark) -> dict[str, Any]:
    """Return the same for JSON."""
    status, ground = found.status, found.ground
    return {
        "command": "drive where",
        "model": status.model,
        "condition": status.condition,
        "ground": None if ground is None else list(ground.xyz),
        "y_parallax": None if ground is None else ground.y_parallax,
        "upper": list(found.plates[0]),
        "lower": list(found.plates[1]),
        "photos": {photo.side.lower(): {"photo": photo.photo, "xy": list(photo.xy)} for photo in found.photos},
        "guide": status.guide,
        "lock": status.lock,
        "automatic": status.automatic,
    }


def profile_lines(points: Sequence[ProfilePoint]) -> Iterator[str]:
    """Yield a line for each step."""
    for (x, y, z), driven in points:
        place = f"{x:z.4f} {y:z.4f} {z:z.4f}"
        yield f"{place}  {driven_line(driven) if driven else '-  no plate can be driven there'}"


def profile_document(points: Sequence[ProfilePoint]) -> dict[str, Any]:
    """Return the same for JSON."""
    rows = [
        {"ground": list(point.xyz), **(driven_document(point.driven) if point.driven else {"model": None})}
        for point in points
    ]
    return {"command": "drive profile", "points": rows}


def _pair(position: Position) -> str:
    return f"{position[0]:z.4f} {position[1]:z.4f}"


def tell_digitised(terminal: Terminal, command_name: str, found: Digitised, *, following: str = "orip measure") -> None:
    """Say what was digitised, what became of orientations, and the command that takes it."""
    if found.is_trial and not terminal.json:
        terminal.data("\n".join(_places(found)))
    terminal.warn(found.warnings)
    for orientation in found.orientations:
        summary = orientation.summary
        s0 = "no redundancy" if isnan(summary.s0) else f"s0 {summary.s0:.4f} mm"
        largest = float(np.abs(orientation.residuals).max())
        terminal.say(f"oriented {summary.group[:-1]} {summary.name}: {s0}, largest residual {largest:.4f} mm")
    counts = ", ".join(f"{found.count(outcome)} {outcome}" for outcome in ("digitised", "skipped", "kept"))
    if found.is_trial:
        terminal.say(f"trial    {len(found.entries)} would be driven to; nothing is written")
    else:
        terminal.say(f"log      {found.log}: {counts}; {found.ending}", "green")
        terminal.say(f"next     {following}")
    if terminal.json:
        terminal.document(
            "digitise",
            {
                "command": command_name,
                "log": found.log,
                "dry_run": found.is_trial,
                "ending": found.ending,
                "entries": [asdict(entry) for entry in found.entries],
                "orientations": [_orientation(orientation) for orientation in found.orientations],
                "warnings": warning_rows(found.warnings),
            },
        )


def tell_ground(terminal: Terminal, found: GroundDigitised) -> None:
    """Say which ground points were taken."""
    terminal.warn(found.warnings)
    taken = sum(point.xyz is not None for point in found.points)
    terminal.say(
        f"ground   {found.file}: {taken} digitised, {len(found.points) - taken} skipped; {found.ending}", "green"
    )
    if terminal.json:
        document = {"command": "digitise ground", "file": found.file, "ending": found.ending}
        points = [asdict(point) for point in found.points]
        terminal.document("digitise-ground", {**document, "points": points, "warnings": warning_rows(found.warnings)})


def _places(found: Digitised) -> list[str]:
    """Return the table of a dry run: the order, and where would be driven to."""
    from orip.files.text.table import Column, table_lines
    from orip.number_text import fixed

    places = [entry.driven or (np.nan, np.nan) for entry in found.entries]
    return table_lines(
        [
            Column("", [entry.what for entry in found.entries], align="left"),
            Column("Of", [entry.owner for entry in found.entries], align="left"),
            Column("Name", [entry.name for entry in found.entries], align="left"),
            Column("X-plate", fixed([x for x, _ in places], 4), "mm, px"),
            Column("Y-plate", fixed([y for _, y in places], 4), "mm, px"),
            Column("Place", [entry.known for entry in found.entries], align="left"),
        ]
    )


def _orientation(adjustment: MarkAdjustment) -> dict[str, Any]:
    summary = adjustment.summary
    return {
        "kind": summary.group[:-1],
        "name": summary.name,
        "transformation": adjustment.kind,
        "s0": None if isnan(summary.s0) else summary.s0,
        "redundancy": summary.redundancy,
        "marks": [
            {"name": name, "residual": residual}
            for name, residual in zip(adjustment.marks.names, adjustment.residuals.tolist(), strict=True)
        ],
    }
