"""Partial blocks whose place is known: models in two systems, strips of models, blocks with ground control."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.geometry.rotation import rotation_from_angles
from orip.geometry.similarity import Similarity
from orip.prelim.similarity.absolute_orientation import KnownPositions
from orip.records.preliminary import PartialBlock
from orip.structs import replace

NOISE = 1e-5
"""Metres at photo scale: 10 µm in X and Y of a model, three times as much in Z."""


class SampleNames(Struct, frozen=True):
    photos: tuple[str, ...]
    points: tuple[str, ...]


def random_similarity(generator: np.random.Generator, scale: float = 1.0, shift: float = 0.3) -> Similarity:
    rotation = Rotation.random(rng=generator).as_matrix()
    return Similarity(scale * float(np.exp(0.3 * generator.normal())), rotation, generator.normal(0.0, shift, 3))


class Pair(Struct, frozen=True):
    """A model B-C, a model A-B in a system of its own, and what takes the first to it."""

    source: PartialBlock
    target: PartialBlock
    names: SampleNames
    truth: Similarity
    wrong: np.ndarray

    def error(self, similarity: Similarity) -> float:
        """Return the largest difference over the source's points, in units of their noise."""
        difference = similarity.apply(self.source.coordinates) - self.truth.apply(self.source.coordinates)
        return float(np.abs(difference).max()) / (NOISE * self.truth.scale)


def pair(seed: int, count: int = 20, wrong: int = 0, noise: float = NOISE, common_photo: bool = True) -> Pair:
    """Return two models with `count` common points, `wrong` of which have interchanged names in the target."""
    generator = np.random.default_rng(seed)
    truth = random_similarity(generator)
    exact = np.column_stack([generator.uniform(-0.1, 0.1, (count, 2)), -0.15 + 0.005 * generator.normal(size=count)])
    sigma = np.broadcast_to([1.0, 1.0, 3.0], (count, 3))
    source = exact + noise * sigma * generator.normal(size=(count, 3))
    target = truth.apply(exact + noise * sigma * generator.normal(size=(count, 3)))
    mixed = generator.choice(count, wrong, replace=False)
    target[mixed] = target[np.roll(mixed, 1)] if wrong > 1 else target[mixed] + 0.05
    turned = np.sqrt((NOISE * sigma) ** 2 @ (truth.rotation**2).T) * truth.scale
    centres = np.array([[0.0, 0.0, 0.0], [0.09, 0.0, 0.0]])
    rotations = rotation_from_angles(np.array([[0.0, 0.0, 0.0], [0.01, 0.02, 0.03]]))
    # the rotation of a photo in a model is some ten times less certain than that of a whole model
    common_rotation = rotation_from_angles(5e-3 * generator.normal(size=3)) @ truth.rotation
    common_centre = truth.apply(noise * generator.normal(size=3))
    photos = (1, 2) if common_photo else (2, 3)
    points = np.arange(count)
    return Pair(
        PartialBlock("BC", np.array(photos), rotations, centres, points, source, NOISE * sigma),
        PartialBlock(
            "AB", np.array([0, 1]), np.array([np.eye(3), common_rotation]),
            np.array([truth.apply(np.array([-0.09, 0.0, 0.0])), common_centre]), points, target, turned,
        ),
        SampleNames(("A", "B", "C", "D"), tuple(str(201 + k) for k in points)),
        truth,
        mixed,
    )  # fmt: skip


class GroundSample(Struct, frozen=True):
    """A block in its own system, control, and what takes it to the ground."""

    block: PartialBlock
    names: SampleNames
    control: KnownPositions
    centres: KnownPositions
    truth: Similarity
    wrong: np.ndarray

    def turned_by(self, similarity: Similarity) -> float:
        """Return the angle in degrees between a rotation and the true one."""
        return float(np.degrees(Rotation.from_matrix(similarity.rotation @ self.truth.rotation.T).magnitude()))


def ground_sample(
    seed: int, full: int = 0, plan: int = 0, height: int = 0, wrong: int = 0, noise: float = 0.02, relief: float = 60.0
) -> GroundSample:
    """Return a strip of four photos 2000 above ground of 2000 by 1000 and its control.

    Known are `full` points in X, Y, Z, `plan` in X and Y, `height` in Z; `wrong` of them are off by 20 to 200.
    """
    generator = np.random.default_rng(seed)
    truth = random_similarity(generator, 5000.0)
    base, count = np.array([4e5, 5e6, 300.0]), full + plan + height
    truth = replace(truth, shift=base)
    low, high = [-500.0, -500.0], [1500.0, 500.0]
    exact = base + np.column_stack([generator.uniform(low, high, (count, 2)), relief * generator.normal(size=count)])
    cameras = base + np.column_stack([np.linspace(-400.0, 1400.0, 4), np.zeros(4), np.full(4, 2000.0)])
    rotations = rotation_from_angles(0.05 * generator.normal(size=(4, 3)))
    deviations = np.full((count, 3), noise / truth.scale)
    given = exact + noise * generator.normal(size=exact.shape)
    mixed = generator.choice(count, wrong, replace=False)
    given[mixed] += generator.choice([-1.0, 1.0], (wrong, 3)) * generator.uniform(20.0, 200.0, (wrong, 3))
    known = np.ones((count, 3), dtype=bool)
    known[full : full + plan, 2] = False
    known[full + plan :, :2] = False
    back = truth.inverse()
    names = SampleNames(("A", "B", "C", "D"), tuple(f"C{k}" for k in range(count)))
    return GroundSample(
        PartialBlock(
            "AB", np.arange(4), truth.rotation.T @ rotations, back.apply(cameras), np.arange(count),
            back.apply(exact) + deviations * generator.normal(size=exact.shape), deviations,
        ),
        names,
        KnownPositions(names.points, np.where(known, given, np.nan), np.where(known, noise, np.nan)),
        KnownPositions(names.photos, cameras + generator.normal(size=(4, 3)), np.full((4, 3), 1.0)),
        truth,
        mixed,
    )  # fmt: skip


def mirrored(block: PartialBlock) -> PartialBlock:
    """Return the block that photos with x counted to the left give: a mirror image, with proper rotations."""
    flip = np.diag([-1.0, 1.0, 1.0])
    return replace(
        block,
        coordinates=block.coordinates @ flip,
        centres=block.centres @ flip,
        rotations=flip @ block.rotations @ flip,
    )
