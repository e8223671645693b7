"""Photo points that are measured far less precisely than is said: residuals are too large everywhere, and alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Readjuster, fit_of_adjustment, is_good
from orip.mistakes.mistake import ON_GROUND, Consequence, declare
from orip.records.block import Block
from orip.structs import replace

if TYPE_CHECKING:
    from orip.bundle.solve import SolvedBlock

_WORDS = "the photo points are measured less precisely than is said"
_BENT = Consequence(warnings=None, groups=(*ON_GROUND, "check point", "camera", "photo"))
"""Weights that are a hundred times too large bend the block."""

PRECISION = declare("measurement-precision", _WORDS, _BENT)
IMPRECISE = declare("imprecise-points", _WORDS, is_serious=False)
"""The same where they do not."""

_SUSPECTED, _TOO_SMALL, _BENDING, _LARGEST, _ROUGHEST = 1.5, 2.0, 4.0, 200.0, 3.0
"""Standard error of unit weight of most residuals of a block that is bent by its weights, and that of one that is not,
from which an a-priori error is named; that from which nothing else can be told; the factor up to which others are
tried, and the pixels to which anyone measures."""

_FAR_OFF = 5.0
"""Standard residual that no observation has by chance."""

_GENEROUS, _NEARLY_ONE, _TRIALS = 2.0, 0.8, 3
"""Factor by which the error is first taken larger than the residuals, sigma0 at which it is found, and most trials."""

_CELLS, _PATTERN = 6, 0.1
"""Cells along columns and rows of the pictures, and the part of the square sum that their means have at most: what
depends on the place in the picture is no error of measuring."""

_DISPLACED = 1.6
"""Factor within which a residual is that of a decimal point that is displaced."""


class Imprecision(NamedTuple):
    """What is said of the precision of photo points, the block with that of the residuals, and its adjustment."""

    warning: ProjectWarning
    block: Block
    solved: SolvedBlock


def precision_too_small(solved: SolvedBlock, readjuster: Readjuster) -> Imprecision | None:
    """Return by how much the photo points are less precise than `measurement_precision`, if all fits when they are.

    Parameters
    ----------
    readjuster : Readjuster
        Of the block as gathered.
    """
    block = readjuster.block
    precision, points = block.definition.measurement_precision, block.photo_points
    largest = solved.variance.sigma0_all
    if not largest > _TOO_SMALL or fit_of_adjustment(solved).scale < _SUSPECTED or not readjuster.is_worthwhile:
        return None
    # errors that are far too large bend nothing, and show how large they are
    found = _with_errors_of_residuals(readjuster, min(_GENEROUS * largest, _LARGEST), _TRIALS)
    if found is None or not found[2].converged:
        return None
    factor, meant, adjusted = found
    pixel, fit = smallest_pixel(block), fit_of_adjustment(adjusted)
    is_rough = pixel is not None and float(np.median(points.error)) * factor > _ROUGHEST * pixel
    if factor < _TOO_SMALL or is_rough or not is_good(fit) or _has_pattern(adjusted):
        return None
    given = written_precision(precision.value, precision.unit)
    precise = likely_precision(precision.value, factor, precision.unit)
    most = "all" if fit.standard.max() < _FAR_OFF else "most"
    text = (
        f"measurement_precision = {given} is {factor:.3g} times smaller than the residuals, everywhere in the "
        f"pictures; write {precise}, with which {most} observations fit"
    )
    code = PRECISION if factor > _BENDING else IMPRECISE
    return Imprecision(ProjectWarning(code, f"bundle {block.definition.name}", text), meant, adjusted)


def _with_errors_of_residuals(
    readjuster: Readjuster, factor: float, trials: int
) -> tuple[float, Block, SolvedBlock] | None:
    """Return the size of the residuals in a-priori errors, the block with errors near that size, and its adjustment.

    Where errors are taken far too large, blunders make the residuals appear larger: so often it is tried.
    """
    block = _with_errors_times(readjuster.block, factor)
    solved = readjuster.adjust(block)
    if solved is None or not np.isfinite(solved.variance.sigma0):
        return None
    size = factor * solved.variance.sigma0
    if solved.variance.sigma0 > _NEARLY_ONE or trials == 1:
        return size, block, solved
    return _with_errors_of_residuals(readjuster, size, trials - 1)


def _with_errors_times(block: Block, factor: float) -> Block:
    points = block.photo_points
    return replace(block, photo_points=replace(points, error=points.error * factor))


def _has_pattern(solved: SolvedBlock) -> bool:
    """Tell whether residuals of photo points depend on their place in the picture."""
    kind = next(kind for kind in solved.problem.observations if kind.rows.kind.name == "photo")
    count, points = len(kind.rows.error), solved.block.photo_points
    residual = solved.equations.residual[:count].reshape(-1, 2)
    xy = points.xy[points.in_use][: len(residual)]
    if len(xy) != len(residual):
        return False
    part = (xy - xy.min(axis=0)) / np.maximum(np.ptp(xy, axis=0), 1e-300)
    place = np.minimum((part * _CELLS).astype(np.int64), _CELLS - 1)
    cell = place[:, 0] * _CELLS + place[:, 1]
    number = np.maximum(np.bincount(cell, minlength=_CELLS**2), 1)
    sums = np.stack([np.bincount(cell, residual[:, axis], _CELLS**2) for axis in (0, 1)])
    by_chance = 2.0 * _CELLS**2 / len(residual)
    return bool((sums**2 / number).sum() > (_PATTERN + by_chance) * np.square(residual).sum())


def smallest_pixel(block: Block) -> float | None:
    """Return the width (mm) of the smallest pixel of a block's cameras; None where none has a sensor."""
    widths = [camera.sensor.width / camera.sensor.columns for camera in block.cameras if camera.sensor is not None]
    return min(widths, default=None)


def written_precision(value: float, unit: str) -> str:
    """Return a precision as `measurement_precision` has it."""
    return f"'{value:.2g}px'" if unit == "px" else f"{value:.2g} mm"


def likely_precision(value: float, factor: float, unit: str) -> str:
    """Return a precision multiplied by a factor, or by the power of ten next to it, as of a displaced decimal point."""
    power = 10.0 ** round(float(np.log10(factor)))
    is_power = power != 1.0 and 1.0 / _DISPLACED < factor / power < _DISPLACED
    return written_precision(value * (power if is_power else factor), unit)
