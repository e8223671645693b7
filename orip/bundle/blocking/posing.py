"""A block as an adjustment problem whose photo points are divided into sub-blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from orip.adjustment.factorisation.dissection.tree import DissectionTree, InTurn, Passes, dissected, lowest_nodes
from orip.arrays import FloatArray, IntArray
from orip.bundle.blocking.dissected_loop import DissectedLoop
from orip.bundle.blocking.sub_block import HeldSubBlock, Members, SubBlock, SubBlockSource, divided
from orip.bundle.compiled.loop_pattern import blocks_of_points
from orip.bundle.compiled.streamed_rows import groups_of_unknowns, touched_groups
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.problem import BlockProblem, freed, posed
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.errors import NotSolvableError
from orip.records.block import Block
from orip.set_aside import set_aside
from orip.structs import replace

LARGEST_PART = 60
"""Photos up to which a part of a block is not divided. Larger parts take more memory, smaller ones more messages."""


class Spread(NamedTuple):
    """What passes over the nodes of a tree, and from where these get their sub-blocks."""

    passes: Passes
    sources: Sequence[SubBlockSource]


def in_this_process(tree: DissectionTree, sub_blocks: Iterable[SubBlock]) -> Spread:
    """Return sub-blocks that are kept in memory, one computed after the other."""
    return Spread(InTurn(tree), [HeldSubBlock(sub_block) for sub_block in sub_blocks])


def pose_divided(
    block: Block,
    spread: Callable[[DissectionTree, Iterable[SubBlock]], Spread] = in_this_process,
    largest: int = LARGEST_PART,
) -> BlockProblem:
    """Return the problem of a block, divided by nested dissection.

    Parameters
    ----------
    block : Block
    spread : callable
        Returns where the nodes are computed; sub-blocks are made as it takes them, one after the other.
    largest : int
        Photos up to which a part is not divided.

    Raises
    ------
    NotSolvableError
        If an observation couples unknowns in a way that no front has.
    """
    whole = posed(block)
    problem, unknowns = whole.problem, whole.problem.unknowns
    if whole.couples_points:
        message = "an observation connects an eliminated point with other unknowns: this block cannot be divided"
        raise NotSolvableError(message)
    of_point = blocks_of_points(unknowns)
    rays = set_aside(of_point[whole.photo_points.point])
    touching, touched = _touched(whole.photo_points, rays, unknowns)
    groups, pattern, central = touched_groups(
        unknowns, whole.others.columns(), touching, touched, unknowns.layout.blocks
    )
    tree = dissected(groups, pattern, central, _positions(block, unknowns, groups, pattern.shape[1]), largest)
    nodes = lowest_nodes(tree, groups, pattern)[: unknowns.layout.blocks]
    del touching, touched, pattern
    members: list[Members] = []

    def sub_blocks() -> Iterator[SubBlock]:
        for sub_block, of_node in divided(whole.photo_points, unknowns, block.point_start, tree, nodes):
            members.append(of_node)
            yield sub_block

    passes, sources = spread(tree, sub_blocks())
    loop = DissectedLoop(whole.photo_points, rays, tree, passes, sources, members)
    problem = replace(problem, streamed=(loop, whole.others))
    return freed(problem, block) if block.is_free_network else problem


def _touched(observed: PhotoPointObservations, rays: IntArray, unknowns: Unknowns) -> tuple[IntArray, IntArray]:
    """Return pairs of an eliminated point and an unknown: one of each group of a photo, or camera, that shows it."""
    is_eliminated = rays >= 0
    groups = groups_of_unknowns(unknowns)
    first = np.append(np.searchsorted(groups, groups), CONSTANT)
    cameras = np.hstack([unknowns.cameras, unknowns.additional])
    found = []
    for number, table in ((observed.photo, unknowns.photos), (observed.camera, cameras)):
        of_groups = np.sort(first[table], axis=1)
        of_groups[:, 1:][of_groups[:, 1:] == of_groups[:, :-1]] = CONSTANT
        pairs = np.unique(rays[is_eliminated] * len(table) + number[is_eliminated])
        point, row = np.divmod(pairs, len(table))
        at, place = np.nonzero(of_groups[row] != CONSTANT)
        found.append((point[at], of_groups[row[at], place]))
    points, columns = zip(*found, strict=True)
    return np.concatenate(points), np.concatenate(columns)


def _positions(block: Block, unknowns: Unknowns, groups: IntArray, count: int) -> FloatArray:
    """Return where the photos and tied points are, by groups of unknowns (g, 3); NaN for others."""
    found = np.full((count, 3), np.nan)
    for columns, places in ((unknowns.photos, block.photo_orientation[:, :3]), (unknowns.points, block.point_start)):
        first = np.where(columns == CONSTANT, len(groups), columns).min(axis=1)
        is_reduced = first < len(groups)
        found[groups[first[is_reduced]]] = places[is_reduced]
    return found
