"""The plate processor's replies as text: four decimals, no more words than needed, ASCII."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.link.request_words import shown
from orip.multimodel.driving import DrivenPoints
from orip.multimodel.model_loop import ModelLoop
from orip.multimodel.oriented_block import OrientedBlock
from orip.multimodel.readout import ObjectReadout, PhotoReadout
from orip.multimodel.state import Driven, Event, Position, Status
from orip.records.drive_table import DriveFault, DriveTable, StageLimits

_NO_PARALLAX = 0.00005
"""mm: what prints as 0.0000."""

_LONGEST_TEXT = 300


def error_line(fault: DriveFault) -> str:
    """Return the line of a refusal."""
    text = fault.text.encode("ascii", errors="replace").decode("ascii")
    return f"ERR {int(fault.code)} {' '.join(map(_printable, text.split()))[:_LONGEST_TEXT]}"


def driven_text(driven: Driven) -> str:
    """Return ``MODEL name UPPER x y LOWER x y``."""
    return f"MODEL {driven.model} {plates_text((driven.upper, driven.lower))}"


def plates_text(plates: tuple[Position, Position]) -> str:
    """Return ``UPPER x y LOWER x y``."""
    (x1, y1), (x2, y2) = plates
    return f"UPPER {x1:z.4f} {y1:z.4f} LOWER {x2:z.4f} {y2:z.4f}"


def status_text(status: Status, is_moving: bool | None) -> str:
    """Return what is set; MOVING only where travel takes time."""
    left, right = status.prisms
    moving = "" if is_moving is None else f" MOVING {'YES' if is_moving else 'NO'}"
    return (
        f"MODEL {status.model} GUIDE {status.guide} STATE {status.condition} LOCK {status.lock or 'NONE'} "
        f"PRISM {left} {right} AUTO {'ON' if status.automatic else 'OFF'}{moving}"
    )


def object_text(readout: ObjectReadout) -> str:
    """Return ``X Y Z``, and ``PY p`` where the rays do not meet."""
    x, y, z = readout.xyz
    parallax = f" PY {readout.y_parallax:z.4f}" if abs(readout.y_parallax) >= _NO_PARALLAX else ""
    return f"{x:z.4f} {y:z.4f} {z:z.4f}{parallax}"


def photos_text(readouts: Sequence[PhotoReadout]) -> str:
    """Return ``LEFT photo x y RIGHT photo x y``."""
    return " ".join(f"{readout.side} {readout.photo} {readout.xy[0]:z.4f} {readout.xy[1]:z.4f}" for readout in readouts)


def event_text(event: Event | None) -> str:
    """Return ``NONE``, ``LEFT``, ``KEY k`` or ``RIGHT UPPER x y LOWER x y``."""
    if event is None:
        return "NONE"
    if event.plates is not None:
        return f"{event.kind} {plates_text(event.plates)}"
    return f"{event.kind} {event.key}".rstrip()


def model_text(model: ModelLoop) -> str:
    """Return name, row, column, left photo, right photo and optics."""
    left, right = model.photos
    optics = "SWAPPED" if model.swapped else "NORMAL"
    return f"{model.name} {model.row} {model.column} {left.name} {right.name} {optics}"


def limits_text(stage: str, limits: StageLimits, unit: str) -> str:
    """Return ``stage x-min x-max y-min y-max LEAST count UNIT unit``."""
    borders = (limits.x_min, limits.x_max, limits.y_min, limits.y_max)
    return f"{stage} {' '.join(f'{value:z.4f}' for value in borders)} LEAST {limits.least_count:.4f} UNIT {unit}"


def loaded_text(table: DriveTable) -> str:
    """Return how much was loaded."""
    return f"LOADED cameras {len(table.cameras)} photos {len(table.photos)} models {len(table.models)}"


def profile_lines(block: OrientedBlock, driven: DrivenPoints) -> Iterator[str]:
    """Yield ``X Y Z MODEL name UPPER x y LOWER x y`` for each point, ``X Y Z ERR code`` where it is not driven to."""
    upper, lower = (
        (np.round(plate / limits.least_count) * limits.least_count).tolist()
        for plate, limits in ((driven.upper, block.table.upper), (driven.lower, block.table.lower))
    )
    rows = zip(driven.xyz.tolist(), driven.model.tolist(), driven.code.tolist(), upper, lower, strict=True)
    for (x, y, z), model, code, at_upper, at_lower in rows:
        reply = f"ERR {code}" if code else driven_text(Driven(block.models[model].name, at_upper, at_lower))
        yield f"{x:z.4f} {y:z.4f} {z:z.4f} {reply}"


def _printable(word: str) -> str:
    return word if word.isprintable() else shown(word)
