"""Blocks whose photos share few points: solvable as a whole, though pairs and strips hardly hold together.

Film in strips at 20 % sidelap, aerial photos of small overlap and few points, and hand-held photos of facades. Unlike
the blocks of `preliminary_blocks.py` they need not hold together by models, joints and resections: it is enough that
the adjustment from the truth determines all unknowns.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
from monte_carlo.preliminary_blocks import weakness
from monte_carlo.preliminary_records import SimulatedRecords, cameras_of, records_of, true_minimum
from scipy.spatial.transform import Rotation
from support.block_scenes import Scene, height_field, looking, placed, relief, rows_and_columns
from support.tie_points import measured_points

from orip.errors import NotSolvableError
from orip.structs import replace

_ATTEMPTS = 400
_FEWEST = 4
"""Points of a photo."""


def film_at_small_sidelap(random: np.random.Generator, photos: int) -> Scene:
    """Return two to four strips of film with 60 % forward overlap and 15 to 22 % sidelap."""
    strips = int(random.integers(2, 5)) if photos >= 9 else 2
    return _aerial(random, photos, strips, random.uniform(0.58, 0.62), random.uniform(0.15, 0.22))


def small_overlaps(random: np.random.Generator, photos: int) -> Scene:
    """Return one to three strips with forward overlaps of 52 to 57 % and any sidelap."""
    strips = int(random.integers(1, 4)) if photos >= 6 else 1
    return _aerial(random, photos, strips, random.uniform(0.52, 0.57), random.uniform(0.2, 0.4))


def facades(random: np.random.Generator, photos: int) -> Scene:
    """Return hand-held photos of a facade some decimetres deep, in one or two rows, turned up and to the sides."""
    c = float(random.choice([24.0, 28.0, 35.0, 50.0]))
    frame = np.array([36.0, 24.0] if random.random() < 0.6 else [24.0, 36.0])
    distance = random.uniform(8.0, 40.0)
    rows = int(random.integers(1, 3)) if photos >= 6 else 1
    row, column = rows_and_columns(photos, rows)
    width, height = frame * distance / c
    base = random.uniform(0.25, 0.42) * width
    along = base * (column + 0.15 * random.normal(size=photos))
    up = 0.5 * height + random.uniform(0.3, 0.6) * height * row
    away = distance * (1.0 + 0.1 * random.normal(size=photos).clip(-2.0, 2.0))
    centres = np.column_stack([along, -away, np.full(photos, 1.6) + 0.2 * random.normal(size=photos)])
    aimed = np.column_stack([along + 0.15 * width * random.normal(size=photos), np.zeros(photos), up])
    deep = relief(random, random.uniform(0.005, 0.06) * distance, distance)
    surface, normals = height_field(
        random, (along.min() - 0.6 * width, along.max() + 0.6 * width), (0.0, up.max() + 0.6 * height), deep,
        80 * photos + 400,
    )  # fmt: skip
    # the field's heights point out of the facade, to -Y
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    turned = looking(aimed - centres, 3.0 * random.normal(size=photos))
    return placed(Scene(c, frame, centres, turned, surface @ upright, normals @ upright), random, 1000.0)


SCENES: dict[str, Callable[[np.random.Generator, int], Scene]] = {
    "film at 20 % sidelap": film_at_small_sidelap,
    "small overlaps": small_overlaps,
    "facades": facades,
}
WEAK_FAMILIES = tuple(SCENES)

_WANTED = {"film at 20 % sidelap": (8, 13), "small overlaps": (6, 12), "facades": (7, 14)}
"""Points of a photo."""

_LARGEST = 40


def weakly_joined_records(run: int, family: str | None = None, largest: int = _LARGEST) -> SimulatedRecords:
    """Return the block of a run; families take turns unless one is named."""
    family = WEAK_FAMILIES[run % len(WEAK_FAMILIES)] if family is None else family
    seed = [zlib.crc32(f"weakly joined {family}".encode()), run]
    photos = round(np.exp(np.random.default_rng(seed).uniform(np.log(4), np.log(largest))))
    rejected: list[str] = []
    for attempt in range(_ATTEMPTS):
        made = _drawn(family, run, photos, np.random.default_rng([*seed, attempt]))
        if isinstance(made, SimulatedRecords):
            return replace(made, rejected=tuple(rejected))
        rejected.append(made)
    message = f"run {run} of {family} with {photos} photos: {rejected}"
    raise RuntimeError(message)


def _drawn(family: str, run: int, photos: int, random: np.random.Generator) -> SimulatedRecords | str:
    scene = SCENES[family](random, photos)
    wanted = int(random.integers(*_WANTED[family], endpoint=True))
    ties = measured_points(scene, random, wanted, random.uniform(0.8, 1.0), von_gruber=random.random() < 0.7)
    if np.bincount(ties.photo, minlength=photos).min() < _FEWEST:
        return "a photo without points"
    given, true = cameras_of(scene, random, wrong=False)
    records = records_of(family, run, scene, ties, random, (given, true))
    try:
        return weakness(true_minimum(records)) or records
    except NotSolvableError as error:
        return str(error)


def _aerial(random: np.random.Generator, photos: int, strips: int, forward: float, sideways: float) -> Scene:
    """Return near-vertical photos in strips that are flown there and back."""
    c, side = 153.0, 230.0
    per_mm = random.uniform(4.0, 20.0)
    flying_height = c * per_mm
    row, column = rows_and_columns(photos, strips)
    base, spacing = (1.0 - forward) * side * per_mm, (1.0 - sideways) * side * per_mm
    centres = np.column_stack([base * column, spacing * row, np.full(photos, flying_height)])
    centres += random.normal(size=(photos, 3)) * [0.02 * base, 0.01 * spacing, 0.01 * flying_height]
    tilt = random.uniform(-3.0, 3.0, (photos, 2))
    kappa = 180.0 * (row % 2) + 2.0 * random.normal(size=photos)
    edge = 0.5 * side * per_mm
    hills = relief(random, flying_height * np.exp(random.uniform(np.log(0.002), np.log(0.1))), flying_height)
    surface, normals = height_field(
        random, (-edge, base * column.max() + edge), (-edge, spacing * row.max() + edge), hills, 80 * photos + 400
    )
    rotations = Rotation.from_euler("XYZ", np.column_stack([tilt, kappa]), degrees=True).as_matrix()
    return placed(Scene(c, np.array([side, side]), centres, rotations, surface, normals), random, 1e5)
