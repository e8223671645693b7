"""Which measurements of an imported block are written: none that says nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray
from orip.exchange.project.block import ImportedBlock
from orip.records.control import ControlPoint
from orip.wording import counted


class KeptRays(NamedTuple):
    """Which rays are written, array (k,) of bool, and whether a photo shows one of their points twice."""

    rows: BoolArray
    has_repetitions: bool


def rays_kept(block: ImportedBlock, control: Sequence[ControlPoint], notes: list[str]) -> KeptRays:
    """Return which rays are written: those of a point that only one photo shows say nothing unless it is control.

    Rays of one photo and point all count, even where their coordinates are the same: features that differ in their
    direction alone have the same place, and the programs that find them count them all.
    """
    rays = block.project.rays
    photos = max(1, len(block.photos))
    pairs = rays.point * photos + rays.photo
    order = np.lexsort((rays.image[:, 1], rays.image[:, 0], pairs))
    is_again = np.diff(pairs[order], prepend=-1) == 0
    is_copy = is_again & (np.diff(rays.image[order], axis=0, prepend=np.nan) == 0.0).all(axis=1)
    photos_of_point = np.bincount(pairs[order[~is_again]] // photos, minlength=len(block.points))
    names = {one.name for one in control}
    is_control = np.array([name in names for name in block.points], dtype=np.bool_)
    kept: BoolArray = ((photos_of_point >= 2) | is_control)[rays.point]
    lost = int((~kept).sum())
    if lost:
        notes.append(f"{counted(lost, 'ray')} left out, as no other photo shows the point.")
    is_written = kept[order]
    again, copies = (int((is_written & those).sum()) for those in (is_again, is_copy))
    if again:
        same = f", {copies} of them with the same coordinates" if copies else ""
        notes.append(f"{counted(again, 'ray')} of a point that its photo shows already{same}: all of them count.")
    return KeptRays(kept, bool(again))
