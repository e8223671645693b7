"""The relative orientation of cameras that move together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.records.results.solution import RigEstimate, Solution
from orip.report.numbers import decimals_for, fixed
from orip.report.table import PageColumn, PageTable

_NOTE = (
    "Cameras whose photos of the same instant (time of the station, else number at the end of the name) are always in "
    "the same relative position. Base: projection centre of the second camera in the system of the first; angles: "
    "rotation of the second camera against the first. ±: standard deviation of the mean, from the cofactor matrix of "
    "the adjustment; scatter: standard deviation of one instant as the instants differ, mean of the three axes. The "
    "adjustment orients all photos on their own."
)


def rig_table(solution: Solution) -> PageTable | None:
    """Return base and rotation of each two cameras that move together; None where there are none."""
    if not solution.rigs:
        return None
    rigs = list(dict.fromkeys((row.first, row.second, row.instants) for row in solution.rigs))
    figures: dict[str, list[RigEstimate]] = {}
    for row in solution.rigs:
        figures.setdefault(row.name, []).append(row)
    columns = [
        PageColumn("Cameras", [f"{first}, {second}" for first, second, _ in rigs], words=True),
        PageColumn("Instants", [str(instants) for *_, instants in rigs]),
    ]
    for group, unit in ((("BX", "BY", "BZ"), solution.ground_unit), (("OMEGA", "PHI", "KAPPA"), "°")):
        names = [name for name in group if name in figures]
        columns += [PageColumn(name, _cells(figures[name]), unit) for name in names]
        scatter = [[row.scatter for row in figures[name]] for name in names]
        if names:
            sizes = zip(*scatter, strict=True)
            columns.append(PageColumn("Scatter", [_root_mean_square(own) for own in sizes], unit))
    return PageTable("", "Relative orientation of cameras that move together", columns, _NOTE)


def _cells(rows: Sequence[RigEstimate]) -> list[str]:
    decimals = decimals_for([row.sd for row in rows])
    return [f"{fixed(row.value, decimals)} ± {fixed(row.sd, decimals)}" for row in rows]


def _root_mean_square(sizes: Sequence[float]) -> str:
    size = float(np.sqrt(np.mean(np.square(sizes))))
    return fixed(size, decimals_for([size]))
