"""Given orientations compared with those that were found: which photos were given wrong, and how."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_between, angles_from_rotation, rotation_from_angles
from orip.mistakes.hypothesis import Fit, is_good
from orip.mistakes.other_units import ANGLE_UNITS, FEET_AND_METRES, control_unit_text, in_angle_unit, is_nearer
from orip.records.block import Block
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace
from orip.wording import counted_names

_FAR_AWAY, _FAR_TURNED = 0.2, 0.35
"""Shift over the distance to the points, and rotation in radians, above which an orientation is no approximation."""

_UNUSUAL = 7.0
"""Multiple of the usual difference from which a photo counts as given wrong: by chance alone one photo is as far off in
less than 0.2 % of all blocks, whatever the number of photos, if all are given equally roughly."""

_MOST_ARE_RIGHT = 0.25
"""Quantile of the differences that counts as usual, the second of four photos: two of them may be exchanged."""

_MOVED, _MOST_MOVED = 0.05, 40
"""Shift over the distance plus rotation from which photos may be exchanged, and most photos that are compared."""

_NEAR = 0.3
"""Largest part of the misfit that remains where a change explains it."""

_FEW = 0.4
"""Largest part of the photos that may be reported one by one as given wrong."""

_MOST_RAYS = 20_000
"""Rays from which it is told how far points typically are."""


class ComparedOrientations(Struct, frozen=True):
    """n photos with an orientation as given and as found, in project coordinates.

    Parameters
    ----------
    names : tuple of str
    given, found : arrays (n, 6)
        Ground units and radians; NaN where not given.
    distance : float
        From the photos to their points.
    files : tuple of str
        Where the position of each is given.
    """

    names: tuple[str, ...]
    given: FloatArray
    found: FloatArray
    distance: float
    files: tuple[str, ...]

    @property
    def shifts(self) -> FloatArray:
        """Return the distances (n,) of given and found projection centres over the distance to the points."""
        return np.asarray(np.linalg.norm(self.given[:, :3] - self.found[:, :3], axis=1) / self.distance)

    @property
    def turns(self) -> FloatArray:
        """Return the rotations (n,) between given and found photos, radians."""
        return _turns(self.given, self.found)

    @property
    def is_all_elsewhere(self) -> bool:
        """Return whether most photos were found far from where they were given."""
        known = np.isfinite(self.shifts) & np.isfinite(self.turns)
        if not known.any():
            return False
        return bool(np.median(self.shifts[known]) > _FAR_AWAY or np.median(self.turns[known]) > _FAR_TURNED)


def compared_orientations(
    block: Block, centres: FloatArray, rotations: FloatArray, points: FloatArray
) -> ComparedOrientations:
    """Compare the orientations given in a block with others.

    Parameters
    ----------
    block : Block
        As gathered.
    centres, rotations : arrays (n, 3) and (n, 3, 3)
        In the frame of the block.
    points : array (number of points, 3)
        In the frame of the block, in its order.
    """
    # what is typical shows in an even selection
    rays = np.arange(0, len(block.photo_points.photo), 1 + len(block.photo_points.photo) // _MOST_RAYS)
    seen = block.photo_points.of(rays)
    away = np.linalg.norm(points[seen.point] - centres[seen.photo], axis=1)
    given = block.photo_orientation.copy()
    given[:, :3] = block.ground.to_project(given[:, :3])
    found = np.hstack([block.ground.to_project(centres), angles_from_rotation(rotations)])
    return ComparedOrientations(
        tuple(photo.name for photo in block.photos),
        given,
        found,
        max(float(np.nanmedian(away)), 1e-12),
        _files_of_positions(block),
    )


def _files_of_positions(block: Block) -> tuple[str, ...]:
    """Return the file where the position of each photo is observed, else orip.toml, which gives preliminary ones."""
    of_stations = {record_key(station.photo) for station in block.stations if station.has_position}
    of_elements = {
        record_key(element.name)
        for element in block.elements
        if element.group == "PHOTO" and element.kind in PHOTO_PARAMETERS[:3]
    }
    keys = (record_key(photo.name) for photo in block.photos)
    return tuple(
        "the .STA file" if key in of_stations else "the .ELE file" if key in of_elements else "orip.toml"
        for key in keys
    )


def misgiven_orientations(compared: ComparedOrientations) -> list[ProjectWarning]:
    """Return a warning for each photo whose orientation was given wrong, if most others were not."""
    roughly = float(np.nanmedian(compared.shifts)) > _FAR_AWAY
    if roughly and (unit := _control_in_another_unit(compared)):
        return unit
    exchanged = _exchanged_pairs(compared)
    if roughly:
        # where all are given roughly, or in another ground system, no single photo is wrong
        return [_exchange(compared, *pair) for pair in exchanged]
    wrong = _wrong(compared)
    wrong[list(chain(*exchanged))] = False
    rows = np.flatnonzero(wrong).tolist()
    single = [_misgiven(compared, row) for row in rows] if len(rows) <= max(1.0, _FEW * len(wrong)) else []
    return [*(_exchange(compared, *pair) for pair in exchanged), *single]


def _control_in_another_unit(compared: ComparedOrientations) -> list[ProjectWarning]:
    """Return a warning if all photos are where they were given, but in another unit: control determines the scale."""
    for factor in FEET_AND_METRES:
        off = np.linalg.norm(compared.found[:, :3] * factor - compared.given[:, :3], axis=1) / compared.distance
        if float(np.nanmedian(off)) < _NEAR * float(np.nanmedian(compared.shifts)):
            return [ProjectWarning("control-unit", "", control_unit_text(factor))]
    return []


def misgiven_as_a_whole(compared: ComparedOrientations) -> list[ProjectWarning]:
    """Return a warning that photos were given wrong, without a cause."""
    wrong = _wrong(compared)
    names = [name for name, is_wrong in zip(compared.names, wrong, strict=True) if is_wrong]
    if not names:
        return []
    text = (
        "the given orientations do not fit; without them the block does. Check X0, Y0, Z0, OMEGA, PHI and KAPPA: their "
        "order, units and signs; or leave them out"
    )
    return [ProjectWarning("given-orientation", counted_names("photo", names), text)]


def _wrong(compared: ComparedOrientations) -> BoolArray:
    """Return which photos (n,) were given far from where they are, and much farther than most."""
    wrong = np.zeros(len(compared.names), dtype=bool)
    for size, far in ((compared.shifts, _FAR_AWAY), (compared.turns, _FAR_TURNED)):
        usual = float(np.nanquantile(size, _MOST_ARE_RIGHT, method="higher")) if np.isfinite(size).any() else 0.0
        wrong |= np.nan_to_num(size) > max(far, _UNUSUAL * usual)
    return wrong


def _exchanged_pairs(compared: ComparedOrientations) -> list[tuple[int, int]]:
    """Return the pairs of photos each found where the other one was given, if most were found where given."""
    off = np.nan_to_num(compared.shifts) + np.nan_to_num(compared.turns)
    usual = float(np.quantile(off, _MOST_ARE_RIGHT))
    rows = np.flatnonzero(off > max(_MOVED, 2.0 * usual)).tolist()
    if len(rows) > _MOST_MOVED:
        return []
    return [pair for pair in combinations(rows, 2) if _are_exchanged(compared, *pair)]


def _turns(one: FloatArray, other: FloatArray) -> FloatArray:
    known = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    turns = np.full(len(one), np.nan)
    turns[known] = angles_between(rotation_from_angles(one[known, 3:]), rotation_from_angles(other[known, 3:]))
    return turns


def _are_exchanged(compared: ComparedOrientations, one: int, other: int) -> bool:
    """Tell whether two photos were found where the other one was given, and rotated like it."""
    own, swapped = compared.given[[one, other]], compared.given[[other, one]]
    found = compared.found[[one, other]]
    apart = [
        np.linalg.norm(given[:, :3] - found[:, :3], axis=1) / compared.distance + _turns(given, found)
        for given in (own, swapped)
    ]
    return bool((apart[1] < _NEAR * apart[0]).all())


def _exchange(compared: ComparedOrientations, one: int, other: int) -> ProjectWarning:
    first, second = compared.names[one], compared.names[other]
    text = (
        f"photos {first} and {second} are exchanged: what was measured under one name was taken where the other was "
        "given; exchange the names in the POINTS lines, or the preliminary orientations"
    )
    return ProjectWarning("exchanged-photos", "", text)


def _misgiven(compared: ComparedOrientations, row: int) -> ProjectWarning:
    how = next(_changes(compared, row), None)
    if how is None:
        parts = []
        if compared.shifts[row] > _FAR_AWAY:
            parts.append("its position is off by " + _listed(compared.given[row, :3] - compared.found[row, :3]))
        if compared.turns[row] > _FAR_TURNED:
            parts.append(f"it is rotated by {np.degrees(compared.turns[row]):.0f}°")
        how = f"the block puts it elsewhere: {', and '.join(parts)}"
    is_position = compared.turns[row] <= _FAR_TURNED or not np.isfinite(compared.turns[row])
    what = "position" if is_position else "orientation"
    text = f"its given {what} is wrong: {how}; correct it in {compared.files[row]}"
    return ProjectWarning("given-orientation", f"photo {compared.names[row]}", text)


def _listed(offset: FloatArray) -> str:
    return ", ".join(f"{kind} {value:+.4g}" for kind, value in zip(PHOTO_PARAMETERS[:3], offset, strict=True))


def _changes(compared: ComparedOrientations, row: int) -> Iterator[str]:
    """Yield the changes that bring a given orientation near the one found, the likeliest first."""
    given, found = compared.given[row], compared.found[row]
    turn, shift = float(compared.turns[row]), float(compared.shifts[row])
    if turn > _FAR_TURNED and shift <= _FAR_AWAY:
        for degrees in (180.0, 90.0, -90.0):
            if _turned(given + np.radians([0.0, 0.0, 0.0, 0.0, 0.0, degrees]), found) < _NEAR * turn:
                yield f"KAPPA is off by {abs(degrees):.0f}° (given {_degrees(given[5])}, found {_degrees(found[5])})"
        for place, kind in enumerate(PHOTO_PARAMETERS[3:], 3):
            signs = np.where(np.arange(6) == place, -1.0, 1.0)
            if _turned(given * signs, found) < _NEAR * turn:
                yield f"{kind} has the opposite sign (given {_degrees(given[place])}, found {_degrees(found[place])})"
        if _turned(given[[0, 1, 2, 4, 3, 5]], found) < _NEAR * turn:
            yield "OMEGA and PHI are exchanged"
    if shift > _FAR_AWAY and turn <= _FAR_TURNED:
        if np.linalg.norm(given[[1, 0, 2]] - found[:3]) < _NEAR * shift * compared.distance:
            yield "X0 and Y0 are exchanged"
        off = np.abs(given[:3] - found[:3]) > _NEAR * shift * compared.distance
        if np.count_nonzero(off) == 1:
            place = int(np.argmax(off))
            yield f"{PHOTO_PARAMETERS[place]} = {given[place]:.10g}, where the block has {found[place]:.10g}"


def _turned(one: FloatArray, other: FloatArray) -> float:
    return float(_turns(one[None], other[None])[0])


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.1f}°"


def moved_photos(block: Block, solved: SolvedBlock, fit: Fit) -> list[ProjectWarning]:
    """Return a warning for each photo given far from where the adjustment puts it; none if the adjustment fits badly.

    Parameters
    ----------
    block : Block
        As gathered.
    fit : Fit
        Of the adjustment.
    """
    if not np.isfinite(block.photo_orientation).any() or not is_good(fit):
        return []
    state, points = solved.state, solved.state.points
    if solved.block.point_names != block.point_names:
        place = solved.block.point_index()
        points = points[[place[name] for name in block.point_names]]
    return misgiven_orientations(compared_orientations(block, state.centres, state.rotations, points))


def without_orientations(block: Block) -> Block | None:
    """Return a block without its given orientations; None where none are given, or all are held."""
    given = np.isfinite(block.photo_orientation)
    held = np.array([bool(photo.constant) for photo in block.photos])
    if not given[~held].any():
        return None
    return replace(block, photo_orientation=np.where(held[:, None], block.photo_orientation, np.nan))


def misgiven(solved: SolvedBlock, block: Block) -> list[ProjectWarning]:
    """Return how a few of the orientations given in a block, or their unit, differ from those adjusted."""
    for factor in ANGLE_UNITS:
        if is_nearer(block.photo_orientation[:, 3:], factor, solved.state.rotations):
            return [ProjectWarning("angle-unit", *in_angle_unit(block, factor))]
    return misgiven_orientations(compared_with_adjusted(solved, block))


def compared_with_adjusted(solved: SolvedBlock, block: Block) -> ComparedOrientations:
    """Compare the orientations given in a block with those of an adjustment."""
    place = solved.block.point_index()
    points = solved.state.points[[place[name] for name in block.point_names]]
    return compared_orientations(block, solved.state.centres, solved.state.rotations, points)
