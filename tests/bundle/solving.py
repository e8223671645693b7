"""Solving synthetic blocks, and changing them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from support.synthetic_block import SyntheticBlock

from orip.bundle.diagnosis import diagnose
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock, solve_block
from orip.records.block import Block, IndexedPhotoPoints, TheodoliteSet
from orip.records.control import ControlDirection, ControlPoint
from orip.records.results.solution import Solution
from orip.structs import replace

OFF = {"max_iterations": 30, "start_down_weight": 30}
"""Settings without down-weighting."""


def solved(block: Block) -> SolvedBlock:
    return solve_block(block, lambda _: None, lambda: False)


def solution(block: Block) -> Solution:
    found = solved(block)
    return replace(solution_of(found), diagnosis=diagnose(found))


def redefined(block: Block, **settings: object) -> Block:
    return replace(block, definition=replace(block.definition, **settings))


def singular(found: Solution) -> list[tuple[str, str]]:
    return [(unknown.name, unknown.kind) for unknown in found.singular]


def rows(found: Solution, kind: str) -> np.ndarray:
    return np.flatnonzero(np.array(found.residuals.kind) == kind)


def with_photo_points(block: Block, keep: np.ndarray) -> Block:
    points = block.photo_points
    return replace(
        block,
        photo_points=IndexedPhotoPoints(
            points.photo[keep], points.point[keep], points.xy[keep], points.error[keep], points.used[keep]
        ),
    )


def with_error(block: Block, photo_point: int, component: int, size: float) -> Block:
    """Return the block with an error in one photo coordinate, `size` times its a-priori error."""
    points = block.photo_points
    xy = points.xy.copy()
    xy[photo_point, component] += size * points.error[photo_point, component]
    return replace(block, photo_points=replace(points, xy=xy))


def with_rays(made: SyntheticBlock, least: int) -> SyntheticBlock:
    """Return the block without the points that have fewer rays."""
    block = made.block
    rays = np.bincount(block.photo_points.point, minlength=len(block.point_names))
    stays = rays >= least
    place = np.cumsum(stays) - 1
    kept = with_photo_points(block, stays[block.photo_points.point])
    names = tuple(np.array(block.point_names)[stays].tolist())
    kept = replace(
        kept,
        photo_points=replace(kept.photo_points, point=place[kept.photo_points.point]),
        point_names=names,
        point_start=block.point_start[stays],
        constant_points=block.constant_points[stays],
        control_points=tuple(point for point in block.control_points if point.name in names),
    )
    return replace(made, block=kept, points=made.points[stays])


def with_photos(made: SyntheticBlock, count: int) -> SyntheticBlock:
    """Return the block of the first photos alone and of the points that have two rays in them."""
    block = made.block
    kept = with_photo_points(block, block.photo_points.photo < count)
    kept = replace(
        kept,
        photos=block.photos[:count],
        photo_camera=block.photo_camera[:count],
        photo_orientation=block.photo_orientation[:count],
    )
    return with_rays(replace(made, block=kept, orientations=made.orientations[:count]), 2)


def started_off(made: SyntheticBlock, block: Block, seed: int, relative: float = 0.002) -> Block:
    """Return the block started off the truth by a part of the distance to the object, and as many radians."""
    random = np.random.default_rng(seed)
    offset = made.points.mean(axis=0) - made.orientations[:, :3]
    distance = float(np.mean(np.linalg.norm(offset, axis=1)))
    orientation = made.orientations + relative * np.repeat([distance, 1.0], 3) * random.normal(
        size=made.orientations.shape
    )
    points = made.points + relative * distance * random.normal(size=made.points.shape)
    return replace(
        block, photo_orientation=orientation, point_start=np.where(block.constant_points, made.points, points)
    )


def noisy(made: SyntheticBlock, seed: int) -> Block:
    """Return the block with normal errors of the a-priori size on photo points and weighted control."""
    random = np.random.default_rng(seed)
    points = made.block.photo_points
    control = tuple(
        replace(point, coordinates=tuple((np.array(point.coordinates) + point.errors * random.normal(size=3)).tolist()))
        for point in made.block.control_points
    )
    xy = points.xy + points.error * random.normal(size=points.xy.shape)
    return replace(made.block, photo_points=replace(points, xy=xy), control_points=control)


def controlled(made: SyntheticBlock, block: Block, names: Sequence[str], error: float = 0.0) -> Block:
    """Return the block with full control points by their true coordinates; error 0: constant."""
    place = block.point_index()
    control, constant, start = [], np.zeros_like(block.constant_points), block.point_start.copy()
    for name in names:
        xyz = made.points[place[name]]
        control.append(ControlPoint(name, tuple(xyz.tolist()), (error,) * 3))
        if error == 0.0:
            constant[place[name]] = True
            start[place[name]] = xyz
    return replace(block, control_points=tuple(control), constant_points=constant, point_start=start)


def directions_from(
    made: SyntheticBlock,
    block: Block,
    station: str,
    targets: Sequence[str],
    *,
    zero: float = 40.0,
    error: float = 0.001,
    zenith_error: float | None = 0.001,
    constant_zero: bool = False,
) -> Block:
    """Return the block with directions (and zenith angles) of a theodolite set S at a point, without errors."""
    place = block.point_index()
    found = []
    for target in targets:
        dx, dy, dz = made.points[place[target]] - made.points[place[station]]
        azimuth = np.degrees(np.arctan2(dx, dy))
        zenith = np.degrees(np.arctan2(np.hypot(dx, dy), dz))
        found.append(
            ControlDirection(
                "S", station, target, float((azimuth - zero) % 360.0), error,
                None if zenith_error is None else float(zenith), zenith_error,
            )
        )  # fmt: skip
    theodolites = (TheodoliteSet("S", np.radians(zero + (0.0 if constant_zero else 0.5)), constant_zero),)
    return replace(block, directions=tuple(found), theodolites=theodolites)
