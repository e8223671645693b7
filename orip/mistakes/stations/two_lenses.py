"""Photos of one camera that were taken with two lenses: their positions seem to be wrong."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.adjustment.weights import MEDIAN_OF_NORMAL
from orip.arrays import IntArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.camera_values import with_unknown
from orip.mistakes.hypothesis import Fit, Misfit, explains, fit_of_adjustment, is_good
from orip.mistakes.mistake import BAD_START, STATIONS_OFF, Consequence, declare
from orip.records.block import Block
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.wording import counted_names

# Another principal distance moves photos up or down, as a strip of wrong heights would be: that they are of another
# lens shows where the points fit better with it than without any of the positions that are accused.

TWO_LENSES = declare(
    "two-lenses", "photos of one camera were taken with two lenses, or zoom positions", STATIONS_OFF, BAD_START,
    # a longer lens shows its points beyond the frame of the shorter one
    Consequence(warnings=("outside-frame", "points-outside")),
)  # fmt: skip

_POSITIONS = ("station", "element")

_FITS = 4.0
"""Standard errors within which an observation fits."""

_FEWEST_PHOTOS_OF_A_LENS = 3
"""Photos of each lens."""

_PART = 0.7
"""Part of the photos of a camera that fits badly at most: else all of it is wrong."""

_EXPLAINED = 0.2
"""Part of the photos that fit badly that still do with a camera of their own, at most."""

_BETTER = 3.0
"""Standard deviations by which the sum of squares is smaller at least with a second camera."""

_OF_A_PHOTO = 15.0
"""What the positions of one photo may add to the sum of squares after they have lost most of their weight."""

_BENT = 1.15
"""sigma0 from which something bends a block of which few observations do not fit."""

_APART, _ONE_APART = 5.0, 8.0
"""Standard deviations of those of one lens that the principal distances of two lenses are apart at least; and of the
lens of a photo or two, of which one is farther away by chance."""

_ONE_DIFFERENT = 0.02
"""Least difference of the latter, as a part of them."""

_DIFFERENT, _SIGNIFICANT = 0.002, 5.0
"""Least difference of the two principal distances, as a part of these and in standard deviations."""


def two_lenses(misfit: Misfit) -> list[ProjectWarning]:
    """Return that photos have another lens than their camera, if they fit with one of their own."""
    solution, readjuster = misfit.solution, misfit.readjuster
    if not readjuster.is_small:
        return []
    block, accused = readjuster.block, _with_wrong_positions(solution)
    if len(accused) < _FEWEST_PHOTOS_OF_A_LENS:
        return []
    for camera, rows in _groups(block, accused):
        solved = readjuster.adjust(_with_second_camera(block, camera, rows))
        if solved is None or not is_good(fit_of_adjustment(solved)):
            continue
        left = _still_wrong(fit_of_adjustment(solved))
        explains = left <= _EXPLAINED * len(accused) and _fits_better(solution, solved, len(accused))
        if explains and (text := _text(solved, block, camera)):
            where = counted_names("photo", [block.photos[row].name for row in rows.tolist()])
            return [ProjectWarning(TWO_LENSES, where, text)]
    return []


def two_lenses_of_photos(misfit: Misfit) -> list[ProjectWarning]:
    """Return the same of a block that does not fit, from principal distances that its photos have one by one."""
    solved, readjuster = misfit.solved, misfit.readjuster
    block = readjuster.block
    if not readjuster.is_small or readjuster.explaining - {"outside-frame"}:
        return []
    given = fit_of_adjustment(solved)
    if solved.variance.sigma0 < _BENT and is_good(given):
        return []
    for camera in range(len(block.cameras)):
        own = np.flatnonzero(block.photo_camera == camera)
        if len(own) < 2 * _FEWEST_PHOTOS_OF_A_LENS:
            continue
        apart = readjuster.adjust(_with_own_cameras(block, own, solved))
        rows = own[:0] if apart is None else _of_second_lens(block, own, apart)
        tried = readjuster.adjust(_with_second_camera(block, camera, rows)) if len(rows) else None
        if tried is None:
            continue
        fit = fit_of_adjustment(tried)
        if not (is_good(fit) and (explains(fit, given) or _fits_better(misfit.solution, tried, 0))):
            continue
        if text := _text(tried, block, camera):
            return [ProjectWarning(TWO_LENSES, counted_names("photo", [block.photos[row].name for row in rows]), text)]
    return []


def _with_own_cameras(block: Block, own: IntArray, solved: SolvedBlock) -> Block:
    """Return a block in which photos of one camera have a principal distance each, and all else as it was adjusted."""
    adjusted = {of.name: values for of, values in zip(solved.block.cameras, solved.state.cameras.tolist(), strict=True)}
    cameras = [replace(of, parameters=tuple(adjusted.get(of.name, of.parameters))) for of in block.cameras]
    photo_camera = block.photo_camera.copy()
    first = cameras[photo_camera[own[0]]]
    for row in own[1:].tolist():
        photo_camera[row] = len(cameras)
        cameras.append(replace(first, name=f"{first.name}_{block.photos[row].name}", unknown=("C",)))
    cameras[photo_camera[own[0]]] = replace(first, unknown=("C",))
    return replace(block, cameras=tuple(cameras), photo_camera=photo_camera)


def _of_second_lens(block: Block, own: IntArray, apart: SolvedBlock) -> IntArray:
    """Return the fewer rows of photos, if their principal distances are two, much farther apart than they scatter."""
    place = {photo.name: row for row, photo in enumerate(apart.block.photos)}
    known = np.array([row for row in own.tolist() if block.photos[row].name in place], dtype=np.int64)
    found = apart.state.cameras[[apart.block.photo_camera[place[block.photos[row].name]] for row in known], 0]
    order, logarithms = np.argsort(found), np.log(np.sort(np.maximum(found, 1e-9)))
    splits = range(1, len(order))
    if len(order) < 2 * _FEWEST_PHOTOS_OF_A_LENS:
        return known[:0]
    scatter = {at: np.concatenate([part - np.median(part) for part in np.split(logarithms, [at])]) for at in splits}
    at = min(splits, key=lambda split: float(np.abs(scatter[split]).sum()))
    between = float(np.median(logarithms[at:]) - np.median(logarithms[:at]))
    is_one = min(at, len(order) - at) < _FEWEST_PHOTOS_OF_A_LENS
    least = (_ONE_DIFFERENT, _ONE_APART) if is_one else (_DIFFERENT, _APART)
    if between < max(least[0], least[1] * float(np.median(np.abs(scatter[at]))) / MEDIAN_OF_NORMAL):
        return known[:0]
    return np.sort(known[order[at:] if 2 * at >= len(order) else order[:at]])


def _with_wrong_positions(solution: Solution) -> set[str]:
    """Return the `record_key` of photos whose observed position has lost weight."""
    rows = solution.residuals
    return {
        record_key(photo)
        for kind, photo, weight in zip(rows.kind, rows.photo, rows.weight_factor.tolist(), strict=True)
        if photo and kind in _POSITIONS and weight < 1.0
    }


def _still_wrong(fit: Fit) -> int:
    """Return of how many photos the positions do not fit."""
    kind, photo = fit.columns[0], fit.columns[1]
    wrong = kind.where(lambda name: name in _POSITIONS) & (fit.standard > _FITS)
    return len(np.unique(photo.codes[wrong]))


def _groups(block: Block, accused: set[str]) -> Iterator[tuple[int, IntArray]]:
    """Yield cameras with the rows of their accused photos, where these are not nearly all."""
    is_accused = np.array([record_key(photo.name) in accused for photo in block.photos])
    for camera in range(len(block.cameras)):
        own = block.photo_camera == camera
        rows = np.flatnonzero(own & is_accused)
        if (
            _FEWEST_PHOTOS_OF_A_LENS
            <= len(rows)
            <= min(_PART * np.count_nonzero(own), np.count_nonzero(own) - _FEWEST_PHOTOS_OF_A_LENS)
        ):
            yield camera, rows


def _with_second_camera(block: Block, camera: int, rows: IntArray) -> Block:
    """Return a block in which photos have a camera of their own, the principal distances of both being unknown."""
    changed = with_unknown(block, camera, "C")
    second = replace(changed.cameras[camera], name=f"{block.cameras[camera].name}_2")
    photo_camera = block.photo_camera.copy()
    photo_camera[rows] = len(block.cameras)
    return replace(changed, cameras=(*changed.cameras, second), photo_camera=photo_camera)


def _fits_better(solution: Solution, solved: SolvedBlock, accused: int) -> bool:
    """Tell whether the observations that keep their weight fit better, and not the positions of photos alone."""
    gained = (solution.sigma0**2 - solved.variance.sigma0**2) * solution.redundancy_used
    return gained > max(_BETTER * float(np.sqrt(2.0 * solution.redundancy_used)), _OF_A_PHOTO * accused)


def _text(solved: SolvedBlock, block: Block, camera: int) -> str:
    """Return what the two principal distances are; "" where they hardly differ."""
    places = [camera, len(solved.block.cameras) - 1]
    one, other = (float(solved.state.cameras[place, 0]) for place in places)
    columns = np.array([int(solved.problem.unknowns.cameras[place, 0]) for place in places])
    cofactors = solved.cofactors_of(columns)
    sd = solved.deviation_scale * np.sqrt(np.diag(cofactors))
    of_difference = solved.deviation_scale * float(np.sqrt([1.0, -1.0] @ cofactors @ [1.0, -1.0]))
    if abs(one - other) < max(_DIFFERENT * one, _SIGNIFICANT * of_difference):
        return ""
    name = block.cameras[camera].name
    is_one = np.count_nonzero(solved.block.photo_camera == places[1]) == 1
    fit, seem, these = ("it fits", "it seems", "this photo") if is_one else ("they fit", "they seem", "these photos")
    return (
        f"{fit} with C = {other:.5g} ± {sd[1]:.1g} mm, the other photos of camera {name} with {one:.5g} ± "
        f"{sd[0]:.1g} mm: {seem} to be taken with another lens, zoom or focus; define a second [[camera]] in "
        f"orip.toml and name it in {these}"
    )
