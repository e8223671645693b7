"""Whether the observations fix a block at all: where it lies on the ground, and how its photos are turned."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import csr_array

from orip.arrays import BoolArray, FloatArray
from orip.bundle.datum.free_datum import information_on_movements
from orip.bundle.datum.movements import movements_of_block
from orip.bundle.points.on_figures import with_points_on_figures
from orip.bundle.problem import BlockProblem
from orip.bundle.results.ground import photo_cofactors, undetermined_photos
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.geometry.rotation import axes_rotation_from_angle_rates
from orip.number_text import decimals_of_two_digits
from orip.records.block import Block
from orip.records.observation_kinds import PHOTO_POINT
from orip.records.results.solution import Diagnosis
from orip.wording import agreeing, counted, counted_names, joined

# An adjustment ends with some numbers whatever the observations say. Where they leave a movement of the whole block
# free, or no better than within limits at which the linear equations mean nothing, the block is not determined, however
# regular noise makes its normal equations.

_SHIFT, _ROTATION, _SCALE = 1.0, 0.2, 0.3
"""Standard deviations of the whole block from which a movement counts as free: a shift by the extent of the block, a
rotation by 0.2 radians, 11 degrees, and a scale uncertain by 30 per cent. What a rotation by s adds to the linear
equations is s / 2 of what they have: with twice this deviation it is a fifth, and precision from them means nothing."""

_PHOTO_ROTATION = 0.5
"""Standard deviation of a photo's rotation, radians, from which nothing is known of it: with twice that it may be
anything within half a right angle and more. The limit is wider than that of the block: with a long lens it is hardly
told from a shift of the photo, which does no harm to the others."""

_PART = 0.05
"""Part of a free movement, in the units of the limits, below which it is no rotation or no change of scale; and part of
the control's length by which its points may lie off a line."""


CONTROL_LINE = "control-line"
"""Code of the diagnosis that control hardly keeps a block from turning about a line."""

_BEYOND, _BEYOND_PART = 10.0, 0.1
"""Multiple of the control's distance from its line that points are away from it, where their errors are as many times
those of the control; and the part of the points that has to be: wrong rays take single points anywhere."""


def control_on_a_line(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Say that the control points lie nearly on a line, where nothing else keeps the block from turning about it."""
    block, place = solved.block, solved.block.point_index()
    held = [point for point in block.control_points if point.kind == "control"]
    others = (
        bool(block.directions)
        or bool(block.given_directions or block.terrain_heights)
        or any(point.kind == "HEIGHT" for point in block.figure_points)
        or any(photo.constant for photo in block.photos)
        or any(station.has_position and min(station.position_error) >= 0.0 for station in block.stations)
        or any(element.group == "PHOTO" and element.error >= 0.0 for element in block.elements)
        # heights by themselves, or X and Y, may be anywhere
        or any(error is None or error < 0.0 for point in held for error in point.errors)
    )
    if solved.problem.datum is not None or others:
        return
    rows = [place[point.name] for point in held if point.name in place]
    points = solved.state.points
    control, every = points[rows], points[np.isfinite(points).all(axis=1)]
    if len(rows) < _ON_A_LINE or not np.isfinite(control).all():
        return
    centre = control.mean(axis=0)
    along = np.linalg.svd(control - centre, full_matrices=False)[2][0]
    off, away = (
        np.linalg.norm(part - centre - np.outer((part - centre) @ along, along), axis=1) for part in (control, every)
    )
    beyond = float(np.quantile(away, 1.0 - _BEYOND_PART))
    if off.max() * _BEYOND > beyond:
        return
    names = [point.name for point in held]
    text = (
        f"{counted_names('control point', names)} lie nearly on a line: many points are {_length(beyond)} "
        f"{block.ground_unit} and more away from it, the control at most {_length(off.max())}, and a turn about the "
        "line is hardly determined"
    )
    yield Diagnosis(
        CONTROL_LINE, f"bundle {block.definition.name}", text, "give another control point away from the line"
    )


def _length(value: float) -> str:
    return f"{value:.{decimals_of_two_digits(max(value, 1e-3), 0, 3)}f}"


_ON_A_LINE = 3
"""Least number of control points that could determine a block, if they were not on a line."""


def not_determined(solved: SolvedBlock) -> tuple[Diagnosis, ...]:
    """Return what the observations leave free of the block as a whole; else of its photos, which go with it."""
    return (*_ground_system(solved),) or (*_unfounded_photos(solved),)


def _ground_system(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the movements of the whole block that neither control nor stations determine."""
    if solved.problem.datum is not None:
        return
    movements = _free_movements(solved)
    free = movements.shape[1]
    if not free:
        return
    where = f"bundle {solved.block.definition.name}"
    count = control_count(solved.block)
    because = f"{count or 'no'} {agreeing(count, 'control point')}"
    if len(solved.state.shifts):
        because += ", and unknown shifts of the stations"
    turns = int(np.linalg.matrix_rank(movements[3:6], tol=_PART))
    scale = int(np.abs(movements[6]).max() > _PART)
    parts = []
    if (shifts := free - turns - scale) > 0:
        parts.append(counted(shifts, "shift"))
    if turns:
        parts.append(counted(turns, "rotation"))
        if turns == free == 1 and _turns_about_control(solved, movements[:, 0]):
            parts[-1] += " about the line of the control points"
    if scale:
        parts.append("scale")
    listed = joined(parts)
    if listed == "scale":
        yield Diagnosis("datum", where, "scale is free", "add a distance or a second control point")
    else:
        remedy = 'add control points, three at least and not on one line, or set datum = "free"'
        yield Diagnosis("datum", where, f"the ground system is not fixed ({because}); free: {listed}", remedy)


def _unfounded_photos(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the photos whose rotation nothing determines; if all are, or all have an unknown that was removed, say so.

    Where no photo has unknowns, the points are what is to be determined.
    """
    elements, removed = solved.problem.unknowns.elements, solved.normals.removed
    names = [photo.name for photo in solved.block.photos]
    unknown = (elements != CONSTANT).any(axis=1)
    left = undetermined_photos(solved).any(axis=1)
    turned = _turned_at_will(solved)
    where = f"bundle {solved.block.definition.name}"
    remedy = "measure more points, spread over the photos and at different depths, or give control near them"
    points = solved.problem.unknowns.points
    if not unknown.any() and len(points) and removed[points].any(axis=1).all():
        text = "the observations determine none of its points"
        yield Diagnosis("photo-rotations", where, text, "measure the points in photos taken from elsewhere")
    elif unknown.any() and (left | turned)[unknown].all():
        text = "the observations determine none of its photos"
        yield Diagnosis("photo-rotations", where, text, remedy)
    elif turned.any():
        found = [names[row] for row in np.flatnonzero(turned)]
        text = f"the rotation of {counted_names('photo', found)} is not determined: its standard deviation is above 29°"
        yield Diagnosis("photo-rotations", counted_names("photo", found), text, remedy)


def control_count(block: Block) -> int:
    """Return the number of control points of a block."""
    return sum(point.kind == "control" for point in block.control_points)


def _free_movements(solved: SolvedBlock) -> FloatArray:
    """Return the movements (7, d) that observations on the ground determine no better than the limits, in their units.

    Photo points do not determine any: they depend on the relative positions of photos and points only. Constants
    determine what they hold.
    """
    problem, state = solved.problem, solved.state
    rows = [kind.rows for kind in problem.observations]
    of_ground = np.concatenate([np.full(len(part.used), part.kind != PHOTO_POINT) for part in rows])
    kinds = tuple(kind for kind in problem.observations if kind.rows.kind != PHOTO_POINT)
    state = with_points_on_figures(kinds, state)
    design = csr_array((0, problem.layout.size))
    if kinds:
        design = BlockProblem(problem.block, problem.unknowns, kinds).design(state)
    design = design[solved.equations.active[of_ground]]
    weights = solved.weight_factors[of_ground & solved.equations.active]
    limits = np.repeat([_SHIFT * _extent(solved), _ROTATION, _SCALE], [3, 3, 1])
    information = information_on_movements(state, problem.unknowns, design, weights)
    known, directions = np.linalg.eigh(limits[:, None] * information * limits)
    return np.asarray(directions[:, known < 1.0])


def _extent(solved: SolvedBlock) -> float:
    """Return the largest extent of points and photos along an axis, in the units of the shifts of a block."""
    places = np.vstack([solved.state.points, solved.state.centres])
    known = places[np.isfinite(places).all(axis=1)]
    size = movements_of_block(solved.state, solved.problem.unknowns).size
    return max(float(np.ptp(known, axis=0).max(initial=0.0)) / size, 1.0) if len(known) else 1.0


def _turns_about_control(solved: SolvedBlock, movement: FloatArray) -> bool:
    """Return whether control points do not move in a movement (7,), in the units of the limits: on its axis."""
    place = solved.block.point_index()
    rows = [place[point.name] for point in solved.block.control_points if point.kind == "control"]
    if len(rows) < 2:
        return False
    limits = np.repeat([_SHIFT * _extent(solved), _ROTATION, _SCALE], [3, 3, 1])
    moves = movements_of_block(solved.state, solved.problem.unknowns).of_points(np.array(rows), movement * limits)
    length = np.ptp(solved.state.points[rows], axis=0)
    turn = float(np.linalg.norm(movement[3:6]) * _ROTATION)
    return bool(np.linalg.norm(moves, axis=1).max() < _PART * turn * float(np.linalg.norm(length)))


def _turned_at_will(solved: SolvedBlock) -> BoolArray:
    """Return the photos (n,) whose rotation about some axis has a deviation above the limit, from the a-priori errors.

    sigma0 enters only where it is below 1: residuals far above the a-priori errors are another finding.
    """
    cofactors = photo_cofactors(solved)[:, 3:, 3:].copy()
    by_angles = solved.state.turned_by_angles
    about_axes = axes_rotation_from_angle_rates(solved.state.angles()[by_angles])
    cofactors[by_angles] = about_axes @ cofactors[by_angles] @ about_axes.transpose(0, 2, 1)
    largest = np.linalg.eigvalsh(cofactors).max(axis=1, initial=0.0)
    scale = min(solved.deviation_scale, 1.0)
    return np.asarray(scale * np.sqrt(np.maximum(largest, 0.0)) > _PHOTO_ROTATION)
