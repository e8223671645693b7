"""A solution without most of what was measured is none, however well the rest fits."""

from __future__ import annotations

import numpy as np
from bundle.aerial_block import aerial_block

from orip.bundle.diagnosis import diagnose
from orip.bundle.results.reliability import lost_control, lost_photos, lost_rays
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock, solve_block
from orip.records.block import Block
from orip.structs import replace


def solved(block: Block) -> SolvedBlock:
    return solve_block(block, lambda _: None, lambda: False)


def with_points_behind(found: SolvedBlock, behind: np.ndarray) -> SolvedBlock:
    """Return the solution as if these photo points (n,) could not be computed."""
    active = found.equations.active.copy()
    active[: 2 * len(behind)] &= ~np.repeat(behind, 2)
    return replace(found, equations=replace(found.equations, active=active))


def test_a_sound_block_loses_no_rays() -> None:
    found = solved(aerial_block("lost rays").block)
    assert not lost_rays(found).any()
    assert lost_control(found) == lost_photos(found) == ()
    assert solution_of(found).status == "converged"


def test_one_ray_behind_its_camera_may_be_a_blunder() -> None:
    found = solved(aerial_block("lost rays").block)
    one = with_points_behind(found, np.arange(len(found.block.photo_points.photo)) == 3)
    assert np.flatnonzero(lost_rays(one)).tolist() == [3]
    assert solution_of(one).status == "converged"


def test_control_that_lies_behind_all_cameras_is_no_control() -> None:
    found = solved(aerial_block("lost rays").block)
    names = np.array(found.block.point_names)[found.block.photo_points.point]
    control = [point.name for point in found.block.control_points]
    without = with_points_behind(found, np.isin(names, control))
    assert lost_control(without) == tuple(control)
    assert solution_of(without).status == "not_converged"
    first = diagnose(without)[0]
    assert first.code == "another-block"
    assert f"and {len(control) - 3} more lie behind the cameras" in first.text


def test_a_photo_that_looks_the_other_way_is_named() -> None:
    found = solved(aerial_block("lost rays").block)
    without = with_points_behind(found, found.block.photo_points.photo == 4)
    assert lost_photos(without) == ("P5",)
    assert solution_of(without).status == "not_converged"


def test_a_point_without_coordinates_has_no_part_in_the_movements_of_the_block() -> None:
    block = aerial_block("lost rays").block
    rays = block.photo_points
    control = {point.name for point in block.control_points}
    tie = next(row for row, name in enumerate(block.point_names) if name not in control)
    start, used = block.point_start.copy(), rays.used.copy()
    start[tie] = np.nan
    used[np.flatnonzero(rays.point == tie)[1:]] = False
    found = solved(replace(block, point_start=start, photo_points=replace(rays, used=used)))
    # the point is undetermined, and the ground system is not
    assert "datum" not in {finding.code for finding in diagnose(found)}
