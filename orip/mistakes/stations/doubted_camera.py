"""Cameras that are wrong and held, where the tests of groups accuse the positions of photos or the control.

Another principal distance lifts the photos of a flat block, and another principal point shifts them along their axes,
as a wrong height or a lever arm would. A camera is the cause where the positions fit as they are with it, and control
and photos alone show the same principal distance, or nothing but a sign is to be changed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from orip.bundle.solve import SolvedBlock
from orip.bundle.verdict import group_findings
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_from_rotation
from orip.mistakes.camera_values import (
    distortion_of_lens,
    distortion_sign,
    other_principal_distance,
    other_principal_point,
    principal_point_sign,
    with_unknown,
)
from orip.mistakes.control.contradicting_control import without_control
from orip.mistakes.exchanged_photos import other_cameras
from orip.mistakes.hypothesis import DECIDED, Hypothesis, Misfit, Readjuster, fit_of_adjustment, is_good
from orip.records.block import Block
from orip.records.control import NOT_GIVEN
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Solution
from orip.structs import replace

_POSITIONS, _PLACES = ("station", "element"), PHOTO_PARAMETERS[:3]

_DOUBTED, _MOST = 0.5, 0.5
"""Weight factor of a position that hardly influenced the result, and part of them from which all are doubted."""

_OF_CHANCE = 4.0
"""Standard deviations by which the square sum of the positions is larger than chance gives, at most."""

_OTHER_LENS, _MOVED = 0.05, 120.0
"""Difference of principal distances, as a part of these, that is another lens and not another calibration, and ground
units that photos rise or sink by then: heights in another system bend a flat block like another lens."""

_OTHER_STATE = 0.02
"""The same where control alone tells: no calibration differs by as much, but a lens that was focused elsewhere."""

_SIGNIFICANT, OF_LENSES = 5.0, 0.001
"""The same that control shows by itself: in its standard deviations, and as a part; calibrations differ by less."""


def camera_instead_of_stations(misfit: Misfit) -> list[ProjectWarning]:
    """Return what is wrong with a held camera, if positions of photos are doubted and fit with it as they are."""
    block = misfit.readjuster.block
    if not (misfit.readjuster.is_worthwhile and has_positions(block) and are_doubted(misfit.solution)):
        return []
    without = misfit.readjuster.adjust(without_positions(block))
    for row in range(len(block.cameras)):
        started = _from_solved(block, misfit.solved)
        if found := _best(_signs(started, row), misfit.solved, without, misfit.readjuster):
            return found
        of_lenses = np.inf
        for hypothesis in _lenses(block, row):
            tried = misfit.readjuster.adjust(hypothesis.block)
            if tried is None or not is_better(tried, misfit.solved):
                continue
            if _is_other_lens(tried, misfit.solved, row) or _is_seen_without(hypothesis, row, block, misfit.readjuster):
                return hypothesis.findings(tried)
            of_lenses = min(of_lenses, tried.weighing.cost(tried.equations))
        # a distortion takes up what another principal distance does
        if found := _best(
            distortion_of_lens(started, row), misfit.solved, without, misfit.readjuster, of_lenses - DECIDED
        ):
            return found
    return []


def has_positions(block: Block) -> bool:
    """Tell whether positions of photos are observed."""
    of_elements = any(element.group == "PHOTO" and element.kind in _PLACES for element in block.elements)
    return of_elements or any(station.has_position for station in block.stations)


def lens_of_doubted_camera(misfit: Misfit) -> list[ProjectWarning]:
    """Return that the photos have another lens than their camera, if no positions are observed and groups accuse it.

    They may accuse control points, which such a lens pushes out: it costs less then than leaving these out.
    """
    block, readjuster = misfit.readjuster.block, misfit.readjuster
    if not readjuster.is_worthwhile or has_positions(block):
        return []
    accused = [found.where for found in group_findings(misfit.solution)]
    control = [point.name for point in block.control_points if f"control point {point.name}" in accused]
    without = readjuster.adjust(without_control(block, control)) if control else None
    for row, camera in enumerate(block.cameras):
        is_accused = f"camera {camera.name}" in " ".join(accused)
        for hypothesis in _lenses(block, row) if is_accused or without is not None else ():
            tried = readjuster.adjust(hypothesis.block)
            if tried is None or not (
                is_better(tried, misfit.solved) and _is_other_lens(tried, misfit.solved, row, _OTHER_STATE, 0.0)
            ):
                continue
            if is_better(tried, without, 0.0) if without is not None else is_accused:
                return hypothesis.findings(tried)
        for hypothesis in other_principal_point(block, row) if is_accused else ():
            tried = readjuster.adjust(hypothesis.block)
            if tried is None or not (is_better(tried, misfit.solved) and is_good(fit_of_adjustment(tried))):
                continue
            if (without is None or is_better(tried, without, 0.0)) and (found := hypothesis.findings(tried)):
                return found
    return []


def camera_explains_more(solution: Solution, without: SolvedBlock, readjuster: Readjuster) -> bool:
    """Tell whether a camera that groups accuse costs less, with C, DX, DY free, than all does `without` something."""
    block, accused = readjuster.block, {found.where for found in group_findings(solution)}
    for row, camera in enumerate(block.cameras):
        if f"camera {camera.name}" in accused and "C" not in camera.unknown:
            free = readjuster.adjust_roughly(with_unknown(block, row, "C", "DX", "DY"))
            if free is not None and is_better(free, without, 0.0):
                return True
    return False


def _best(
    hypotheses: Iterable[Hypothesis], solved: SolvedBlock, without: SolvedBlock | None, readjuster: Readjuster,
    best: float = np.inf,
) -> list[ProjectWarning]:  # fmt: skip
    """Return the hypothesis on a camera with which all fits best, if the positions then fit as they are.

    Its cost is below `best`.
    """
    found: list[ProjectWarning] = []
    for hypothesis in hypotheses:
        tried = readjuster.adjust(hypothesis.block)
        if tried is None or not (is_better(tried, solved) and fits_positions(tried, without)):
            continue
        cost = tried.weighing.cost(tried.equations)
        if cost < best:
            best, found = cost, hypothesis.findings(tried)
    return found


def are_doubted(solution: Solution) -> bool:
    """Tell whether groups of positions are doubted, a held camera, or most positions one by one."""
    if any(name in found.where for found in group_findings(solution) for name in ("exposure station", "camera")):
        return True
    rows = solution.residuals
    weights = [
        weight
        for kind, component, weight in zip(rows.kind, rows.component, rows.weight_factor.tolist(), strict=True)
        if kind in _POSITIONS and component in {*"XYZ", *_PLACES} and np.isfinite(weight)
    ]
    return bool(np.count_nonzero(np.array(weights) < _DOUBTED) > _MOST * len(weights))


def _signs(block: Block, row: int) -> Iterator[Hypothesis]:
    yield from distortion_sign(block, row)
    yield from principal_point_sign(block, row)


def _lenses(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield a camera with another principal distance, and with other distortion as a frame of another size has it."""
    photos = [photo.name for photo, of in zip(block.photos, block.photo_camera, strict=True) if of == row]
    if "C" not in block.cameras[row].unknown:
        yield from other_cameras(block, photos if len(photos) == 1 else ())
        yield from other_principal_distance(block, row)
        yield from other_principal_distance(with_unknown(block, row, "DX", "DY", "A3", "A5"), row)


def _from_solved(block: Block, solved: SolvedBlock) -> Block:
    """Return a block whose photos start where an adjustment of it ended."""
    if solved.block.photos != block.photos:
        return block
    orientation = np.hstack([solved.state.centres, angles_from_rotation(solved.state.rotations)])
    return replace(block, photo_orientation=orientation)


def without_positions(block: Block, photos: Iterable[str] | None = None) -> Block:
    """Return a block without the observed positions of some photos, or of all."""
    keys = {record_key(name) for name in ([photo.name for photo in block.photos] if photos is None else photos)}
    stations = tuple(
        replace(station, position=NOT_GIVEN, position_error=NOT_GIVEN) if record_key(station.photo) in keys else station
        for station in block.stations
    )
    elements = tuple(
        element
        for element in block.elements
        if not (element.group == "PHOTO" and element.kind in _PLACES and record_key(element.name) in keys)
    )
    return replace(block, stations=stations, elements=elements)


def is_better(tried: SolvedBlock, solved: SolvedBlock, least: float = DECIDED) -> bool:
    """Tell whether another adjustment of the same observations costs less by more than `least`: certainly less."""
    weighing = solved.weighing
    return tried.converged and bool(weighing.cost(solved.equations) - weighing.cost(tried.equations) > least)


def fits_positions(tried: SolvedBlock, without: SolvedBlock | None) -> bool:
    """Tell whether the positions add no more to the sum of squares than chance does."""
    if without is None or not is_good(fit_of_adjustment(tried)):
        return False
    number = sum(
        int(np.count_nonzero(observations.rows.used))
        for observations in tried.problem.observations
        if observations.rows.kind.name in _POSITIONS
    )
    half_sum = 0.5 * number + _OF_CHANCE * np.sqrt(0.5 * number)
    weighing = tried.weighing
    added = weighing.cost(tried.equations) - weighing.cost(without.equations)
    return bool(added < max(1.0, without.variance.sigma0) ** 2 * half_sum)


def _is_other_lens(
    tried: SolvedBlock, solved: SolvedBlock, row: int, least: float = _OTHER_LENS, least_moved: float = _MOVED
) -> bool:
    """Tell whether the principal distance is far another one, and the photos rise or sink far with it."""
    name = solved.block.photos[int(np.flatnonzero(solved.block.photo_camera == row)[0])].name
    own, place = ([photo.name for photo in of.block.photos].index(name) for of in (solved, tried))
    given = solved.state.cameras[row, 0]
    other = tried.state.cameras[tried.block.photo_camera[place], 0]
    moved = np.linalg.norm(tried.state.centres[place] - solved.state.centres[own])
    return bool(abs(other - given) > least * given and moved >= least_moved and is_good(fit_of_adjustment(tried)))


def _is_seen_without(hypothesis: Hypothesis, row: int, block: Block, readjuster: Readjuster) -> bool:
    """Tell whether photos and control alone show that the principal distance is another one."""
    free = readjuster.adjust(without_positions(hypothesis.block))
    # a photo with another camera of the project leaves its own one out
    if free is None or not free.converged or len(free.block.cameras) != len(block.cameras):
        return False
    column = int(free.problem.unknowns.cameras[row, 0])
    if column < 0 or free.normals.removed[column]:
        return False
    given = block.cameras[row].parameters[0]
    sd = free.deviation_scale * float(np.sqrt(free.cofactors_of(np.array([column]))[0, 0]))
    return abs(float(free.state.cameras[row, 0]) - given) > max(_SIGNIFICANT * sd, OF_LENSES * given)
