"""A free network with observed projection centres: they are no observations there."""

from __future__ import annotations

from collections.abc import Iterator

from orip.errors import ProjectWarning
from orip.records.block import Block
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.wording import counted

FREE_DATUM = "free-datum"

_FEWEST = 3
"""Projection centres that give a block its place, its turn and its scale."""


def observations_without_weight(block: Block) -> Iterator[ProjectWarning]:
    """Yield a warning if exposure stations or projection centres are given errors that a free network ignores."""
    if not block.is_free_network:
        return
    stations = sum(station.has_position and min(station.position_error) >= 0.0 for station in block.stations)
    centres = {
        element.name
        for element in block.elements
        if element.group == "PHOTO" and element.kind in PHOTO_PARAMETERS[:3] and element.error >= 0.0
    }
    for count, what in ((stations, "exposure station"), (len(centres), "observed projection centre")):
        if count >= _FEWEST:
            text = (
                f'datum = "free" takes all weight from the {counted(count, what)}: they are compared only. Leave datum '
                "out if they are to place the block; or make their errors negative, which says the same"
            )
            yield ProjectWarning(FREE_DATUM, f"bundle {block.definition.name}", text)
