"""Tracks as feature matching gives them: up to 30 % of the photo points wrong, grossly or near the epipolar line.

Points have many rays; at least three right ones stay in each, so that the right rays determine it and the wrong ones
show. Photos are those of the study of preliminary values.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
from monte_carlo.preliminary_blocks import weakness
from monte_carlo.preliminary_records import SimulatedRecords, cameras_of, records_of, true_minimum
from monte_carlo.weakly_joined_blocks import SCENES as WEAK_SCENES
from support.block_scenes import Scene, aerial_strips, convergent
from support.tie_points import TiePoints, measured_points

from orip.adjustment.convergence import TerminationReason
from orip.bundle.solve import SolvedBlock
from orip.errors import NotSolvableError
from orip.records.measurement import PhotoObservations
from orip.structs import replace

_ATTEMPTS = 200
_RIGHT_RAYS = 3
_LEAST_PHOTO_POINTS = 15
_OFF_MM = 0.1
"""Least error of a wrong photo point: twenty times the noise."""

SCENES: tuple[Callable[[np.random.Generator, int], Scene], ...] = (aerial_strips, convergent, WEAK_SCENES["facades"])

Displacement = Callable[[Scene, TiePoints, int, np.random.Generator], np.ndarray]


def _anywhere(scene: Scene, _ties: TiePoints, _row: int, random: np.random.Generator) -> np.ndarray:
    """Return any place of the frame."""
    return random.uniform(-0.5, 0.5, 2) * scene.frame


def _near_the_epipolar_line(scene: Scene, ties: TiePoints, row: int, random: np.random.Generator) -> np.ndarray:
    """Return where another place on the ray of another photo would be seen: 60 to 160 % of the point's distance."""
    photo, place = ties.photo[row], ties.place[row]
    others = np.flatnonzero((ties.place == place) & (ties.photo != photo))
    other = ties.photo[random.choice(others)]
    factor = random.choice([random.uniform(0.6, 0.92), random.uniform(1.08, 1.6)])
    point = scene.centres[other] + factor * (scene.surface[place] - scene.centres[other])
    u = (point - scene.centres[photo]) @ scene.rotations[photo]
    return -scene.principal_distance * u[:2] / u[2] + 0.01 * random.normal(size=2)


FAMILIES: dict[str, Displacement] = {
    "gross outliers": _anywhere,
    "outliers near the epipolar line": _near_the_epipolar_line,
}


def outlier_records(run: int, largest: int = 40, part: float = 0.3) -> SimulatedRecords:
    """Return the block of a run, of whose photo points up to a part is wrong, two thirds of it at least.

    Families take turns.
    """
    family = tuple(FAMILIES)[run % len(FAMILIES)]
    seed = [zlib.crc32(family.encode()), run]
    photos = round(np.exp(np.random.default_rng(seed).uniform(np.log(6), np.log(largest))))
    rejected: list[str] = []
    for attempt in range(_ATTEMPTS):
        made = _drawn(family, run, photos, part, np.random.default_rng([*seed, attempt]))
        if isinstance(made, SimulatedRecords):
            return replace(made, rejected=tuple(rejected))
        rejected.append(made)
    message = f"run {run} of {family} with {photos} photos: {rejected}"
    raise RuntimeError(message)


def _drawn(family: str, run: int, photos: int, part: float, random: np.random.Generator) -> SimulatedRecords | str:
    scene = SCENES[random.integers(len(SCENES))](random, photos)
    ties = measured_points(scene, random, int(random.integers(40, 90)), 0.95, von_gruber=False)
    if np.bincount(ties.photo, minlength=photos).min() < _LEAST_PHOTO_POINTS:
        return "a photo with few points"
    measured = _with_outliers(scene, ties, random.uniform(2.0 / 3.0, 1.0) * part, FAMILIES[family], random)
    given, true = cameras_of(scene, random, wrong=False)
    state = random.bit_generator.state
    clean = records_of(family, run, scene, ties, random, (given, true))
    random.bit_generator.state = state
    records = records_of(family, run, scene, replace(ties, xy=measured), random, (given, true))
    try:
        if reason := weakness(true_minimum(clean)):
            return reason
        wrong = _different(clean.inputs.observations, records.inputs.observations)
        return _unfit(true_minimum(records), len(wrong)) or replace(records, wrong=wrong)
    except NotSolvableError as error:
        return str(error)


def _different(clean: PhotoObservations, measured: PhotoObservations) -> frozenset[tuple[str, str]]:
    """Return photo and point of what was measured elsewhere."""
    rows = np.flatnonzero((clean.measured != measured.measured).any(axis=1)).tolist()
    return frozenset((clean.photos[row], clean.points[row]) for row in rows)


def _with_outliers(
    scene: Scene, ties: TiePoints, part: float, displaced: Displacement, random: np.random.Generator
) -> np.ndarray:
    """Return ideal photo coordinates, a part of them wrong."""
    right, wanted = np.bincount(ties.place), part * len(ties.photo)
    measured = ties.xy.copy()
    for row in random.permutation(len(ties.photo)).tolist():
        if wanted < 1.0:
            break
        if right[ties.place[row]] <= _RIGHT_RAYS:
            continue
        xy = displaced(scene, ties, row, random)
        if np.linalg.norm(xy - ties.xy[row]) < _OFF_MM or (np.abs(xy) > 0.5 * scene.frame).any():
            continue
        right[ties.place[row]] -= 1
        wanted -= 1.0
        measured[row] = xy
    return measured


def _unfit(found: SolvedBlock, wrong: int) -> str:
    """Return why the truth is no clear minimum: it must converge, and reduce weights of wrong photo points alone."""
    if found.reason is not TerminationReason.CONVERGED:
        return "does not converge from the truth"
    if found.normals.removed.any():
        return "singular"
    n = found.block.photo_points.xy.size
    reduced = (found.weight_factors[:n] < 1.0).reshape(-1, 2).any(axis=1)
    return "" if np.count_nonzero(reduced) <= 1.02 * wrong else "others down-weighted"
