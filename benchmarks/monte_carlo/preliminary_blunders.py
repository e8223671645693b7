"""Blunders for the study of preliminary values: gross errors, points mixed up, a control point mistyped.

They are such that the true minimum is well defined: each is in a point of many rays, and has no weight in it.
"""

from __future__ import annotations

import numpy as np
from monte_carlo.preliminary_records import NOISE_MM, SimulatedRecords, true_minimum

from orip.adjustment.convergence import TerminationReason
from orip.bundle.solve import SolvedBlock
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.structs import replace

_ROUNDS = 4

_RAYS = 4
"""Of three rays from one line, as in a strip, any two agree."""

_REDUNDANCY = 0.5
_POINTS_OF_A_PHOTO = 9
_PART_OF_A_PHOTO = 0.1
"""Of its points, or one."""


def with_blunders(records: SimulatedRecords, clean: SolvedBlock, random: np.random.Generator) -> SimulatedRecords | str:
    """Return the records with up to 5 % of the photo points wrong, all of which show from the truth.

    Those that do not show, and those that make others seem wrong, are taken back.
    """
    if random.random() < 0.25:
        return records
    rows, displaced = _blunders(clean, random.uniform(0.0, 0.05), random)
    control = _wrong_control(records, random)
    for _ in range(_ROUNDS):
        made = _blundered(records, rows, displaced, control)
        found = true_minimum(made)
        if found.reason is not TerminationReason.CONVERGED:
            return "does not converge from the truth with blunders"
        wanted = np.zeros(len(clean.block.photo_points.photo), dtype=bool)
        wanted[rows] = True
        reduced = _down_weighted(found)
        strange = np.flatnonzero(reduced & ~wanted)
        points = clean.block.photo_points
        spoilt = np.isin(points.point[rows], points.point[strange]) | np.isin(points.photo[rows], points.photo[strange])
        keep = reduced[rows] & ~spoilt
        if keep.all() and not len(strange):
            return made
        if not len(rows):
            return "others down-weighted"
        rows, displaced = rows[keep], displaced[keep]
    return "blunders that do not show"


def _down_weighted(found: SolvedBlock) -> np.ndarray:
    n = found.block.photo_points.xy.size
    return np.asarray((found.weight_factors[:n] < 1.0).reshape(-1, 2).any(axis=1))


def _blunders(clean: SolvedBlock, part: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return photo points and the coordinates that are noted for them: gross errors, or those of another point."""
    points = clean.block.photo_points
    n = len(points.photo)
    numbers = clean.variance.redundancy_numbers[: 2 * n].reshape(-1, 2).min(axis=1)
    rays, full = np.bincount(points.point)[points.point], np.bincount(points.photo)[points.photo]
    free = (numbers >= _REDUNDANCY) & (rays >= _RAYS) & (full >= _POINTS_OF_A_PHOTO)
    left = np.maximum(1, np.floor(_PART_OF_A_PHOTO * np.bincount(points.photo))).astype(int)
    wrong: dict[int, np.ndarray] = {}

    def take(row: int, xy: np.ndarray) -> None:
        wrong[row] = xy
        left[points.photo[row]] -= 1
        free[points.point == points.point[row]] = False

    for row in random.permutation(np.flatnonzero(free)).tolist():
        if len(wrong) >= round(part * n):
            break
        photo = points.photo[row]
        if not free[row] or not left[photo]:
            continue
        others = np.flatnonzero(free & (points.photo == photo) & (points.point != points.point[row]))
        if random.random() < 0.3 and left[photo] >= 2 and len(others):
            other = int(random.choice(others))
            take(row, points.xy[other])
            take(other, points.xy[row])
        else:
            size = np.exp(random.uniform(np.log(10.0 * NOISE_MM), np.log(3.0)))
            # no component is so small that its weight hangs by a thread
            towards = np.pi / 4.0 * random.integers(8)
            take(row, points.xy[row] + size * np.array([np.cos(towards), np.sin(towards)]))
    rows = np.array(sorted(wrong), dtype=int)
    return rows, np.array([wrong[row] for row in rows.tolist()]).reshape(-1, 2)


def _wrong_control(records: SimulatedRecords, random: np.random.Generator) -> tuple[str, ...]:
    """Return in a fifth of the blocks with eight weighted full control points and more the one that is wrong."""
    control = records.inputs.control.points
    full = [point.name for point in control if None not in point.coordinates and point.errors[0] != 0.0]
    if len(full) < 8 or random.random() > 0.2:
        return ()
    return (str(random.choice(full[3:])),)


def _blundered(
    records: SimulatedRecords, rows: np.ndarray, displaced: np.ndarray, control: tuple[str, ...]
) -> SimulatedRecords:
    inputs = records.inputs
    observations = inputs.observations
    measured = observations.measured.copy()
    measured[rows] = displaced
    points = tuple(
        replace(point, coordinates=tuple(np.add(point.coordinates, [0.0, 100.0 * point.errors[1], 0.0])))
        if point.name in control
        else point
        for point in inputs.control.points
    )
    changed = replace(
        inputs,
        measured=Measured(observations={record_key(observations.bundle): replace(observations, measured=measured)}),
        control=replace(inputs.control, points=points),
    )
    wrong = frozenset((observations.photos[row], observations.points[row]) for row in rows.tolist())
    return replace(records, inputs=changed, wrong=wrong, wrong_control=frozenset(control))
