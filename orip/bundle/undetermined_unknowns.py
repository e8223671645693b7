"""Unknowns that nothing determines keep their values: the block is adjusted again with them held.

Which unknowns are removed is decided in each iteration, so that one that is not removed in all of them moves. The
rotation unknowns of photos turn about the ground axes: holding one of them keeps none of the angles. Therefore it is
decided once more at the solution, with omega, phi and kappa themselves as unknowns, and what is removed then is held
where it started.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.sparse import csr_array

from orip.adjustment.convergence import TerminationReason
from orip.adjustment.equations import Equations
from orip.adjustment.iteration import Adjustment, adjust
from orip.adjustment.iteration_state import IterationRecord, IterationSettings
from orip.adjustment.normals import SolvedNormals, solve_normals
from orip.adjustment.precision import Cofactors
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.problem import BlockProblem
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.ground import PlainGround
from orip.structs import replace

_LEAST_COSINE_OF_PHI = 0.02
"""Nearer than this to phi = ±90 degrees omega and kappa turn about one axis; such photos keep rotations about axes."""

_SAME = 1e-9
"""Values that differ by less, relative to 1 or their own size, have not been moved; angles are in radians."""


_LENGTHS = (CAMERA_PARAMETERS.index("C"), CAMERA_PARAMETERS.index("DX"), CAMERA_PARAMETERS.index("DY"))

LOOSE = 0.1
"""Standard deviation of C, DX or DY as a part of C from which the photos do not determine it. The photos turn or
move by as much with it, and twice that is beyond what linear equations can tell."""

_MUCH_WORSE = 2.0
"""Multiple of the robust cost from which the observations contradict the values held. An absurd lens explains noise,
so that the cost is never quite the same."""

_CONTRADICTING = 7.0
"""Increase of half the square sum, with the values held, from which observations contradict them: that of a single
unknown is so large with a probability of 0.0002."""


def with_undetermined_held(
    problem: BlockProblem,
    start: BlockState,
    found: Adjustment[BlockState],
    settings: IterationSettings,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
) -> Adjustment[BlockState]:
    """Return an adjustment in which unknowns that nothing determines have the values that they started with.

    Parameters
    ----------
    found : Adjustment
        Of the problem from that start.
    on_iteration, stop_asked : callable
        See `orip.adjustment.iteration.adjust`.

    Returns
    -------
    Adjustment
        `found` itself where everything is determined, in free networks (all of whose unknowns are placed by their
        datum), and where the adjustment did not converge, before or with these unknowns held, or ended at another
        minimum with them: far points held where they started may lead it astray. `max_iterations` is the number of
        all iterations.
    """
    removed = found.normals.removed
    if problem.datum is not None or not removed.any() or found.reason is not TerminationReason.CONVERGED:
        return found
    of_angles = _by_angles(problem, found, settings)
    removed = of_angles.normals.removed
    if not (_moved(start, of_angles.state, problem.unknowns) & removed).any():
        return of_angles
    before, count = len(found.iterations), int(np.count_nonzero(removed))
    if before >= settings.max_iterations:
        return replace(found, reason=TerminationReason.MAX_ITERATIONS)
    held = _holding(problem, removed)
    again = adjust(
        held,
        _reset(of_angles.state, start, removed, problem.unknowns),
        replace(settings, max_iterations=settings.max_iterations - before),
        lambda record: on_iteration(_continued(record, before, count)),
        stop_asked,
    )
    iterations = (*found.iterations, *(_continued(record, before, count) for record in again.iterations))
    if again.reason is not TerminationReason.CONVERGED or again.robust_cost > found.robust_cost + _CONTRADICTING:
        return replace(found, iterations=iterations)
    return replace(again, normals=_with_removed_unknowns(again.normals, of_angles.normals), iterations=iterations)


_PLACED = {"PHOTO", "POINT", "EXPOSURE"}
"""Groups whose unknowns, where they are removed, have values that say nothing; a given parameter is one to be held."""

_AT_ONCE = 16
"""Removed unknowns of which the movements of all others are in memory."""


def undetermined_with_removed(
    problem: BlockProblem,
    equations: Equations,
    weight_factors: FloatArray,
    normals: SolvedNormals,
    precision: Cofactors,
) -> BoolArray:
    """Return which unknowns (m + 3 b,) are removed, or belong to a part that moves with a removed place or rotation.

    What is removed has, at best, a standard deviation of 10^(max_lost_digits / 2) along its movement, in the unit in
    which the diagonal of N is 1. An unknown moves with it if its part of that is above its own standard deviation.
    Where all photos move, it is the system of the block that is free: what is held in it defines it.
    """
    removed, size, unknowns = normals.removed, len(normals.scale), problem.unknowns
    columns = [
        column
        for column in np.flatnonzero(removed[:size]).tolist()
        if (name := unknowns.names[column]) is not None and name.group in _PLACED
    ]
    if not columns or problem.datum is not None:
        return removed
    variances = np.concatenate([precision.reduced.diagonal(), np.einsum("nii->ni", precision.blocks).ravel()])
    least = 10.0**-problem.block.definition.max_lost_digits * variances[:, None]
    of_photos = unknowns.photos[(unknowns.photos != CONSTANT).any(axis=1)]
    design, found = equations.design, removed.copy()
    weighted = csr_array(design.multiply(weight_factors[:, None]))
    for first in range(0, len(columns), _AT_ONCE):
        chosen = columns[first : first + _AT_ONCE]
        moved = normals.solve((design.T @ weighted[:, chosen]).toarray())
        length = normals.scale[chosen] ** 2 + ((moved[:size] * normals.scale[:, None]) ** 2).sum(axis=0)
        moves = moved**2 > least * length
        moves[columns] = True
        of_block = (moves[of_photos] & (of_photos != CONSTANT)[:, :, None]).any(axis=1).all(axis=0)
        found |= moves[:, ~of_block].any(axis=1)
    return found


def loose_calibration(
    problem: BlockProblem, found: Adjustment[BlockState], variances: FloatArray, held: IntArray
) -> IntArray:
    """Return which of C, DX and DY of each camera is known least, if it is hardly known at all.

    Parameters
    ----------
    variances : array (m,)
        Of the reduced unknowns.
    held : array of int
        Unknowns that are held already.
    """
    columns = problem.unknowns.cameras[:, _LENGTHS]
    free = (columns != CONSTANT) & ~np.isin(columns, held)
    after = found.state.cameras[:, _LENGTHS]
    if not free.any():
        return held[:0]
    parts = np.sqrt(np.maximum(variances[np.where(free, columns, 0)], 0.0)) / np.maximum(np.abs(after[:, :1]), _SAME)
    parts[found.normals.removed[columns]] = 0.0
    parts = np.where(free, parts, 0.0)
    least_known = parts.argmax(axis=1)[:, None]
    loose = np.take_along_axis(parts, least_known, axis=1) > LOOSE
    return np.unique(np.take_along_axis(columns, least_known, axis=1)[loose])


def with_calibration_held(
    problem: BlockProblem,
    start: BlockState,
    found: Adjustment[BlockState],
    columns: IntArray,
    settings: IterationSettings,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
) -> Adjustment[BlockState]:
    """Return the adjustment from the start with some unknowns (k,) of cameras held there, which count as removed."""
    held = np.zeros(problem.layout.size, dtype=bool)
    held[columns] = True
    before, count = len(found.iterations), int(np.count_nonzero(held | found.normals.removed & problem.layout.fixed))
    told = _told_after(on_iteration, before, count)
    fewer = _holding(problem, held)
    again = with_undetermined_held(
        fewer, start, adjust(fewer, start, settings, told, stop_asked), settings, told, stop_asked
    )
    lost = np.full(problem.layout.size, np.nan) if again.normals.lost_before is None else again.normals.lost_before
    # what iterations that did not converge have lost says nothing
    own = np.where(found.normals.removed, 0.0, found.normals.lost_digits)
    lost = np.where(held & np.isnan(lost), own, lost)
    iterations = (*found.iterations, *(_continued(record, before, count) for record in again.iterations))
    return replace(
        again,
        normals=replace(again.normals, removed=again.normals.removed | held, lost_before=lost),
        iterations=iterations,
    )


def agrees_with_held(again: Adjustment[BlockState], found: Adjustment[BlockState]) -> bool:
    """Return whether observations agree with values that were held: if not, they do know the unknowns."""
    allowed = _MUCH_WORSE * found.robust_cost + _CONTRADICTING
    return again.reason is TerminationReason.CONVERGED and again.robust_cost <= allowed


def _told_after(
    on_iteration: Callable[[IterationRecord], None], before: int, held: int
) -> Callable[[IterationRecord], None]:
    return lambda record: on_iteration(_continued(record, before, held))


def _by_angles(
    problem: BlockProblem, found: Adjustment[BlockState], settings: IterationSettings
) -> Adjustment[BlockState]:
    """Return the adjustment with omega, phi and kappa as unknowns of the photos, where these are the project's."""
    turned = np.abs(np.cos(found.state.angles()[:, 1])) > _LEAST_COSINE_OF_PHI
    plain = isinstance(problem.block.ground, PlainGround)
    if not plain or not found.normals.removed[: problem.layout.reduced].any():
        turned = found.state.turned_by_angles
    if np.array_equal(turned, found.state.turned_by_angles):
        return found
    state = replace(found.state, turned_by_angles=turned)
    equations = problem.linearise(state)
    normals = solve_normals(equations, found.weight_factors, problem.layout, settings.max_lost_digits)
    return replace(found, state=state, equations=equations, normals=normals)


def _holding(problem: BlockProblem, removed: BoolArray) -> BlockProblem:
    layout = replace(problem.layout, fixed=problem.layout.fixed | removed)
    return replace(problem, unknowns=replace(problem.unknowns, layout=layout))


def _continued(record: IterationRecord, before: int, held: int) -> IterationRecord:
    """Return a record with the number of its iteration among all, and the unknowns that are held in it."""
    return replace(record, iteration=before + record.iteration, singular=record.singular + held)


def _with_removed_unknowns(normals: SolvedNormals, before: SolvedNormals) -> SolvedNormals:
    return replace(
        normals,
        removed=normals.removed | before.removed,
        lost_before=np.where(before.removed, before.lost_digits, np.nan),
    )


def _moved(start: BlockState, end: BlockState, unknowns: Unknowns) -> BoolArray:
    """Return which unknowns (m + 3 b,) have other values at the end."""
    before, after = _values(start, unknowns), _values(end, unknowns)
    return np.asarray(np.abs(after - before) > _SAME * np.maximum(np.abs(before), 1.0))


def _values(state: BlockState, unknowns: Unknowns) -> FloatArray:
    values = np.zeros(unknowns.layout.size)
    for columns, table in _tables(state, unknowns):
        values[columns[columns != CONSTANT]] = table[columns != CONSTANT]
    return values


def _tables(state: BlockState, unknowns: Unknowns) -> list[tuple[IntArray, FloatArray]]:
    return [
        (unknowns.cameras, state.cameras),
        (unknowns.additional, state.additional),
        (unknowns.antennas, state.antennas),
        (unknowns.shifts, state.shifts),
        (unknowns.drifts, state.drifts),
        (unknowns.theodolites, state.theodolites),
        (unknowns.figures, state.figures.values()),
        (unknowns.photos[:, :3], state.centres),
        (unknowns.photos[:, 3:], state.angles()),
        (unknowns.motions, state.motion_corrections),
        (unknowns.points, state.points),
        *_tables_of_rigs(state, unknowns),
    ]


def _tables_of_rigs(state: BlockState, unknowns: Unknowns) -> Iterator[tuple[IntArray, FloatArray]]:
    rigs, columns = state.rigs, unknowns.rigs
    if rigs is not None and columns is not None:
        yield columns.exposures[:, :3], rigs.centres
        yield columns.exposures[:, 3:], angles_from_rotation(rigs.rotations)
        yield columns.mountings[:, :3], rigs.offsets
        yield columns.mountings[:, 3:], angles_from_rotation(rigs.mountings)


def _reset(state: BlockState, start: BlockState, removed: BoolArray, unknowns: Unknowns) -> BlockState:
    """Return the state with the removed unknowns as they started."""
    padded = np.append(removed, False)  # CONSTANT is the last place

    def table(columns: IntArray, values: FloatArray, started: FloatArray) -> FloatArray:
        return np.where(padded[columns], started, values)

    cameras, additional, antennas, shifts, drifts, theodolites, _, centres, angles, corrections, points, *of_rigs = (
        table(columns, values, started)
        for (columns, values), (_, started) in zip(_tables(state, unknowns), _tables(start, unknowns), strict=True)
    )
    rotations = state.rotations.copy()
    turned = padded[unknowns.photos[:, 3:]].any(axis=1)
    rotations[turned] = rotation_from_angles(angles[turned])
    found = replace(
        state, cameras=cameras, additional=additional, antennas=antennas, shifts=shifts, drifts=drifts,
        theodolites=theodolites, centres=centres, rotations=rotations, motion_corrections=corrections, points=points,
        figures=state.figures.where(np.logical_not(padded[unknowns.figures].any(axis=1)), start.figures), memory={},
    )  # fmt: skip
    rigs, columns = state.rigs, unknowns.rigs
    if rigs is None or columns is None:
        return found
    turned_exposures, turned_mountings = (
        np.asarray(padded[table[:, 3:]].any(axis=1))[:, None, None] for table in (columns.exposures, columns.mountings)
    )
    return found.with_rigs(
        replace(
            rigs,
            centres=of_rigs[0],
            rotations=np.where(turned_exposures, rotation_from_angles(of_rigs[1]), rigs.rotations),
            offsets=of_rigs[2],
            mountings=np.where(turned_mountings, rotation_from_angles(of_rigs[3]), rigs.mountings),
        )
    )
