"""What RTKLIB says of each satellite: residuals of its phases, and cycle slips (the file of status, `.pos.stat`)."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

_FIELDS = 17
"""$SAT, week, seconds, satellite, frequency, azimuth, elevation, residuals of code and phase, valid, SNR, fix ..."""

_SATELLITE, _FREQUENCY, _PHASE, _VALID, _SLIPS = 3, 4, 8, 9, 15
_WORSE, _LEAST = 5.0, 0.02
"""Times the median of all satellites, and metres, from which one is named."""


class SatelliteUse(Struct, frozen=True):
    """A satellite: epochs in which it was used, residuals of its phases (RMS, m), cycle slips of all frequencies."""

    name: str
    epochs: int
    residual: float
    slips: int


def satellites_used(text: str) -> tuple[SatelliteUse, ...]:
    """Return the satellites of a file of status, by name; lines that are none of theirs are left out."""
    phases: dict[str, list[float]] = {}
    epochs: dict[str, int] = {}
    slips: dict[tuple[str, str], int] = {}
    for line in text.splitlines():
        fields = line.split(",")
        if fields[0] != "$SAT" or len(fields) < _FIELDS:
            continue
        name, frequency = fields[_SATELLITE], fields[_FREQUENCY]
        slips[name, frequency] = max(slips.get((name, frequency), 0), int(fields[_SLIPS]))
        if fields[_VALID] == "1":
            phases.setdefault(name, []).append(float(fields[_PHASE]))
            epochs[name] = epochs.get(name, 0) + (frequency == "1")
    return tuple(
        SatelliteUse(
            name, epochs[name], float(np.sqrt(np.mean(np.square(values)))),
            sum(count for (other, _), count in slips.items() if other == name),
        )
        for name, values in sorted(phases.items())
    )  # fmt: skip


def unlike_the_others(satellites: tuple[SatelliteUse, ...]) -> tuple[SatelliteUse, ...]:
    """Return satellites whose phases fit far worse than the median of all."""
    if len(satellites) < 5:
        return ()
    middle = float(np.median([one.residual for one in satellites]))
    return tuple(one for one in satellites if one.residual > max(_WORSE * middle, _LEAST))
