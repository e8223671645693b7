"""Runs of the studies with blunders: what snooping names, and where the Danish method ends from two starts."""

from __future__ import annotations

import numpy as np
from monte_carlo.simulated_blocks import (
    NO_DOWN_WEIGHTING,
    design,
    random_numbers,
    solved,
    started_off,
    with_blunders,
    with_noise,
)
from msgspec import Struct
from support.synthetic_block import SyntheticBlock

from orip.adjustment.convergence import TerminationReason
from orip.bundle.snooping.search import Snooped, SnoopingSettings, snoop
from orip.records.block import Block
from orip.structs import replace

STARTS = (0.002, 0.004)
"""Errors of the two sets of starting values, as a part of the distance to the object, and in radians."""


class Simulated(Struct, frozen=True):
    """A block with blunders in the photo coordinates `rows` (x and y of each photo point in turn)."""

    block: Block
    made: SyntheticBlock
    rows: frozenset[int]

    @property
    def photo_points(self) -> frozenset[int]:
        return frozenset(row // 2 for row in self.rows)


class SnoopingRun(Struct, frozen=True):
    """How many photo points there are and are wrong, how many of the wrong and of the others were left out.

    `among_alternatives` counts the wrong ones that were left out or named as what may be wrong instead, `unfounded` the
    findings of which neither what was left out nor an alternative is wrong.
    """

    photo_points: int
    wrong: int
    named_rightly: int
    named_wrongly: int
    among_alternatives: int
    unfounded: int
    control_points: int
    control_named: int
    converged: bool


class DanishRun(Struct, frozen=True):
    """Coordinates in which there is a blunder, and those with a weight factor below 1 from each of the two starts."""

    wrong: frozenset[int]
    down_weighted: tuple[frozenset[int], ...]
    converged: tuple[bool, ...]
    iterations: tuple[int, ...]

    @property
    def agree(self) -> bool:
        return self.down_weighted[0] == self.down_weighted[1]


def simulated(scene: str, run: int) -> Simulated:
    """Return the block of a run; each has a geometry of its own."""
    random = random_numbers(f"blunders {scene}", run)
    made = design(scene, f"geometry {run}", **NO_DOWN_WEIGHTING)
    clean = with_noise(made, random)
    numbers = solved(clean).variance.redundancy_numbers
    blundered = with_blunders(clean, numbers, random)
    return Simulated(blundered.block, made, frozenset(blundered.rows.tolist()))


def snooping_run(case: tuple[str, int]) -> SnoopingRun:
    scene, run = case
    found = simulated(scene, run)
    start = started_off(found.block, found.made, STARTS[0], random_numbers(f"snooping {scene}", run))
    snooped = snoop(start, SnoopingSettings(sigma0="apriori", alpha=0.001), lambda _: None, lambda: False)
    named = _photo_points_named(found.block, snooped.blunders)
    groups = _photo_points_in_question(snooped)
    return SnoopingRun(
        photo_points=len(found.block.photo_points.photo),
        wrong=len(found.photo_points),
        named_rightly=len(named & found.photo_points),
        named_wrongly=len(named - found.photo_points),
        among_alternatives=len(found.photo_points & frozenset[int]().union(*groups)),
        unfounded=sum(found.photo_points.isdisjoint(group) for group in groups),
        control_points=len(found.block.control_points),
        control_named=len({blunder.point for blunder in snooped.blunders if blunder.kind == "control"}),
        converged=snooped.solved.reason is TerminationReason.CONVERGED,
    )


def danish_run(case: tuple[str, int, int]) -> DanishRun:
    """Adjust run `case[1]` of a scene from both starts, with weights reduced from iteration `case[2]` on."""
    scene, run, iteration = case
    found = simulated(scene, run)
    random = random_numbers(f"danish {scene}", run)
    definition = replace(
        found.block.definition, max_iterations=60, start_down_weight=iteration, max_standard_residual=5.0
    )
    robust = replace(found.block, definition=definition)
    ends = [solved(started_off(robust, found.made, relative, random)) for relative in STARTS]
    return DanishRun(
        wrong=found.rows,
        down_weighted=tuple(frozenset(np.flatnonzero(end.weight_factors < 1.0).tolist()) for end in ends),
        converged=tuple(end.reason is TerminationReason.CONVERGED for end in ends),
        iterations=tuple(len(end.iterations) for end in ends),
    )


def _photo_points_in_question(snooped: Snooped) -> list[frozenset[int]]:
    """Return for each finding the photo point left out and its alternatives; the rows of photo points come first."""
    return [frozenset(rows[0] // 2 for rows in (finding.rows, *finding.alternatives)) for finding in snooped.findings]


def _photo_points_named(block: Block, blunders: tuple) -> frozenset[int]:
    photos = {photo.name: place for place, photo in enumerate(block.photos)}
    points = block.point_index()
    rows = {
        (int(photo), int(point)): row
        for row, (photo, point) in enumerate(zip(block.photo_points.photo, block.photo_points.point, strict=True))
    }
    return frozenset(
        rows[photos[blunder.photo], points[blunder.point]] for blunder in blunders if blunder.kind == "photo"
    )
