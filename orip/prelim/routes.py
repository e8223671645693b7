"""The routes to a block in one system: by its models, by control in the photos, by pairs of photos."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import groupby
from operator import itemgetter
from typing import overload

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.block_grower import BlockGrower
from orip.prelim.growing_block import GrowingBlock, empty_growing_block, growing_block_of
from orip.prelim.rays import ImageRays, PhotoIndex
from orip.prelim.refinement import ROUGH, no_corrections
from orip.prelim.relative.orientation import OrientedPair, listed, orient_two_photos, pairs_by_common_points
from orip.prelim.relative.solution import POINTS_NEEDED
from orip.prelim.sampling import median
from orip.prelim.similarity.bridging import JoinedSystems, bridge_row, connect_strips
from orip.records.definition import StereoModel
from orip.records.names import record_key
from orip.records.preliminary import NotOriented, RelativeOrientation, SimilarityStep
from orip.structs import replace
from orip.wording import counted


class OrientedModel(Struct, frozen=True):
    """A model that is oriented relatively.

    Parameters
    ----------
    row, column : int or None
        Place of the model; None for a pair of photos that the chain chose itself.
    """

    pair: OrientedPair
    row: int | None = None
    column: int | None = None


class ListedModels(Sequence[RelativeOrientation]):
    """Models as listings show them; they are made when the first of them is read, as preliminary values need none."""

    def __init__(self, rays: ImageRays, models: Sequence[OrientedModel]) -> None:
        self._rays, self._models = rays, models

    @cached_property
    def _listed(self) -> tuple[RelativeOrientation, ...]:
        return tuple(listed(self._rays, model.pair, model.row, model.column) for model in self._models)

    def __len__(self) -> int:
        """Return the number of models."""
        return len(self._models)

    @overload
    def __getitem__(self, place: int) -> RelativeOrientation: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[RelativeOrientation]: ...
    def __getitem__(self, place: int | slice) -> RelativeOrientation | Sequence[RelativeOrientation]:
        """Return one model, or several."""
        return self._listed[place]


def in_driving_order(models: Sequence[StereoModel]) -> list[StereoModel]:
    """Return models by row and column: the order of 'next model'."""
    return sorted(models, key=lambda model: (model.row, model.column))


def orient_model(rays: ImageRays, model: StereoModel, index: PhotoIndex) -> OrientedModel | NotOriented:
    """Orient one model relatively; a photo that has no photo points is the reason why not."""
    return _oriented(rays, _places(rays), model, index)


def _places(rays: ImageRays) -> dict[str, int]:
    return {record_key(name): place for place, name in enumerate(rays.photos)}


def _oriented(
    rays: ImageRays, places: Mapping[str, int], model: StereoModel, index: PhotoIndex
) -> OrientedModel | NotOriented:
    missing = [name for name in (model.left, model.right) if record_key(name) not in places]
    if missing:
        return NotOriented(model.name, "", f"photo {' and photo '.join(missing)} has no photo points")
    left, right = places[record_key(model.left)], places[record_key(model.right)]
    found = orient_two_photos(rays, left, right, model=model.name, index=index)
    if isinstance(found, NotOriented):
        return replace(found, reason=found.reason + _other_partners(rays, (left, right), index))
    return OrientedModel(found, model.row, model.column)


def _other_partners(rays: ImageRays, pair: tuple[int, int], index: PhotoIndex) -> str:
    """Say which photos share more points with a photo of the model than the model's two photos with each other."""
    common = len(index.common_points(*pair)[0])
    partners = []
    for photo in pair:
        seen = np.zeros(len(rays.points), dtype=bool)
        seen[index.points[photo]] = True
        shared = np.bincount(rays.photo[seen[rays.point]], minlength=len(rays.photos))
        shared[photo] = 0
        if (most := int(shared.max())) > max(common, POINTS_NEEDED):
            partners.append(f"photo {rays.photos[photo]} shares {most} with photo {rays.photos[shared.argmax()]}")
    return f"; {' and '.join(partners)}" if partners else ""


def orient_models(
    rays: ImageRays, models: Sequence[StereoModel], index: PhotoIndex
) -> tuple[list[OrientedModel], list[NotOriented]]:
    """Orient all models relatively, in driving order."""
    places = _places(rays)
    found = [_oriented(rays, places, model, index) for model in in_driving_order(models)]
    oriented = [model for model in found if isinstance(model, OrientedModel)]
    return oriented, [model for model in found if isinstance(model, NotOriented)]


def bridge_rows(oriented: Sequence[OrientedModel], rays: ImageRays) -> JoinedSystems:
    """Bridge oriented models, given in driving order, to strips."""
    of_rows = groupby(oriented, lambda model: model.row)
    rows = [bridge_row([model.pair.block for model in of_row], rays) for _, of_row in of_rows]
    return JoinedSystems(
        tuple(system for row in rows for system in row.systems),
        tuple(step for row in rows for step in row.steps),
        tuple(failure for row in rows for failure in row.failures),
    )


def connect_rows(bridged: JoinedSystems, rays: ImageRays) -> JoinedSystems:
    """Connect strips, in the order of their rows, to a block."""
    return connect_strips(bridged.systems, rays)


# Each route gives one or more blocks in systems of their own, or one that is on the ground from the beginning.

POINTS_FOR_A_PAIR = 5

_PAIRS_COMPARED = 12
"""Number of pairs with most common points from which the first pair of a system is chosen."""

_GOOD_ANGLE = np.radians(20.0)
"""Rays that meet at this angle fix depths as well as any."""

SAFE_RESECTION, LEAST_RESECTION = 6, 3
"""Control points with which a photo is resected without others: of six one may be wrong, three have no check."""


class Route(Struct, frozen=True):
    """Where one route led.

    Parameters
    ----------
    systems : tuple of GrowingBlock
        The largest first.
    on_ground : bool
        The systems (then one) are on the ground.
    """

    systems: tuple[GrowingBlock, ...]
    on_ground: bool = False
    relative: Sequence[RelativeOrientation] = ()
    bridges: tuple[SimilarityStep, ...] = ()
    connections: tuple[SimilarityStep, ...] = ()
    failures: tuple[NotOriented, ...] = ()


def by_models(grower: BlockGrower, models: Sequence[StereoModel]) -> Route:
    """Go by the models of the bundle: relative orientation, bridging, connection; other photos are added to them."""
    oriented, not_oriented = orient_models(grower.rays, models, grower.index)
    bridged = bridge_rows(oriented, grower.rays)
    connected = connect_rows(bridged, grower.rays)
    blocks = sorted(connected.systems, key=lambda block: -len(block.photos))
    sentences = _how_by_models(grower.rays, oriented, bridged, connected.steps)
    systems = [_with_sentences(growing_block_of(grower.rays, block, ""), grower.rays, sentences) for block in blocks]
    return Route(
        (grower.grow(systems[0], ROUGH), *systems[1:]) if systems else (),
        relative=ListedModels(grower.rays, oriented),
        bridges=bridged.steps,
        connections=connected.steps,
        failures=(*not_oriented, *bridged.failures, *connected.failures),
    )


def _how_by_models(
    rays: ImageRays,
    oriented: Sequence[OrientedModel],
    bridged: JoinedSystems,
    connections: Sequence[SimilarityStep],
) -> dict[str, str]:
    """Say for each photo in which model it was oriented, and how that model was joined to the block."""
    bridges = {step.source: step for step in bridged.steps}
    strips = {photo: strip.name for strip in bridged.systems for photo in strip.photos.tolist()}
    connected = {step.source: step for step in connections}
    sentences: dict[str, str] = {}
    for model in oriented:
        name = model.pair.block.name
        sentence = f"relative orientation in model {name} from {len(model.pair.rows[0])} points"
        if step := bridges.get(name):
            sentence += f", bridged to model {step.target} by {_common(step)}"
        for photo in model.pair.photos:
            strip = connected.get(strips[photo])
            said = sentence + (f", connected to the block by {_common(strip)}" if strip else "")
            sentences.setdefault(rays.photos[photo], said)
    return sentences


def _common(step: SimilarityStep) -> str:
    points = counted(len(step.points), "point")
    return f"{points} and photo {step.common_photo}" if step.common_photo else points


def _with_sentences(grown: GrowingBlock, rays: ImageRays, sentences: Mapping[str, str]) -> GrowingBlock:
    pairs = zip(rays.photos, grown.oriented, strict=True)
    return replace(grown, how=tuple(sentences[photo] if oriented else "" for photo, oriented in pairs))


def by_control(grower: BlockGrower) -> Route:
    """Go by resection of the photos that see enough control points; `grower` holds the control."""
    return Route((grower.grow(control_start(grower)),), on_ground=True)


def control_start(grower: BlockGrower) -> GrowingBlock:
    """Return the control of a block, and no photo yet."""
    deviations = np.where(np.isnan(grower.held), np.nan, 0.0)
    return replace(empty_growing_block(grower.rays), coordinates=grower.held.copy(), deviations=deviations)


def by_given(grower: BlockGrower, rotations: FloatArray, centres: FloatArray) -> Route:
    """Go by the photos whose orientation is given in full: intersection, and growing from there."""
    start = replace(empty_growing_block(grower.rays), rotations=rotations, centres=centres)
    start = replace(start, how=tuple("given" if given else "" for given in start.oriented))
    return Route((grower.grow(grower.intersected(start)),), on_ground=True)


def by_pairs(grower: BlockGrower, choice: int) -> Route:
    """Go from the best pairs of photos; `choice` 0 begins with the best, 1 with the second best pair, ..."""
    systems: list[GrowingBlock] = []
    starts: list[OrientedModel] = []
    free = np.ones(len(grower.rays.photos), dtype=bool)
    while (start := _starting_pair(grower, free, choice if not systems else 0)) is not None:
        left, right = (grower.rays.photos[photo] for photo in start.photos)
        how = f"model of photos {left} and {right}, {len(start.rows[0])} points"
        system = grower.grown_from(start, how, no_corrections(grower.rays))
        systems.append(system)
        starts.append(OrientedModel(start))
        free &= ~system.oriented
        # the two photos may have been removed as wrong, and would begin the same system again
        free[start.block.photos] = False
    systems.sort(key=lambda system: -int(system.oriented.sum()))
    return Route(tuple(systems), relative=ListedModels(grower.rays, starts))


def control_points_seen(grower: BlockGrower) -> IntArray:
    """Return how many control points each photo sees."""
    known = grower.held_points
    return np.array([np.count_nonzero(known[points]) for points in grower.index.points], dtype=np.int64)


def _starting_pair(grower: BlockGrower, free: BoolArray, choice: int) -> OrientedPair | None:
    """Return the pair of free photos that determines its points best, or the next best ones."""
    counts = np.where(free[:, None] & free, grower.common, 0)
    found: list[tuple[float, OrientedPair]] = []
    for left, right, common in pairs_by_common_points(counts, POINTS_FOR_A_PAIR)[:_PAIRS_COMPARED]:
        # pairs come with fewer and fewer points, and none is better than with all of them at a good angle
        if sum(worth >= math.sqrt(common) * _GOOD_ANGLE for worth, _ in found) > choice:
            break
        pair = grower.model(left, right)
        if isinstance(pair, OrientedPair):
            found.append((worth_of_pair(pair), pair))
    found.sort(key=itemgetter(0), reverse=True)
    return found[min(choice, len(found) - 1)][1] if found else None


def worth_of_pair(pair: OrientedPair) -> float:
    """Return how good a starting pair is: many points that fit, at good angles."""
    to_left = pair.block.coordinates
    to_right = to_left - pair.base
    lengths = np.linalg.norm(to_left, axis=1) * np.linalg.norm(to_right, axis=1)
    if not len(lengths):
        return 0.0
    angles = np.arccos(np.clip(np.sum(to_left * to_right, axis=1) / lengths, -1.0, 1.0))
    return float(np.sqrt(len(angles)) * min(median(angles), _GOOD_ANGLE))
