"""Stations without times that all lie ahead of their photos, or behind, by more than a lever arm has.

Positions of another moment than the exposures are off along the flight. Where the camera always looks the same way a
lever arm is that, too, but none on board is so long.
"""

from __future__ import annotations

import numpy as np

from orip.adjustment.weights import MEDIAN_OF_NORMAL
from orip.arrays import BoolArray, FloatArray
from orip.bundle.results.solution import solution_of
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Misfit, fit_of_adjustment, is_good
from orip.mistakes.stations.doubted_camera import are_doubted, has_positions, without_positions
from orip.mistakes.stations.given_positions import GivenPositions, given_positions
from orip.mistakes.stations.misread_antennas import LATE, longest_arm
from orip.records.results.solution import Solution

_FEWEST = 6
"""Photos of which it is seen that all are off alike."""

_STRAIGHT = float(np.cos(np.radians(20.0)))
"""Cosine of the largest change of direction on a strip."""

_ALIKE = 0.2
"""Part of the shift along the flight that its scatter, and the shift across, have at most."""


def along_the_flight(misfit: Misfit) -> list[ProjectWarning]:
    """Return that positions, none of them with a time, are all off along the flight by more than a lever arm."""
    block = misfit.readjuster.block
    can_be_told = has_positions(block) and block.ground_unit == "m" and misfit.readjuster.is_worthwhile
    has_times = any(np.isfinite(station.time) for station in block.stations)
    if has_times or not (can_be_told and are_doubted(misfit.solution)):
        return []
    without = misfit.readjuster.adjust(without_positions(block))  # a camera takes up what it can of such a shift
    if without is None or not is_good(fit_of_adjustment(without)):
        return []
    return _ahead(given_positions(block), solution_of(without), longest_arm(misfit.solved))


def _ahead(positions: GivenPositions, without: Solution, longest: float) -> list[ProjectWarning]:
    place = {name: row for row, name in enumerate(without.photos.names)}
    known = [row for row, name in enumerate(positions.photos) if name in place]
    if len(known) < _FEWEST:
        return []
    found = without.photos.values[[place[positions.photos[row]] for row in known], :3]
    off = positions.given[known] - found
    ahead, straight = _directions(found[:, :2])
    if np.count_nonzero(straight) < _FEWEST:
        return []
    along = np.sum(off[straight, :2] * ahead[straight], axis=1)
    across = off[straight, 0] * ahead[straight, 1] - off[straight, 1] * ahead[straight, 0]
    by = float(np.median(along))
    scatter = float(np.median(np.abs(along - by))) / MEDIAN_OF_NORMAL
    if abs(by) < longest or max(scatter, abs(float(np.median(across)))) > _ALIKE * abs(by):
        return []
    text = (
        f"they are all {abs(by):.2f} m {'ahead of' if by > 0.0 else 'behind'} their photos along the flight, more than "
        "a lever arm: they are those of another moment than the exposures; match events and exposures again; or write "
        'the times of the exposures in the .STA file, and [[antenna]] with name = "GNSS" and unknown = '
        '["time_offset"] in orip.toml'
    )
    return [ProjectWarning(LATE, "exposure stations", text)]


def _directions(places: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return unit vectors (n, 2) of the flight at places in its order, and (n,) bool where it is straight."""
    steps = np.diff(places, axis=0)
    steps /= np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
    ahead, straight = np.zeros_like(places), np.zeros(len(places), dtype=bool)
    ahead[1:-1] = steps[:-1] + steps[1:]
    ahead[1:-1] /= np.maximum(np.linalg.norm(ahead[1:-1], axis=1, keepdims=True), 1e-9)
    straight[1:-1] = np.sum(steps[:-1] * steps[1:], axis=1) > _STRAIGHT
    return ahead, straight
