"""A-priori errors of control and of the positions of photos that no survey has: they bend a block to their errors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.mistakes.mistake import ON_GROUND, REPLACED, Consequence, declare
from orip.mistakes.stations.given_positions import GivenPositions, given_positions
from orip.records.block import Block

_BEST_SURVEY = 1e-7
"""Part of the extent of control that no survey is as good as: a tenth of a millimetre in a kilometre."""

_BEST_OF_SITES, _BEST_OF_GNSS = (1e-6, 3e-4), 1e-3
"""Part of the extent that no survey of a site is as good as, laser trackers neither, up to what is possible anywhere;
and the best positions of moving antennas. Metres."""

TOO_SMALL = declare(
    "errors-too-small", "",
    Consequence(
        warnings=(
            "scattered-positions", "contradicting-position", "contradicting-control", "measurement-precision", REPLACED,
        ),
        groups=(*ON_GROUND, "check point"),
    ),
    comes_first=True, contradicts_others=True,
)  # fmt: skip

_FEWEST, _FLIGHT = 4, 50.0
"""Least number of errors that are no slip, and metres that positions of antennas, not those of a rig, extend."""

_MILLI = 1e-3


def errors_too_small(block: Block) -> Iterator[ProjectWarning]:
    """Yield warnings where control, or positions of photos, are given errors, not zero, that no survey has."""
    known = [point for point in block.control_points if point.kind == "control"]
    coordinates = np.array([point.coordinates for point in known], dtype=np.float64).reshape(-1, 3)
    errors = np.array([point.errors for point in known], dtype=np.float64).reshape(-1, 3)
    if len(known) >= _FEWEST and np.isfinite(coordinates).all() and (errors > 0.0).all():
        yield from _of_control(coordinates, errors, block.ground_unit)
    if block.ground_unit == "m":
        yield from _of_positions(given_positions(block))


def _of_control(coordinates: FloatArray, errors: FloatArray, unit: str) -> Iterator[ProjectWarning]:
    extent, usual = _extent(coordinates), float(np.median(errors))
    part, largest = _BEST_OF_SITES
    sizes = (
        f"{usual:.2g} {unit} over {extent:.3g} {unit}, are smaller than those of any survey: they hold the block to "
    )
    sizes += "their errors; write "
    if usual < _BEST_SURVEY * extent:
        text = f"them in {unit}, the unit of the coordinates, for example {usual / _MILLI:.2g}"
        yield ProjectWarning("error-unit", "control file", f"the a-priori errors of control points, {sizes}{text}")
    elif unit == "m" and usual < min(part * extent, largest):
        text = "those of the survey in m, for example 0.01 of GNSS, 0.002 of a total station"
        yield ProjectWarning(TOO_SMALL, "control points", f"their a-priori errors, {sizes}{text}")


def _of_positions(positions: GivenPositions) -> Iterator[ProjectWarning]:
    errors = positions.errors
    usual = float(np.median(errors)) if len(errors) >= _FEWEST else np.inf
    if usual < _BEST_OF_GNSS and (errors > 0.0).all() and _extent(positions.given) > _FLIGHT:
        text = (
            f"the a-priori errors of their positions, {usual:.2g} m, are smaller than those of any GNSS: they bend the "
            f"block to their errors; write those of the positions in m in the {positions.file} file, for example "
            "0.03 of RTK or PPK"
        )
        yield ProjectWarning(TOO_SMALL, "exposure stations", text)


def _extent(coordinates: FloatArray) -> float:
    """Return twice what the middle half extends: one wrong point, or X and Y exchanged in one, are no extent."""
    low, high = np.quantile(coordinates, (0.25, 0.75), axis=0)
    return 2.0 * float((high - low).max())
