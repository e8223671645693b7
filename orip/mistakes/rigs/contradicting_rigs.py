"""Rigs that photos contradict: a camera mounted elsewhere, two cameras exchanged, a photo of another instant.

The block is adjusted with all photos on their own, from where it is; if they do not fit so, with unknown mountings from
nothing. How each camera is mounted follows from the exposures, robustly; it is compared with what is given, and each
photo with the others of its exposure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.rotation import (
    angles_from_rotation,
    cross_matrix,
    rotation_from_angles,
    rotation_vectors_with_partials,
)
from orip.mistakes.hypothesis import Fit, Misfit, Readjuster, fit_of_adjustment, is_good
from orip.mistakes.mistake import ANOTHER_START, ON_GROUND, Consequence, declare
from orip.mistakes.rigs.misread_mountings import Pose, other_mountings
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

_LIMIT = 60.0
"""Square of a difference of six elements, over their covariance, from which it is no chance: 22 has a probability of
0.1 %, and correlations between photos are neglected."""

_EXPLAINED, _CERTAINLY = 1.0 / 3.0, 1e-3
"""Part of the square sum of differences that is left where mountings are read as they were meant, and one that no
other reading leaves."""

_LEAST_FALL = 25.0
"""Least fall of that square sum; of thirty readings, by chance, none."""

_AS_GIVEN = np.diag([1e-12] * 3 + [1e-16] * 3)
"""Least covariance of a mounting: the first of a rig is constant."""

_AS_WELL = 1.01
"""Ratio of two of these parts up to which one reading is as likely as the other: of a rig of two cameras the inverse
mounting is that of the exchanged ones."""

_NOT_GIVEN = 10.0
"""Error of an offset that is not given, in the largest one; of a rotation 1 radian."""


class _Found(NamedTuple):
    """Cameras of a rig as k photos have them: poses and covariances (6, 6), by camera."""

    poses: dict[int, Pose]
    covariances: dict[int, FloatArray]


def contradicting_rigs(misfit: Misfit) -> list[ProjectWarning]:
    """Return what is wrong with rigs and exposures; nothing where photos on their own do not fit either."""
    solved, readjuster = misfit.solved, misfit.readjuster
    if solved.problem.unknowns.rigs is None or not readjuster.is_worthwhile:
        return []
    is_doubtful = _is_doubtful(fit_of_adjustment(solved))
    if not (is_doubtful or any(group.doubted for group in misfit.solution.groups)):
        return []
    said = readjuster.block.rigs
    for free in _without_mountings(solved, readjuster):
        if free is not None and is_good(fit_of_adjustment(free)) and _has_most_photos(free, said):
            found = list(_wrong_mountings(free, said)) or list(_other_instants(free, said))
            if found or is_doubtful:
                return found
    return []


def _without_mountings(solved: SolvedBlock, readjuster: Readjuster) -> Iterator[SolvedBlock | None]:
    """Yield adjustments with all photos on their own, from where the block is, and with mountings from nothing.

    Cameras without a common view need the rig.
    """
    block, state = readjuster.block, solved.state
    names = {photo.name: row for row, photo in enumerate(solved.block.photos)}
    if all(photo.name in names for photo in block.photos):
        orientation = np.hstack([state.centres, angles_from_rotation(state.rotations)])
        rows = np.array([names[photo.name] for photo in block.photos])
        yield readjuster.adjust(replace(block, rigs=Rigs(), photo_orientation=orientation[rows]))
    if (unknown := _with_unknown_mountings(block.rigs)) != block.rigs:
        yield readjuster.adjust(replace(block, rigs=unknown))


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


def _wrong_mountings(alone: SolvedBlock, given: Rigs) -> Iterator[ProjectWarning]:
    """Yield what is wrong with mountings; where they were unknowns, small differences only if a reading explains them.

    What is held of a lens may be wrong, and moves them, too.
    """
    from orip.bundle.results.ground import reduced_cofactors

    state, covariances = _free(alone, given)
    columns = alone.problem.unknowns.rigs
    of_mountings = None
    if columns is not None:
        of_mountings = _AS_GIVEN + alone.deviation_scale**2 * reduced_cofactors(alone, columns.mountings)
    places = replace(alone.block, rigs=given).places_on_rigs()
    for rig in given.rigs:
        rows = [row for row, camera in enumerate(places.mounted) if camera.rig == rig.name]
        said: dict[int, Pose] = {}
        errors: dict[int, FloatArray] = {}
        largest = np.linalg.norm(state.offsets[rows], axis=1).max(initial=0.0)
        for row in rows:
            mounting = places.mounted[row].mounting
            if mounting.offset is not None or mounting.rotation is not None:
                said[row], errors[row] = _given(mounting, (state.offsets[row], state.mountings[row]), largest)
        if len(said) < 2:
            continue
        found = {row: (state.offsets[row], state.mountings[row]) for row in said}
        of_found = {row: _mean_covariance(state, covariances, row) + errors[row] for row in said}
        names = {row: places.mounted[row].mounting.name for row in said}
        warnings = list(_compared(said, _Found(found, of_found), names, rig.name, alone.block.ground_unit))
        if not warnings and of_mountings is not None:
            of_found = {row: of_mountings[row] + errors[row] for row in said}
            warnings = list(_read_otherwise(said, _Found(found, of_found), names, rig.name))
        yield from warnings


def _given(mounting: Mounting, found: Pose, largest: float) -> tuple[Pose, FloatArray]:
    """Return a mounting as it is given, with its covariance (6, 6); what is not given is as found, and uncertain."""
    offset, rotation = found
    error = np.array([_NOT_GIVEN * largest] * 3 + [1.0] * 3)
    of_given = np.array([value or 0.0 for value in mounting.errors])
    if mounting.offset is not None:
        offset, error[:3] = np.array(mounting.offset), of_given[:3]
    if mounting.rotation is not None:
        rotation = rotation_from_angles(np.array(mounting.rotation) * RADIANS_PER_DEGREE)
        error[3:] = of_given[3:] * RADIANS_PER_DEGREE
    return (offset, rotation), np.diag(error**2)


def _compared(
    said: dict[int, Pose], found: _Found, names: dict[int, str], rig: str, unit: str
) -> Iterator[ProjectWarning]:
    if readings := list(_read_otherwise(said, found, names, rig)):
        yield from readings
        return
    off = _off(said, found)
    for row, (shift, turn) in off.items():
        text = (
            f"camera {names[row]} is mounted {np.linalg.norm(turn) * DEGREES_PER_RADIAN:.2g} degrees and "
            f"{np.linalg.norm(shift):.2g} {unit} off from what [[rig]] {rig} says; correct it there, or leave offset "
            "and rotation out: they are then adjusted"
        )
        yield ProjectWarning(MOUNTING, f"camera {names[row]}", text)


def _read_otherwise(said: dict[int, Pose], found: _Found, names: dict[int, str], rig: str) -> Iterator[ProjectWarning]:
    """Yield as what the mountings of a rig were probably meant, if they are off and not so."""
    (size,) = _sizes([said], found)
    if size < _LEAST_FALL:
        return
    readings = list(other_mountings(said, list(_off(said, found)), names, rig))
    left_by_each = (_sizes([meant.poses for meant in readings], found) / size).tolist()
    likely = [
        (left, meant)
        for left, meant in sorted(zip(left_by_each, readings, strict=True), key=lambda reading: reading[0])
        if left < _CERTAINLY
        or (left < _EXPLAINED and size * (1.0 - left) > _LEAST_FALL and not _off(meant.poses, found))
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
        off = _off(said, _Found(poses, {row: covariances[row] for row in members.tolist()}))
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


def _mean_covariance(state: RigState, covariances: FloatArray, camera: int) -> FloatArray:
    """Return the covariance (6, 6) of the mounting of a camera, along the axes of the rig."""
    rows = np.flatnonzero(state.mounted == camera)
    turns = np.zeros((len(rows), 6, 6))
    turns[:, :3, :3] = turns[:, 3:, 3:] = np.swapaxes(state.rotations[state.exposure[rows]], 1, 2)
    # as of one photo: what a lens takes up displaces all photos of the camera alike
    return np.asarray((turns @ covariances[rows] @ np.swapaxes(turns, 1, 2)).mean(axis=0))


def _off(said: dict[int, Pose], found: _Found) -> dict[int, tuple[FloatArray, FloatArray]]:
    """Return the cameras that are not where the others, put where they are, have them: shift (3,), rotation (3,).

    Left out one after the other, that which fits least first; of two cameras it is the second one.
    """
    left, off = list(said), []
    while len(left) > 1:
        tested = left if len(left) > 2 else left[1:]
        squares = [_against_others(said, found, left, row)[1] for row in tested]
        if max(squares) <= _LIMIT:
            break
        off.append(tested[int(np.argmax(squares))])
        left.remove(off[-1])
    differences = {row: _against_others(said, found, left, row)[0] for row in said if row in off}
    return {row: (difference[:3], difference[3:]) for row, difference in differences.items()}


def _against_others(said: dict[int, Pose], found: _Found, others: list[int], row: int) -> tuple[FloatArray, float]:
    """Return shift and rotation (6,) of a camera against where others have it, and their square over the covariance.

    The others are put where they are by least squares.
    """
    others = [other for other in others if other != row]
    differences, arms = (of[0, 0] for of in _differences([said], found.poses, others[:1], [*others, row]))
    *by_motion, moved = _by_motion(arms)
    normals, right = np.zeros((6, 6)), np.zeros(6)
    for other, partials, difference in zip(others, by_motion, differences[:-1], strict=True):
        weighted = partials.T @ np.linalg.pinv(found.covariances[other], hermitian=True)
        normals += weighted @ partials
        right += weighted @ difference
    cofactors = np.linalg.pinv(normals, hermitian=True)
    difference = differences[-1] - moved @ cofactors @ right
    covariance = found.covariances[row] + moved @ cofactors @ moved.T
    return difference, float(difference @ np.linalg.pinv(covariance, hermitian=True) @ difference)


def _by_motion(arms: FloatArray) -> FloatArray:
    """Return the partials (n, 6, 6) of place and rotation at the end of arms by those at their beginning."""
    partials = np.tile(np.eye(6), (len(arms), 1, 1))
    partials[:, :3, 3:] = -cross_matrix(arms)
    return partials


def _sizes(readings: Sequence[dict[int, Pose]], found: _Found) -> FloatArray:
    """Return the least sum of squares of differences, over their covariances, that an anchor leaves in each reading."""
    rows = list(found.poses)
    covariances = np.array([found.covariances[row] for row in rows])
    weights = np.linalg.pinv(covariances[:, None] + covariances, hermitian=True)
    differences, _ = _differences(readings, found.poses, rows, rows)
    weighted = (weights @ differences[..., None])[..., 0]
    return np.asarray((differences * weighted).sum(axis=(2, 3)).min(axis=1))


def _differences(
    readings: Sequence[dict[int, Pose]], found: dict[int, Pose], anchors: Sequence[int], rows: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Return shifts and rotations (m, a, n, 6) of n poses, in m readings, against where a anchors have them.

    Also the arms (m, a, n, 3) from the anchors.
    """
    offset, mounting = (np.array([[said[row][part] for row in rows] for said in readings])[:, None] for part in (0, 1))
    origin, axes = (
        np.array([[said[row][part] for row in anchors] for said in readings])[:, :, None] for part in (0, 1)
    )
    place, rotation = (np.array([found[row][part] for row in rows]) for part in (0, 1))
    anchor, turned = (np.array([found[row][part] for row in anchors])[:, None] for part in (0, 1))
    to_found = turned @ np.swapaxes(axes, -1, -2)
    arms = (to_found @ (offset - origin)[..., None])[..., 0]
    turns = rotation @ np.swapaxes(to_found @ mounting, -1, -2)
    vectors, _ = rotation_vectors_with_partials(turns)
    return np.concatenate([place - anchor - arms, vectors], axis=-1), arms
