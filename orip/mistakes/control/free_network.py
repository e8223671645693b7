"""A block as a free network: as the photos alone see it, and control compared with that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.antennas import without_unmeasured_points
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.geometry.similarity import fit_similarity
from orip.mistakes.control.contradicting_control import released_control
from orip.mistakes.ground_systems import mirrored_control, misread_control, with_multiplied_control
from orip.mistakes.hypothesis import Hypothesis, Readjuster, finding, fit_of_adjustment, is_good
from orip.mistakes.mistake import Consequence, declare
from orip.mistakes.photo_coordinates import MIRRORED
from orip.records.block import Block
from orip.records.ground import PlainGround
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.preliminary import ControlReading, PartialBlock
from orip.structs import replace
from orip.wording import counted, counted_names, joined

FREE_DATUM = declare("free-datum", comes_first=True)
DISTANCE_AXES = declare(
    "distance-axes", "", Consequence(groups=("distance",)), comes_first=True, contradicts_others=True
)

_FEWEST = 3
"""Points or projection centres that give a block its place, its turn and its scale."""


def observations_without_weight(block: Block) -> Iterator[ProjectWarning]:
    """Yield a warning if control, exposure stations or projection centres have errors that a free network ignores.

    Who names the points of the datum knows what the others are for.
    """
    if not block.is_free_network:
        return
    control = sum(
        point.kind == "control" and None not in (*point.coordinates, *point.errors) for point in block.control_points
    )
    stations = sum(station.has_position and min(station.position_error) >= 0.0 for station in block.stations)
    centres = {
        element.name
        for element in block.elements
        if element.group == "PHOTO" and element.kind in PHOTO_PARAMETERS[:3] and element.error >= 0.0
    }
    for count, what in (
        (0 if block.definition.datum_points else control, "control point"),
        (stations, "exposure station"),
        (len(centres), "observed projection centre"),
    ):
        if count >= _FEWEST:
            text = (
                f'datum = "free" takes all weight from the {counted(count, what)}: they are compared only. Leave datum '
                "out if they are to place the block; or make their errors negative, which says the same"
            )
            yield ProjectWarning(FREE_DATUM, f"bundle {block.definition.name}", text)


def distances_along_no_axes(block: Block) -> Iterator[ProjectWarning]:
    """Yield a warning of distances along axes of the project in a free network, whose axes are those of a photo."""
    names = [distance.name for distance in block.distances if distance.code != "XYZ"]
    is_anywhere = not (block.control_points or block.stations or block.elements or block.directions)
    if names and block.is_free_network and is_anywhere:
        codes = joined(sorted({distance.code for distance in block.distances} - {"XYZ"}))
        text = (
            f"{codes} is along axes of the project, and those of a free network without coordinates are the axes of "
            "its first photo: write XYZ for the length in space, in the .LEN file"
        )
        yield ProjectWarning(DISTANCE_AXES, counted_names("distance", names), text)


def free_network(block: Block) -> Block:
    """Return a block as a free network in a system of its own."""
    free = replace(
        block,
        definition=replace(block.definition, datum="free", datum_points=()),
        control_points=(),
        constant_points=np.zeros_like(block.constant_points),
        photo_orientation=np.full_like(block.photo_orientation, np.nan),
        point_start=np.full_like(block.point_start, np.nan),
        elements=tuple(element for element in block.elements if element.group == "CAMERA"),
        distances=(),
        directions=(),
        stations=(),
        theodolites=(),
        constant_elements=(),
        preliminary=(),
    )
    return without_unmeasured_points(free)


# The photos are adjusted as a free network. Where that fits, what does not fit is the control; its points and those of
# the network differ by a spatial similarity, which shows what is wrong.

_FEWEST_TO_COMPARE = 4
"""Least number of control points among which a wrong one shows."""

_MOST = 14
"""Most control points of which pairs are exchanged for a trial."""

_SINGLE = 3
"""Most control points that are left out for a trial, those whose absence helps most first."""

_BETTER = 0.5
"""Largest part of the misfit of the control that remains where one mistake explains it."""

_EXCHANGED = np.eye(3)[[1, 0, 2]]


class _Common(Struct, frozen=True):
    """Control points in the free network and as given, both (n, 3)."""

    names: tuple[str, ...]
    source: FloatArray
    target: FloatArray

    def misfit(self, target: FloatArray, rows: Sequence[int] | slice = slice(None)) -> float:
        """Return the root mean square misfit of points; infinite where they determine no similarity."""
        try:
            fitted = fit_similarity(self.source[rows], target[rows])
        except ValueError:
            return np.inf
        offset = fitted.apply(self.source[rows]) - target[rows]
        # the similarity has 7 unknowns for 3n coordinates
        return float(np.sqrt((offset**2).sum() / max(3 * len(offset) - 7, 1)))


def control_of_free_network(readjuster: Readjuster) -> Iterator[Hypothesis]:
    """Yield control as it was probably meant, if the photos fit without it."""
    block = readjuster.block
    if not isinstance(block.ground, PlainGround) or any(photo.constant for photo in block.photos):
        return
    free = readjuster.adjust_roughly(free_network(block))
    if free is None or not is_good(fit_of_adjustment(free)):
        return
    yield from _read_otherwise(block, free)
    common = _common(block, free)
    if len(common.names) >= _FEWEST_TO_COMPARE:
        yield from _exchanged_points(block, common)
        yield from released_control(block, _suspects(common))


def _read_otherwise(block: Block, free: SolvedBlock) -> Iterator[Hypothesis]:
    names = _Names(tuple(photo.name for photo in free.block.photos), free.block.point_names)
    spread = np.zeros_like(free.state.points)
    partial = PartialBlock(
        "", np.arange(len(names.photos)), free.state.rotations, free.state.centres, np.arange(len(names.points)),
        free.state.points, spread,
    )  # fmt: skip
    from orip.prelim.ground import known_centres, known_points  # few blocks need it
    from orip.prelim.similarity.control_reading import other_reading

    centres = known_centres(block)
    reading = other_reading(partial, names, known_points(block), centres if len(centres.names) else None)
    if reading is not None and reading.changes == ("photos",):
        yield _mirrored_photos(block, misread_control(reading)[0])
        return
    matrix = _matrix(reading)
    if reading is None or matrix is None:
        if not np.isfinite(block.photo_orientation).any():
            yield from mirrored_control(block)
        return
    (text,) = misread_control(reading)
    changed = with_multiplied_control(block, matrix)
    changed = replace(changed, photo_orientation=np.full_like(block.photo_orientation, np.nan))
    yield Hypothesis(changed, finding("control-reading", "", text))


def _mirrored_photos(block: Block, text: str) -> Hypothesis:
    xy = block.photo_points.xy * [1.0, -1.0]
    changed = replace(
        block,
        photo_points=replace(block.photo_points, xy=xy),
        photo_orientation=np.full_like(block.photo_orientation, np.nan),
    )
    return Hypothesis(changed, finding(MIRRORED, "", text))


class _Names(Struct, frozen=True):
    photos: tuple[str, ...]
    points: tuple[str, ...]


def _matrix(reading: ControlReading | None) -> FloatArray | None:
    """Return the matrix that takes control to the reading; None where the reading does not concern its axes."""
    if reading is None:
        return None
    if reading.reading == "mirror image":
        if reading.changes == ("Z",) or reading.side < 0.0:
            return np.diag([1.0, 1.0, -1.0])
        return _EXCHANGED
    if reading.reading == "from below":
        return _EXCHANGED
    return np.diag([1.0, 1.0, reading.z_factor]) if reading.reading == "unit of Z" else None


def _common(block: Block, free: SolvedBlock) -> _Common:
    from orip.prelim.ground import known_points

    known = known_points(block)
    place = {name: row for row, name in enumerate(free.block.point_names)}
    rows = [
        row
        for row, name in enumerate(known.names)
        if name in place and np.isfinite(known.coordinates[row]).all() and not (known.errors[row] < 0.0).any()
    ]
    names = tuple(known.names[row] for row in rows)
    return _Common(names, free.state.points[[place[name] for name in names]], known.coordinates[rows])


def _exchanged_points(block: Block, common: _Common) -> Iterator[Hypothesis]:
    """Yield the two control points that fit best if they are exchanged."""
    if len(common.names) > _MOST:
        return
    as_given = common.misfit(common.target)
    misfits: dict[tuple[int, int], float] = {}
    for pair in combinations(range(len(common.names)), 2):
        order = np.arange(len(common.names))
        order[list(pair)] = pair[::-1]
        misfits[pair] = common.misfit(common.target[order])
    best = min(misfits, key=misfits.__getitem__)
    if misfits[best] > _BETTER * as_given:
        return
    one, other = (common.names[row] for row in best)
    swapped = {one: other, other: one}
    given = {point.name: point for point in block.control_points}
    points = tuple(
        replace(point, coordinates=given[swapped[point.name]].coordinates) if point.name in swapped else point
        for point in block.control_points
    )
    text = (
        f"control points {one} and {other} fit when they are exchanged; exchange their names in the control file, or "
        "in the photos"
    )
    yield Hypothesis(replace(block, control_points=points), finding("exchanged-control", "", text))


def _suspects(common: _Common) -> list[str]:
    """Return the control points whose absence reduces the misfit of the others most."""
    count = len(common.names)
    misfits = [common.misfit(common.target, [row for row in range(count) if row != left]) for left in range(count)]
    limit = _BETTER * common.misfit(common.target)
    order = np.argsort(misfits)[:_SINGLE]
    return [common.names[row] for row in order if misfits[row] < limit]
