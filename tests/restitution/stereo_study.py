"""Vertices of known place measured in two photos of a synthetic block, with the errors that the block has."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from support.synthetic_block import SyntheticBlock, synthetic_block

from orip.bundle.solve import SolvedBlock, solve_block
from orip.restitution.intersection import StereoMarks

NOISE = 0.005


def solved_strip(name: str, noise: float = NOISE, **settings: object) -> tuple[SyntheticBlock, SolvedBlock]:
    made = synthetic_block("strip", name, noise_mm=noise, precision_mm=NOISE, start_error=1e-4, **settings)
    return made, solve_block(made.block, lambda _: None, lambda: False)


def images(made: SyntheticBlock, photo: int, xyz: np.ndarray) -> np.ndarray:
    """Return photo coordinates without distortion, by scipy."""
    u = (xyz - made.orientations[photo, :3]) @ Rotation.from_euler("XYZ", made.orientations[photo, 3:]).as_matrix()
    c, x0, y0 = made.cameras[0, :3]
    return -c * u[:, :2] / u[:, 2:] + [x0, y0]


def places_between(made: SyntheticBlock, left: int, right: int, count: int, random: np.random.Generator) -> np.ndarray:
    middle = made.orientations[[left, right], :2].mean(axis=0)
    plan = middle + random.uniform(-200.0, 200.0, (count, 2))
    return np.column_stack([plan, random.uniform(180.0, 260.0, count)])


def measured(
    made: SyntheticBlock, left: int, right: int, xyz: np.ndarray, random: np.random.Generator, noise: float = NOISE
) -> StereoMarks:
    xy = np.stack([images(made, photo, xyz) for photo in (left, right)], axis=1)
    count = len(xyz)
    return StereoMarks(
        np.full(count, left), np.full(count, right), xy + noise * random.normal(size=xy.shape),
        np.full(xy.shape, NOISE),
    )  # fmt: skip
