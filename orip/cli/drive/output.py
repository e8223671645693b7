"""What the commands over the link print: lines for people, rows for JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from orip.link.reply_values import ProfilePoint
    from orip.multimodel.state import Driven, Position
    from orip.workflow.drive.link import WhereMark


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
