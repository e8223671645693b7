"""Pixels measured in pictures of a lower resolution than the camera's sensor."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.structs import replace

_FACTORS = (2.0, 4.0, 8.0)

_FEWEST = 10
"""Number of photo points that all lie in one corner by chance with a probability of one in a million."""

_EDGE = 1.01
"""Tolerance at the edge of the reduced picture."""


def reduced_pictures(block: Block) -> Iterator[Hypothesis]:
    """Yield the pixels of each camera multiplied by a factor, if they lie in the upper left corner of its sensor."""
    for row, camera in enumerate(block.cameras):
        if camera.sensor is None:
            continue
        rows = block.photo_camera[block.photo_points.photo] == row
        corner = np.array([-camera.sensor.width, camera.sensor.height]) / 2.0
        # columns and rows as parts of those of the sensor
        part = np.abs(block.photo_points.xy[rows] - corner) / np.abs(2.0 * corner)
        for factor in _FACTORS:
            if np.count_nonzero(rows) < _FEWEST or part.max() > _EDGE / factor:
                break
            xy = block.photo_points.xy.copy()
            xy[rows] = (xy[rows] - corner) * factor + corner
            text = (
                f"all points lie in the upper left corner of the {camera.sensor.columns} columns and "
                f"{camera.sensor.rows} rows of the sensor, and fit when multiplied by "
                f"{factor:g}: they were measured at a lower resolution; write columns and "
                "rows of the pictures that were measured, with the same width and height"
            )
            changed = replace(block, photo_points=replace(block.photo_points, xy=xy))
            yield Hypothesis(changed, finding("resolution", f"camera {camera.name}", text))
