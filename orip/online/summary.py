"""The state of a session in a line."""

from __future__ import annotations

from orip.online.measuring import Measuring
from orip.wording import counted


def summary(measuring: Measuring) -> str:
    """Return the state of the block in a line."""
    block = measuring.block
    values, sigma0 = block.values, block.sigma0
    parts = [
        f"{counted(len(block.measurements), 'photo point')} measured",
        f"{counted(len(values.orientations), 'photo')} oriented",
        f"{counted(len(values.points), 'point')} placed",
        "no redundancy" if sigma0 is None else f"sigma0 {sigma0:.3f} with redundancy {block.equations.redundancy}",
    ]
    if measuring.suspects:
        parts.append(f"{len(measuring.suspects)} suspect")
    return ", ".join(parts)
