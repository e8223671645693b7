"""The ways to a block in one system: by its models, by control in the photos, by pairs of photos, by what is given.

Each way gives sub-blocks in systems of their own, or one that is on the ground from the beginning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.prelim.growing import Growth
from orip.prelim.model_steps import bridge_rows, connect_rows, orient_models
from orip.prelim.placed import Placed, nothing_placed, placed_block
from orip.prelim.refinement.refinement import ROUGH
from orip.prelim.relative.pair_selection import pairs_by_common_points
from orip.prelim.similarity.bridging import JoinedSystems
from orip.records.preliminary import ImageRays, NotOriented, RelativeOrientation, SimilarityStep
from orip.records.project import StereoModel
from orip.wording import counted

POINTS_FOR_A_PAIR = 5

_PAIRS_COMPARED = 12
"""Pairs with most common points that the first pair of a system is chosen from."""

_GOOD_ANGLE = np.radians(20.0)
"""Rays that meet at this angle fix depths as well as any."""

_KNOWN_POINTS = 6
"""Control points in a photo that orient it on their own, one of them wrong."""


@dataclass(frozen=True, slots=True)
class Route:
    """Where one way led.

    Parameters
    ----------
    systems : tuple of Placed
        The largest first.
    on_ground : bool
        The systems (then one) are on the ground.
    relative : tuple of RelativeOrientation
    bridges, connections : tuples of SimilarityStep
    failures : tuple of NotOriented
    """

    systems: tuple[Placed, ...]
    on_ground: bool = False
    relative: tuple[RelativeOrientation, ...] = ()
    bridges: tuple[SimilarityStep, ...] = ()
    connections: tuple[SimilarityStep, ...] = ()
    failures: tuple[NotOriented, ...] = ()


def by_models(growth: Growth, models: Sequence[StereoModel]) -> Route:
    """Go by the models of the bundle: relative orientation, bridging, connection; other photos are added to them."""
    relative, not_relative = orient_models(growth.rays, models, growth.index)
    bridged = bridge_rows(relative, growth.rays)
    connected = connect_rows(bridged, growth.rays)
    blocks = sorted(connected.systems, key=lambda block: -len(block.photos))
    told = _how_by_models(growth.rays, relative, bridged, connected.steps)
    systems = [_with_sentences(placed_block(growth.rays, block, ""), growth.rays, told) for block in blocks]
    return Route(
        (growth.grown(systems[0], ROUGH), *systems[1:]) if systems else (),
        relative=tuple(relative),
        bridges=bridged.steps,
        connections=connected.steps,
        failures=(*not_relative, *bridged.failures, *connected.failures),
    )


def _how_by_models(
    rays: ImageRays,
    relative: Sequence[RelativeOrientation],
    bridged: JoinedSystems,
    connections: Sequence[SimilarityStep],
) -> dict[str, str]:
    """Say of each photo in which model it was oriented, and how that came to the block."""
    bridges = {step.source: step for step in bridged.steps}
    strips = {rays.photos[photo]: strip.name for strip in bridged.systems for photo in strip.photos}
    connected = {step.source: step for step in connections}
    told: dict[str, str] = {}
    for model in relative:
        sentence = f"relative orientation in model {model.model} from {len(model.points)} points"
        if step := bridges.get(model.model):
            sentence += f", bridged to model {step.target} by {_common(step)}"
        for photo in (model.left, model.right):
            strip = connected.get(strips[photo])
            told.setdefault(photo, sentence + (f", connected to the block by {_common(strip)}" if strip else ""))
    return told


def _common(step: SimilarityStep) -> str:
    points = counted(len(step.points), "point")
    return f"{points} and photo {step.common_photo}" if step.common_photo else points


def _with_sentences(placed: Placed, rays: ImageRays, told: Mapping[str, str]) -> Placed:
    pairs = zip(rays.photos, placed.oriented, strict=True)
    return replace(placed, how=tuple(told[photo] if oriented else "" for photo, oriented in pairs))


def by_control(growth: Growth) -> Route:
    """Go by resection of the photos that see enough control points; `growth` holds the control."""
    start = nothing_placed(growth.rays)
    start = replace(start, coordinates=growth.held.copy(), deviations=np.where(np.isnan(growth.held), np.nan, 0.0))
    return Route((growth.grown(start),), on_ground=True)


def by_given(growth: Growth, rotations: FloatArray, centres: FloatArray) -> Route:
    """Go by the photos whose orientation is given in full: intersection, and growing from there."""
    start = replace(nothing_placed(growth.rays), rotations=rotations, centres=centres)
    start = replace(start, how=tuple("given" if given else "" for given in start.oriented))
    return Route((growth.grown(growth.intersected(start)),), on_ground=True)


def by_pairs(growth: Growth, choice: int) -> Route:
    """Go from the best pairs of photos; `choice` 0 begins with the best, 1 with the second best pair, ..."""
    systems: list[Placed] = []
    relative: list[RelativeOrientation] = []
    free = np.ones(len(growth.rays.photos), dtype=bool)
    while (start := _starting_pair(growth, free, choice if not systems else 0)) is not None:
        how = f"model of photos {start.left} and {start.right}, {len(start.points)} points"
        system = growth.grown(placed_block(growth.rays, start.block, how), ROUGH)
        systems.append(system)
        relative.append(start)
        free &= ~system.oriented
        # they may have turned out to be in the wrong place there, and would begin the same system again
        free[start.block.photos] = False
    systems.sort(key=lambda system: -int(system.oriented.sum()))
    return Route(tuple(systems), relative=tuple(relative))


def photos_with_control(growth: Growth) -> BoolArray:
    """Return which photos see enough control points for a resection that a wrong one does not spoil."""
    known = growth.held_points
    return np.array([int(known[points].sum()) >= _KNOWN_POINTS for points in growth.index.points], dtype=np.bool_)


def _starting_pair(growth: Growth, free: BoolArray, choice: int) -> RelativeOrientation | None:
    """Return the pair of free photos that determines its points best, or the next best ones."""
    counts = np.where(free[:, None] & free, growth.common, 0)
    found: list[RelativeOrientation] = []
    for left, right, common in pairs_by_common_points(counts, POINTS_FOR_A_PAIR)[:_PAIRS_COMPARED]:
        # pairs come with ever fewer points, and one cannot be worth more than with all of them at a good angle
        if sum(_worth(each) >= np.sqrt(common) * _GOOD_ANGLE for each in found) > choice:
            break
        pair = growth.model(left, right)
        if isinstance(pair, RelativeOrientation):
            found.append(pair)
    found.sort(key=_worth, reverse=True)
    return found[min(choice, len(found) - 1)] if found else None


def _worth(pair: RelativeOrientation) -> float:
    """Return what a pair is worth as the first: many points that fit, at good angles."""
    to_left = pair.block.coordinates
    to_right = to_left - pair.base
    lengths = np.linalg.norm(to_left, axis=1) * np.linalg.norm(to_right, axis=1)
    if not len(lengths):
        return 0.0
    angles = np.arccos(np.clip(np.sum(to_left * to_right, axis=1) / lengths, -1.0, 1.0))
    return float(np.sqrt(len(angles)) * min(float(np.median(angles)), _GOOD_ANGLE))
