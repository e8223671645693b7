"""Where an adjustment starts: a block gathered from what is measured, at given values or at those of the chain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import compress

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.bundle.antennas import without_photos
from orip.bundle.assemble import BlockInput, gather, with_starting_values
from orip.bundle.rigs.parts import with_parts_on_rigs
from orip.bundle.rigs.starting import oriented_by_rigs
from orip.errors import Complaint, InputError, NotSolvableError, ProjectWarning
from orip.mistakes.checks import block_warnings, measurement_warnings, raise_if_impossible
from orip.mistakes.photo_coordinates import MIRRORED
from orip.mistakes.two_systems import contradicting_ground_systems
from orip.progress import stage
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.control import PreliminaryPoint
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.preliminary import NO_CONTROL, CameraStart, PhotoStart, PreliminaryValues
from orip.structs import replace

_ADVICE = (
    "measure what is missing, or give those photos X0 Y0 Z0 OMEGA PHI KAPPA in orip.toml; 'orip prelim' shows each step"
)
_ADVICE_WITHOUT_CONTROL = (
    'give control points, or set datum = "free" in the [[bundle]] of orip.toml: a free network, which distances scale'
)


class StartedBlock(Struct, frozen=True):
    """A block as its adjustment starts.

    Parameters
    ----------
    block : Block
        With starting values of all photos and points.
    gathered : Block
        The same photos and points as measured and given.
    left_out : tuple of ProjectWarning
        One for each photo that could not be oriented and is not in the block: what it lacks.
    warnings : tuple of ProjectWarning
        All others.
    """

    block: Block
    gathered: Block
    left_out: tuple[ProjectWarning, ...] = ()
    warnings: tuple[ProjectWarning, ...] = ()


def started_block(block: Block, find: Callable[[Block], PreliminaryValues]) -> StartedBlock:
    """Return a gathered block as its adjustment starts: at given values, or the chain's where some are missing.

    Photos that can be oriented neither way are left out, with a warning for each.

    Parameters
    ----------
    find : callable
        Runs the chain, where it has to.

    Raises
    ------
    NotSolvableError
        Where no photo, or none on the ground, could be oriented: with the reason for each.
    """
    block = oriented_by_rigs(block)
    if np.isfinite(block.photo_orientation).all():
        started, warnings = with_starting_values(block)
        return StartedBlock(started, block, warnings=tuple(warnings))
    values = find(block)
    if values.has_arbitrary_datum:
        # what is given is in another system than the block
        return own_start(block, values)
    from orip.prelim.ground import orientations_in_frame

    given = block.photo_orientation
    orientation = np.where(np.isnan(given), orientations_in_frame(values.photos), given)
    return _started_at(block, values, orientation, block.preliminary)


def own_start(block: Block, values: PreliminaryValues) -> StartedBlock:
    """Return a gathered block that starts at what the chain found, wherever nothing is held constant.

    Given orientations start the photos that the chain could not orient, and given coordinates the points that it could
    not determine.

    Raises
    ------
    NotSolvableError
        Where no photo, or none on the ground, could be oriented.
    """
    from orip.prelim.ground import orientations_in_frame

    own = orientations_in_frame(values.photos)
    if values.has_arbitrary_datum:
        return _started_at(block, values, own, ())
    given = block.photo_orientation
    constant = np.array([[kind in photo.constant for kind in PHOTO_PARAMETERS] for photo in block.photos])
    placed = set(values.points.names)
    others = [point for point in block.preliminary if point.name not in placed]
    return _started_at(block, values, np.where(constant | np.isnan(own), given, own), others)


def _started_at(
    block: Block, values: PreliminaryValues, orientation: FloatArray, preliminary: Sequence[PreliminaryPoint]
) -> StartedBlock:
    from orip.prelim.ground import points_in_project

    on_rigs = with_parts_on_rigs(replace(block, photo_orientation=orientation), _places(block, values))
    orientation = oriented_by_rigs(on_rigs.block).photo_orientation
    missing: BoolArray = np.asarray(np.isnan(orientation).any(axis=1))
    oriented_by_chain = any(photo.rotation is not None for photo in values.photos)
    if missing.all() or (missing.any() and not oriented_by_chain):
        raise NotSolvableError(_all_are_compared(block, values) or not_oriented(values))
    reduced = without_photos(block, missing) if missing.any() else block
    # weighted control starts where its rays meet: wrong coordinates would lead the iterations astray
    placed = {point.name for point in preliminary}
    placed |= set(compress(block.point_names, on_rigs.moved))
    points = [point for point in points_in_project(values.points, block.ground) if point.name not in placed]
    cameras = cameras_as_found(reduced.cameras, values.cameras)
    started, warnings = with_starting_values(
        replace(reduced, photo_orientation=orientation[~missing], cameras=cameras, preliminary=(*preliminary, *points))
    )
    findings = (ProjectWarning("preliminary-values", "", finding) for finding in values.findings)
    left_out = tuple(_left_out(photo) for photo in compress(values.photos, missing))
    return StartedBlock(started, reduced, left_out, (*findings, *warnings))


def _places(block: Block, values: PreliminaryValues) -> FloatArray:
    """Return the coordinates (p, 3) that the block's points have in its frame, NaN where they have none."""
    found = dict(zip(values.points.names, values.points.coordinates.tolist(), strict=True))
    nothing = [np.nan] * 3
    return np.array([found.get(name, nothing) for name in block.point_names], dtype=np.float64).reshape(-1, 3)


def _left_out(photo: PhotoStart) -> ProjectWarning:
    text = f"photo {photo.name} is left out, since it could not be oriented: {photo.how}"
    return ProjectWarning("photo-left-out", "", text)


def explained_preliminary_values(block: Block) -> PreliminaryValues:
    """Run the chain, and add to its findings what was probably mistaken in control that does not fit."""
    # they take their time to import, and many adjustments start at known values
    from orip.mistakes.ground_systems import are_east_and_north, misread_control
    from orip.prelim.chain import preliminary_values

    values = preliminary_values(block)
    mirrored = any(warning.code == MIRRORED for warning in block.warnings)
    said = misread_control(values.reading, east_and_north=are_east_and_north(block), films_mirrored=mirrored)
    return replace(values, findings=(*said, *values.findings))


def soon_found_values(block: Block) -> PreliminaryValues:
    """Run as much of the chain as takes little time."""
    from orip.prelim.chain import preliminary_values_soon

    return preliminary_values_soon(block)


def cameras_as_found(cameras: Sequence[Camera], found: Sequence[CameraStart]) -> tuple[Camera, ...]:
    """Return cameras with the parameters that preliminary values have for them."""
    parameters = {start.name: start.parameters for start in found}
    return tuple(replace(camera, parameters=parameters.get(camera.name, camera.parameters)) for camera in cameras)


def not_oriented(values: PreliminaryValues) -> str:
    """Return why photos could not be oriented, a line each, then what else was found; "" if all could.

    Where the control fits only if read differently, that is the reason for all photos.
    """
    reasons = [photo.how for photo in values.photos if photo.rotation is None]
    if not reasons:
        return ""
    if values.reading is not None:
        return "\n".join(values.findings)
    title = f"{len(reasons)} of {len(values.photos)} photos could not be oriented"
    different = list(dict.fromkeys(reasons))
    if len(different) == 1:
        advice = _ADVICE_WITHOUT_CONTROL if different[0].endswith(NO_CONTROL) else _ADVICE
        return "\n".join([f"{title}: {different[0]}; {advice}", *values.findings])
    return "\n".join([f"{title}; {_ADVICE}", *different, *values.findings])


def _all_are_compared(block: Block, values: PreliminaryValues) -> str:
    """Return that all control points are check points, where only control lacks; "" if not."""
    points = block.control_points
    if not points or not all(photo.how.endswith(NO_CONTROL) for photo in values.photos):
        return ""
    if any(error is not None and error >= 0.0 for point in points for error in point.errors):
        return ""
    how = values.photos[0].how
    of_stations = "" if how.endswith(f": {NO_CONTROL}") else how.removesuffix(NO_CONTROL)
    return (
        f"{len(values.photos)} of {len(values.photos)} photos could not be oriented: {of_stations}all {len(points)} "
        "points of the .PNT file have negative errors, are check points, and fix nothing; make the errors of three or "
        'more points positive, or set datum = "free" in the [[bundle]] of orip.toml'
    )


@stage("gathering observations")
def gather_bundle(inputs: BlockInput) -> Block:
    """Gather the block of a bundle, with warnings of what is doubtful in it.

    Returns
    -------
    Block
        Elements of photos that are not known are NaN, and so are all starting coordinates of points.

    Raises
    ------
    InputError
        With everything that prevents an adjustment.
    """
    used = {record_key(photo.camera) for photo in inputs.records.photos.values()}
    raise_if_impossible(camera for key, camera in inputs.records.cameras.items() if key in used)
    orientations = [photo.orientation[:2] for photo in inputs.records.photos.values()]
    systems = contradicting_ground_systems(inputs.control, np.array(orientations, dtype=np.float64).reshape(-1, 2))
    try:
        block = gather(inputs)
    except InputError as error:
        causes = (Complaint(str(warning)) for warning in systems)
        raise InputError((*causes, *inputs.interior.complaints, *error.complaints)) from None
    found = (
        *systems,
        *block.warnings,
        *measurement_warnings(inputs.records, inputs.measured, inputs.interior),
        *block_warnings(block, inputs.control),
        *block.ground.warnings,
    )
    return replace(block, warnings=found)
