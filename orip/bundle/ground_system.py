"""The local frame in which a block is adjusted, and whether the observations fix it on the ground at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.sparse import csr_array

from orip.arrays import BoolArray, FloatArray
from orip.bundle.datum import information_on_movements, movements_of_block
from orip.bundle.points.starting import given_coordinates
from orip.bundle.problem import BlockProblem
from orip.bundle.results.ground import reduced_cofactors
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.errors import Complaint, InputError
from orip.geometry.ground_frame import ground_frame
from orip.geometry.rotation import angles_from_rotation, axes_rotation_from_angle_rates, rotation_from_angles
from orip.records.block import Block
from orip.records.ground import PLAIN, GroundSystem
from orip.records.observations.control import ControlElement, ControlPoint
from orip.records.observations.observation_kinds import PHOTO_POINT
from orip.records.project.photo import PHOTO_PARAMETERS, Photo
from orip.records.results.solution import Diagnosis
from orip.structs import replace
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
    photos, removed = solved.problem.unknowns.photos, solved.normals.removed
    names = [photo.name for photo in solved.block.photos]
    unknown = (photos != CONSTANT).any(axis=1)
    left = ((photos != CONSTANT) & removed[photos]).any(axis=1)
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
    columns = solved.problem.unknowns.photos[:, 3:]
    cofactors = reduced_cofactors(solved, columns)
    by_angles = solved.state.turned_by_angles
    about_axes = axes_rotation_from_angle_rates(solved.state.angles()[by_angles])
    cofactors[by_angles] = about_axes @ cofactors[by_angles] @ about_axes.transpose(0, 2, 1)
    largest = np.linalg.eigvalsh(cofactors).max(axis=1, initial=0.0)
    scale = min(solved.deviation_scale, 1.0)
    return np.asarray(scale * np.sqrt(np.maximum(largest, 0.0)) > _PHOTO_ROTATION)


# With a coordinate reference system photos and points have local coordinates while they are adjusted. A constant of the
# project is a constant of the frame only together with others: the three coordinates of a point or projection centre,
# and a photo's angles with its centre. Constants without those others become exact constraints.

_POSITION = frozenset(PHOTO_PARAMETERS[:3])

_ROUNDED_TO = -2
"""Decimals to which the origin is rounded, so that a small change of the block does not move it."""


def ground_system(
    crs: str | None, ground_unit: str, points: Sequence[ControlPoint], centres: FloatArray
) -> GroundSystem:
    """Return the system that a block is adjusted in, with its origin in the middle of control, else of the photos.

    Parameters
    ----------
    crs : str or None
        None: the project's coordinates are plain.
    ground_unit : str
    points : sequence of ControlPoint
    centres : array (n, 3)
        Projection centres, in the project.

    Raises
    ------
    InputError
        If the system does not fit the project, or a grid for its heights is missing.
    """
    if crs is None:
        return PLAIN
    known = [point.coordinates for point in points if not point.rejected and None not in point.coordinates]
    places = np.array(known, dtype=np.float64) if known else centres[np.isfinite(centres).all(axis=1)]
    if not len(places):
        message = "with a crs the block needs a location: give a control point with X, Y and Z, or projection centres"
        raise InputError.single(message)
    # the median, so that one mistyped point does not move the frame of all others
    return ground_frame(crs, ground_unit, np.round(np.median(places, axis=0), _ROUNDED_TO))


def frame_complaints(block: Block) -> list[Complaint]:
    """Return complaints about what the frame does not allow; the photos still have the project's coordinates."""
    if block.ground is PLAIN:
        return []
    names = [f"photo {photo.name}" for photo in block.photos]
    names += [f"control point {point.name}" for point in block.control_points]
    names += [f"preliminary point {point.name}" for point in block.preliminary]
    names += [f"exposure station {station.photo}" for station in block.stations]
    given = [tuple(centre) for centre in block.photo_orientation[:, :3].tolist()]
    given += [point.coordinates for point in block.control_points]
    given += [point.coordinates for point in block.preliminary]
    given += [station.position for station in block.stations]
    xyz = np.array(given, dtype=np.float64)
    outside = np.isfinite(xyz).all(axis=1) & np.isnan(block.ground.to_local(xyz)).any(axis=1)
    complaints = [
        Complaint(
            f"{names[row]} has the coordinates {', '.join(f'{value:.3f}' for value in xyz[row])}, which are "
            "outside the area of the crs; check the coordinates, and that X is the easting and Y the northing"
        )
        for row in np.flatnonzero(outside)
    ]
    return [*complaints, *_free_network_complaints(block)]


def _free_network_complaints(block: Block) -> Iterator[Complaint]:
    """Yield complaints of observations that would tie a free network to its location on the earth."""
    if not block.is_free_network:
        return
    name = block.definition.name
    if block.directions:
        yield Complaint(
            f"bundle {name} is a free network with theodolite directions, whose verticals differ from place to place "
            "with a crs; leave crs out, or take the directions out of the .DIR file"
        )
    on_grid = [distance.name for distance in block.distances if distance.code != "XYZ" and distance.error >= 0.0]
    if on_grid:
        yield Complaint(
            f"distance {', '.join(on_grid)} of the free network {name} is taken on the map grid with a crs, which "
            "differs from place to place; give a spatial distance (XYZ), or leave crs out"
        )


def photos_in_frame(block: Block) -> Block:
    """Return the block with its photos' orientations taken from the project to the frame.

    A photo with an unknown coordinate has NaN for all elements, one with an unknown angle for all three angles.
    """
    if block.ground is PLAIN:
        return block
    orientation = np.full_like(block.photo_orientation, np.nan)
    placed = np.isfinite(block.photo_orientation[:, :3]).all(axis=1)
    orientation[placed, :3] = block.ground.to_local(block.photo_orientation[placed, :3])
    known = np.isfinite(block.photo_orientation).all(axis=1)
    centres, angles = block.photo_orientation[known, :3], block.photo_orientation[known, 3:]
    rotation = np.swapaxes(block.ground.axes_at(centres), 1, 2) @ rotation_from_angles(angles)
    orientation[known] = np.hstack([block.ground.to_local(centres), angles_from_rotation(rotation)])
    return replace(block, photo_orientation=orientation)


def constants_in_frame(block: Block) -> Block:
    """Return the block with what is constant in the project either constant in the frame, or an exact constraint."""
    if block.ground is PLAIN:
        return block
    whole = block.constant_points & block.constant_points.all(axis=1, keepdims=True)
    given = given_coordinates(block)
    single = [
        ControlElement(block.point_names[point], "POINT", "XYZ"[axis], float(given[point, axis]), 0.0)
        for point, axis in np.argwhere(block.constant_points & ~whole)
    ]
    photos = [_constants_of_photo(photo) for photo in block.photos]
    return replace(
        block,
        constant_points=whole,
        photos=tuple(photo for photo, _ in photos),
        constant_elements=(*single, *(element for _, elements in photos for element in elements)),
    )


def _constants_of_photo(photo: Photo) -> tuple[Photo, list[ControlElement]]:
    """Return a photo with the elements that are constant in the frame, and those that are exact constraints."""
    constant = frozenset[str]()
    if set(photo.constant) >= _POSITION:
        constant = frozenset(PHOTO_PARAMETERS) if set(photo.constant) == set(PHOTO_PARAMETERS) else _POSITION
    values = dict(zip(PHOTO_PARAMETERS, photo.orientation, strict=True))
    single = [
        ControlElement(photo.name, "PHOTO", kind, value, 0.0)
        for kind in photo.constant
        if kind not in constant and (value := values[kind]) is not None
    ]
    return replace(photo, constant=tuple(kind for kind in photo.constant if kind in constant)), single
