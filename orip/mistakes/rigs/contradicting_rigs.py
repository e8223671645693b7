"""Rigs that photos contradict: a camera mounted elsewhere, two cameras exchanged, a photo of another instant.

The block is adjusted with all photos on their own, and with all mountings as unknowns, from where it is, or from
nothing where mountings lead astray. Mountings are compared with what is given once as good as one photo has them, and
then with the covariance that the block gives them: a turn that no photo shows by itself is seen. The photos of an
exposure are compared with each other where they do not fit a rig of any mountings.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from orip.adjustment.outlier_tests import chi_square_tail
from orip.arrays import FloatArray
from orip.bundle.unknowns import CONSTANT
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.mistakes.camera_values import with_unknown
from orip.mistakes.hypothesis import DECIDED, Fit, Misfit, Readjuster, fit_of_adjustment, is_good
from orip.mistakes.mistake import ANOTHER_START, ON_GROUND, Consequence, declare
from orip.mistakes.rigs.compared_poses import FoundPoses, Pose, poses_off, square_sum
from orip.mistakes.rigs.misread_mountings import other_mountings
from orip.records.block import Block
from orip.records.observation_kinds import MOUNTING as OBSERVED_MOUNTING
from orip.records.observation_kinds import PHOTO_POINT
from orip.records.rig import Mounting, Rig, Rigs
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN, RADIANS_PER_DEGREE
from orip.wording import joined

if TYPE_CHECKING:
    from orip.bundle.rigs.starting import RigState
    from orip.bundle.solve import SolvedBlock

_BENT = Consequence(warnings=ANOTHER_START, groups=(*ON_GROUND, "check point", "camera", "photo"))
"""Cameras that are not where a rig has them bend all that it holds."""

MOUNTING = declare("mounting", "", _BENT)
MISREAD_MOUNTING = declare("misread-mounting", "", _BENT)
EXCHANGED_CAMERAS = declare("exchanged-cameras", "", _BENT)
NOT_SYNCHRONOUS = declare("not-synchronous", "", _BENT)

_SHARE = 0.15
"""Part of the rays of a photo that do not fit where its rig is looked at."""

_OFF = 3.0
"""Standard errors beyond which a ray does not fit."""

_EXPLAINED, _CERTAINLY = 1.0 / 3.0, 1e-3
"""Part of the square sum of differences that is left where mountings are read as they were meant, and one that no
other reading leaves."""

_LEAST_FALL = 25.0
"""Least fall of that square sum; of thirty readings, by chance, none."""

_LEAST_VARIANCES = np.array([1e-12] * 3 + [1e-16] * 3)
"""Of a mounting: the first of a rig is constant."""

_AS_WELL = 1.01
"""Ratio of two of these parts up to which one reading is as likely as the other: of a rig of two cameras the inverse
mounting is that of the exchanged ones."""

_OF_A_LENS = ("C", "DX", "DY", "A3")

_BY_CHANCE = float(np.log(1e-4))
"""Logarithm of the probability below which a square sum is larger than chance makes it."""

_NOT_GIVEN = 10.0
"""Error of an offset that is not given, in the largest one; of a rotation 1 radian."""


def contradicting_rigs(misfit: Misfit) -> list[ProjectWarning]:
    """Return what is wrong with rigs and exposures; nothing where photos on their own do not fit either."""
    solved, readjuster = misfit.solved, misfit.readjuster
    if solved.problem.unknowns.rigs is None or not readjuster.is_worthwhile:
        return []
    said = readjuster.block.rigs
    unknown = _with_unknown_mountings(said)
    is_doubted = _is_doubtful(fit_of_adjustment(solved)) or any(group.doubted for group in misfit.solution.groups)
    if not is_doubted and unknown == said:
        return []
    started = _from_state(solved, readjuster.block)
    alone = _fitting(replace(started, rigs=Rigs()), readjuster, said) if is_doubted else None
    # mountings that are far off lead astray, and are found from nothing where photos on their own do not fit
    near = alone if is_doubted else solved
    starts = [*([] if near is None else [_from_state(near, started)]), *([readjuster.block] if is_doubted else [])]
    tried = (_fitting(replace(start, rigs=unknown), readjuster, said) for start in starts)
    mounted = solved if unknown == said else next((one for one in tried if one is not None), None)
    for free, as_of_photos in ((alone, True), (mounted, False)):
        if free is not None and (found := list(_wrong_mountings(free, said, as_of_photos=as_of_photos))):
            return _unless_lens(found, mounted, started, readjuster)
    if alone is None or (mounted is not None and _fits_as_well(mounted, alone)):
        return []
    return list(_other_instants(alone, said))


def _from_state(solved: SolvedBlock, block: Block) -> Block:
    """Return the block with its photos where an adjustment has them; as it is where that has not all of them."""
    names = {photo.name: row for row, photo in enumerate(solved.block.photos)}
    if any(photo.name not in names for photo in block.photos):
        return block
    orientation = np.hstack([solved.state.centres, angles_from_rotation(solved.state.rotations)])
    rows = np.array([names[photo.name] for photo in block.photos])
    return replace(block, photo_orientation=orientation[rows])


def _fitting(block: Block, readjuster: Readjuster, given: Rigs) -> SolvedBlock | None:
    """Return the adjustment of a block with other rigs if it fits and determines most photos.

    Cameras without a common view need the rig.
    """
    solved = readjuster.adjust(block)
    if solved is None or not is_good(fit_of_adjustment(solved)) or not _has_most_photos(solved, given):
        return None
    return solved


def _fits_as_well(mounted: SolvedBlock, alone: SolvedBlock) -> bool:
    """Return whether photos of a rig fit as well as on their own: these have more unknowns, and nothing else."""
    more = alone.problem.layout.size - mounted.problem.layout.size
    square = 2.0 * (_cost(mounted) - _cost(alone)) / alone.deviation_scale**2
    return more > 0 and chi_square_tail(square, float(more)) > _BY_CHANCE


def _cost(solved: SolvedBlock) -> float:
    return float(solved.weighing.cost(solved.equations))


def _unless_lens(
    found: list[ProjectWarning], mounted: SolvedBlock | None, block: Block, readjuster: Readjuster
) -> list[ProjectWarning]:
    """Return the warnings about mountings, where what is held of the lenses of rigs does not explain the misfit.

    A principal point that is wrong turns the photos of a camera nearly alike.
    """
    for row in np.unique(block.photo_camera[[one.photo for one in block.places_on_rigs().photos]]).tolist():
        block = with_unknown(block, row, *_OF_A_LENS)
    lenses = readjuster.adjust(block)
    if lenses is None or not is_good(fit_of_adjustment(lenses)):
        return found
    more = _cost(lenses) - (np.inf if mounted is None else _cost(mounted))
    if more > DECIDED:
        return found
    if more < -DECIDED:
        return []
    other = "; or check the calibration of the cameras, which explains as much"
    return [replace(one, text=one.text + other) for one in found]


def _has_most_photos(free: SolvedBlock, given: Rigs) -> bool:
    """Return whether most photos of each camera on a rig are determined: others stay where the rig had them."""
    from orip.bundle.results.ground import undetermined_photos

    photos, _, cameras = np.array(replace(free.block, rigs=given).places_on_rigs().photos).T
    determined = ~undetermined_photos(free)[photos].any(axis=1)
    return bool((np.bincount(cameras, determined) > 0.5 * np.bincount(cameras)).all())


def _is_doubtful(given: Fit) -> bool:
    """Return whether many rays of a photo, or the mounting of a camera, do not fit."""
    kind, photo, _, _ = given.columns
    off = given.standard > _OFF * given.scale
    rays = kind.where(PHOTO_POINT.name.__eq__)
    count = np.bincount(photo.codes[rays], minlength=len(photo.distinct))
    wrong = np.bincount(photo.codes[rays & off], minlength=len(photo.distinct))
    return bool(
        (wrong > _SHARE * count).any() or off[kind.where(OBSERVED_MOUNTING.name.__eq__)].any() or not is_good(given)
    )


def _wrong_mountings(free: SolvedBlock, given: Rigs, *, as_of_photos: bool) -> Iterator[ProjectWarning]:
    """Yield what is wrong with mountings.

    `free` has photos on their own, or mountings as unknowns; these are as good as they are in it, or as they are from
    one photo.
    """
    state, of_photos = _free(free, given)
    covariance = _mean_covariances(state, of_photos) if as_of_photos else _covariance_of_mountings(free)
    places = replace(free.block, rigs=given).places_on_rigs()
    for rig in given.rigs:
        rows = [row for row, camera in enumerate(places.mounted) if camera.rig == rig.name]
        said: dict[int, Pose] = {}
        of_given: list[FloatArray] = []
        largest = np.linalg.norm(state.offsets[rows], axis=1).max(initial=0.0)
        for row in rows:
            mounting = places.mounted[row].mounting
            is_determined = np.isfinite(covariance[6 * row : 6 * row + 6]).any()
            if (mounting.offset is not None or mounting.rotation is not None) and is_determined:
                said[row], variances = _given(mounting, (state.offsets[row], state.mountings[row]), largest)
                of_given.append(variances)
        if len(said) < 2:
            continue
        mine = np.concatenate([6 * row + np.arange(6) for row in said])
        both = covariance[np.ix_(mine, mine)] + np.diag(np.concatenate(of_given))
        found = FoundPoses({row: (state.offsets[row], state.mountings[row]) for row in said}, both)
        names = {row: places.mounted[row].mounting.name for row in said}
        yield from _compared(said, found, names, rig.name, free.block.ground_unit)


def _covariance_of_mountings(free: SolvedBlock) -> FloatArray:
    """Return the covariance (6 c, 6 c) of mountings that are unknowns; NaN of those that are not determined."""
    assert free.problem.unknowns.rigs is not None, "there are rigs"
    columns = free.problem.unknowns.rigs.mountings
    unknown = np.flatnonzero(columns.ravel() != CONSTANT)
    found = np.diag(np.tile(_LEAST_VARIANCES, len(columns)))
    found[np.ix_(unknown, unknown)] += free.deviation_scale**2 * free.cofactors_of(columns.ravel()[unknown])
    undetermined = np.repeat(free.is_undetermined(columns).any(axis=1), 6)
    found[undetermined] = found[:, undetermined] = np.nan
    return found


def _given(mounting: Mounting, found: Pose, largest: float) -> tuple[Pose, FloatArray]:
    """Return a mounting as it is given, with its variances (6,); what is not given is as found, and uncertain."""
    offset, rotation = found
    error = np.array([_NOT_GIVEN * largest] * 3 + [1.0] * 3)
    of_given = np.array([value or 0.0 for value in mounting.errors])
    if mounting.offset is not None:
        offset, error[:3] = np.array(mounting.offset), of_given[:3]
    if mounting.rotation is not None:
        rotation = rotation_from_angles(np.array(mounting.rotation) * RADIANS_PER_DEGREE)
        error[3:] = of_given[3:] * RADIANS_PER_DEGREE
    return (offset, rotation), error**2


def _compared(
    said: dict[int, Pose], found: FoundPoses, names: dict[int, str], rig: str, unit: str
) -> Iterator[ProjectWarning]:
    if readings := list(_read_otherwise(said, found, names, rig)):
        yield from readings
        return
    off = poses_off(said, found)
    for row, (shift, turn) in off.items():
        text = (
            f"camera {names[row]} is mounted {np.linalg.norm(turn) * DEGREES_PER_RADIAN:.2g} degrees and "
            f"{np.linalg.norm(shift):.2g} {unit} off from what [[rig]] {rig} says; correct it there, or leave offset "
            "and rotation out: they are then adjusted"
        )
        yield ProjectWarning(MOUNTING, f"camera {names[row]}", text)


def _read_otherwise(
    said: dict[int, Pose], found: FoundPoses, names: dict[int, str], rig: str
) -> Iterator[ProjectWarning]:
    """Yield as what the mountings of a rig were probably meant, if they are off and not so."""
    size = square_sum(said, found)
    if chi_square_tail(size, 6.0 * (len(said) - 1)) > _BY_CHANCE:
        return
    off = poses_off(said, found)
    readings = [
        (square_sum(meant.poses, found) / size, meant) for meant in other_mountings(said, list(off), names, rig)
    ]
    likely = [
        (left, meant)
        for left, meant in sorted(readings, key=lambda reading: reading[0])
        if left < _CERTAINLY
        or (left < _EXPLAINED and size * (1.0 - left) > _LEAST_FALL and not poses_off(meant.poses, found))
    ]
    if likely:
        least, first = likely[0]
        others = [meant.text for left, meant in likely[1:] if left <= _AS_WELL * least]
        code = EXCHANGED_CAMERAS if first.is_exchange else MISREAD_MOUNTING
        yield ProjectWarning(code, f"rig {rig}", "; or ".join([first.text, *dict.fromkeys(others)]))


def _other_instants(alone: SolvedBlock, given: Rigs) -> Iterator[ProjectWarning]:
    state, covariances = _free(alone, given)
    places = replace(alone.block, rigs=given).places_on_rigs()
    block = alone.block
    for exposure, name in enumerate(places.exposures):
        members = np.flatnonzero(state.exposure == exposure)
        photos = {int(row): int(state.photo[row]) for row in members}
        poses = {row: (alone.state.centres[photo], alone.state.rotations[photo]) for row, photo in photos.items()}
        mounted = dict(zip(members.tolist(), state.mounted[members].tolist(), strict=True))
        said = {row: (state.offsets[camera], state.mountings[camera]) for row, camera in mounted.items()}
        off = poses_off(said, FoundPoses(poses, _block_diagonal(covariances[members])))
        if not off:
            continue
        names = [block.photos[photos[row]].name for row in (off if len(said) > 2 else said)]
        shift, turn = max(off.values(), key=lambda one: float(np.linalg.norm(one[0])))
        size = f"{np.linalg.norm(shift):.2g} {block.ground_unit} and {np.linalg.norm(turn) * DEGREES_PER_RADIAN:.2g}"
        subject = f"its photo {names[0]} is" if len(names) == 1 else f"its photos {joined(names)} are"
        others = "each other" if len(said) == 2 else "where the others have it"
        text = (
            f"exposure {name} is not synchronous: {subject} {size} degrees off from {others}; take what was not taken "
            "at that instant out of the [[exposure]]"
        )
        yield ProjectWarning(NOT_SYNCHRONOUS, f"exposure {name}", text)


def _free(alone: SolvedBlock, given: Rigs) -> tuple[RigState, FloatArray]:
    """Return exposures and mountings as the photos have them, and covariances (k, 6, 6) of these."""
    from orip.bundle.results.ground import photo_cofactors
    from orip.bundle.rigs.starting import starting_rigs

    state = alone.state
    orientation = np.hstack([state.centres, angles_from_rotation(state.rotations)])
    block = replace(alone.block, rigs=_with_unknown_mountings(given), photo_orientation=orientation)
    found = starting_rigs(block)
    assert found is not None, "there are photos of rigs"
    return found, alone.deviation_scale**2 * photo_cofactors(alone)[found.photo]


def _with_unknown_mountings(given: Rigs) -> Rigs:
    rigs = (Rig(rig.name, tuple(Mounting(one.name) for one in rig.cameras)) for rig in given.rigs)
    return replace(given, rigs=tuple(rigs))


def _mean_covariances(state: RigState, covariances: FloatArray) -> FloatArray:
    """Return the covariance (6 c, 6 c) of the mountings, along the axes of the rig, as of one photo of each camera.

    What a lens takes up displaces all photos of the camera alike.
    """
    found = np.zeros((len(state.offsets), 6, 6))
    turns = np.zeros((len(state.photo), 6, 6))
    turns[:, :3, :3] = turns[:, 3:, 3:] = np.swapaxes(state.rotations[state.exposure], 1, 2)
    np.add.at(found, state.mounted, turns @ covariances @ np.swapaxes(turns, 1, 2))
    return _block_diagonal(found / np.bincount(state.mounted)[:, None, None])


def _block_diagonal(covariances: FloatArray) -> FloatArray:
    """Return a covariance (6 k, 6 k) with no correlations between k poses."""
    count = len(covariances)
    found = np.zeros((count, 6, count, 6))
    found[np.arange(count), :, np.arange(count)] = covariances + np.diag(_LEAST_VARIANCES)
    return found.reshape(6 * count, 6 * count)
