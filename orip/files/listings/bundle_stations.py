"""The exposure stations in a bundle listing: residuals of positions and attitudes, a line for each photo."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.files.text.table import Column, table_lines
from orip.number_text import decimals_for, fixed, root_mean_square
from orip.records.observations.epochs import SECONDS_PER_WEEK
from orip.records.results.solution import Solution
from orip.records.results.stations import ATTITUDE_KINDS, POSITION_KINDS, StationResiduals, station_residuals

STATION_KINDS = (*POSITION_KINDS, *ATTITUDE_KINDS)
"""Kinds of observation that are listed here."""

_LEGEND = [
    "",
    "  v = residual (adjusted minus observed), w = normalised residual, WF = least weight factor of the three",
    "  (below 1: down-weighted, '-': only compared). Time: seconds, of the GPS week where that is known.",
]


def station_lines(solution: Solution) -> Iterator[str]:
    """Yield the tables of positions and attitudes, and their root mean squares by strip."""
    position, attitude = station_residuals(solution, "position"), station_residuals(solution, "attitude")
    if len(position):
        yield from _table(position, ("X", "Y", "Z"), solution.ground_unit)
        yield from _strips(position, ("X", "Y", "Z"), solution.ground_unit)
    if len(position) and len(attitude):
        yield ""
    if len(attitude):
        yield from _table(attitude, ("OMEGA", "PHI", "KAPPA"), "°")
    yield from _LEGEND


def _table(found: StationResiduals, names: Sequence[str], unit: str) -> list[str]:
    decimals = decimals_for(np.abs(found.a_priori), 3, 6)
    times = [exposure.time % SECONDS_PER_WEEK for exposure in found.exposures]
    columns = [
        Column("Photo", [exposure.photo for exposure in found.exposures], align="left"),
        Column("Strip", [exposure.strip for exposure in found.exposures], align="left"),
        Column("Time", fixed(times, 2), "s"),
        *(
            Column(f"v{name}", fixed(column, decimals), unit)
            for name, column in zip(names, found.residual.T, strict=True)
        ),
        *(Column(f"w{name}", fixed(column, 2)) for name, column in zip(names, found.w.T, strict=True)),
        Column("WF", fixed(least_weight_factors(found), 3)),
    ]
    return table_lines([column for column in columns if any(cell not in {"", "-"} for cell in column.cells)])


def _strips(found: StationResiduals, names: Sequence[str], unit: str) -> Iterator[str]:
    """Yield mean and root mean square of the residuals of each strip."""
    strips = dict.fromkeys(exposure.strip for exposure in found.exposures if exposure.strip)
    if not strips:
        return
    decimals = decimals_for(np.abs(found.a_priori), 3, 6)
    of_strip = np.array([exposure.strip for exposure in found.exposures])
    used = np.where(np.isnan(found.weight_factor), np.nan, found.residual)
    parts = [used[of_strip == strip] for strip in strips]
    columns = [
        Column("Strip", list(strips), align="left"),
        Column("Stations", [str(len(part)) for part in parts]),
        *(
            Column(f"mean v{name}", fixed([_mean(part[:, axis]) for part in parts], decimals), unit)
            for axis, name in enumerate(names)
        ),
        *(
            Column(f"RMS v{name}", fixed([_rms(part[:, axis]) for part in parts], decimals), unit)
            for axis, name in enumerate(names)
        ),
    ]
    yield from ["", *table_lines(columns)]


def least_weight_factors(found: StationResiduals) -> FloatArray:
    """Return the least weight factor (n,) of the three components; NaN where a station is only compared."""
    return np.asarray(found.weight_factor.min(axis=1))


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else math.nan


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return root_mean_square(known) if len(known) else math.nan
