"""The exposure stations of the page: a table, and residuals by strip over time."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from orip.number_text import decimals_for
from orip.records.results.solution import Solution
from orip.records.results.station_residuals import StationResiduals, station_residuals
from orip.report.drawings.svg import ChartFrame, Curve, line_chart
from orip.report.numbers import fixed
from orip.report.table import PageColumn, PageTable

_AXES = ("X", "Y", "Z")
_STYLES = ("first", "second")
_NOTE = "v: adjusted minus observed; w: normalised residual; marked are stations that lost weight or are only compared."


def station_table(solution: Solution) -> PageTable | None:
    """Return the positions of stations with their residuals; None where there are none."""
    found = station_residuals(solution, "position")
    if not len(found):
        return None
    decimals = decimals_for(np.abs(found.a_priori), 3, 6)
    columns = [
        PageColumn("Photo", [exposure.photo for exposure in found.exposures], words=True),
        PageColumn("Strip", [exposure.strip for exposure in found.exposures], words=True, key="strip"),
        PageColumn("Time", [fixed(time, 1) for time in _seconds(found).tolist()], "s from the first"),
        *(
            PageColumn(f"v{axis}", [fixed(value, decimals) for value in found.residual[:, k].tolist()],
                       solution.ground_unit, f"residual.{axis}")
            for k, axis in enumerate(_AXES)
        ),
        *(
            PageColumn(f"w{axis}", [fixed(value, 2) for value in found.w[:, k].tolist()], key=f"w.{axis}")
            for k, axis in enumerate(_AXES)
        ),
    ]  # fmt: skip
    least = found.weight_factor.min(axis=1)
    emphasised = frozenset(np.flatnonzero(~(least >= 1.0)).tolist())
    return PageTable("stations", "Exposure stations: residuals of positions", columns, _NOTE, emphasised)


def strip_table(solution: Solution) -> PageTable | None:
    """Return the mean and the RMS of the residuals of positions by strip; None where there are no strips."""
    found = station_residuals(solution, "position")
    of_strip = np.array([exposure.strip for exposure in found.exposures])
    strips = [strip for strip in dict.fromkeys(of_strip.tolist()) if strip]
    if not strips:
        return None
    decimals, unit = decimals_for(np.abs(found.a_priori), 3, 6), solution.ground_unit
    residual = [found.residual[of_strip == strip] for strip in strips]
    columns = [
        PageColumn("Strip", strips, words=True),
        PageColumn("Stations", [str(len(mine)) for mine in residual]),
    ]
    for k, axis in enumerate(_AXES):
        means = [float(np.mean(mine[:, k])) for mine in residual]
        columns.append(PageColumn(f"mean v{axis}", [fixed(mean, decimals) for mean in means], unit))
    for k, axis in enumerate(_AXES):
        sizes = [float(np.sqrt(np.mean(mine[:, k] ** 2))) for mine in residual]
        columns.append(PageColumn(f"RMS v{axis}", [fixed(size, decimals) for size in sizes], unit))
    return PageTable("", "Exposure stations by strip", columns)


def station_charts(solution: Solution) -> tuple[Markup, ...]:
    """Return charts of the residuals in X, Y and Z over time, a line for each strip; none without times."""
    found = station_residuals(solution, "position")
    seconds = _seconds(found)
    if not np.isfinite(seconds).any():
        return ()
    strips = dict.fromkeys(exposure.strip for exposure in found.exposures)
    of_strip = np.array([exposure.strip for exposure in found.exposures])
    charts = []
    for axis, name in enumerate(_AXES):
        curves = []
        for number, strip in enumerate(strips):
            rows = np.flatnonzero(of_strip == strip)
            points = list(zip(seconds[rows].tolist(), found.residual[rows, axis].tolist(), strict=True))
            curves.append(Curve(points, strip or "no strip", _STYLES[number % len(_STYLES)]))
        frame = ChartFrame("s from the first exposure", f"v{name} ({solution.ground_unit})", 480.0, 200.0)
        charts.append(line_chart(f"Residuals of stations in {name} over time", frame, curves))
    return tuple(charts)


def _seconds(found: StationResiduals) -> np.ndarray:
    times = np.array([exposure.time for exposure in found.exposures], dtype=np.float64)
    return times - np.nanmin(times) if np.isfinite(times).any() else times
