"""Blocks of vertical photos in which cameras lie under the ground, or fly at different heights, or control is bent.

Of nearly flat ground a mirrored picture is what a camera below it would see, a picture of half the resolution is what a
camera twice as high would see, and heights in another unit bend nothing much: such blocks fit nearly as well as right
ones. What gives them away costs nothing: on which side of the ground the cameras are, and how high each of one camera
flies. The reading that was probably meant is adjusted then, and decides where the ground has enough relief.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray, rows_of_groups
from orip.bundle.solve import SolvedBlock
from orip.bundle.verdict import group_findings
from orip.errors import ProjectWarning
from orip.mistakes.ground_systems import control_heights
from orip.mistakes.hypothesis import DECIDED, Misfit, Readjuster, fit_of_adjustment, is_good
from orip.mistakes.mistake import BAD_START, Consequence, declare
from orip.records.block import Block
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.units import METRES_PER_GROUND_UNIT
from orip.wording import agreeing, counted_names

LOOKING_UP = declare("looking-up", "photos look up from below the ground", BAD_START)
REDUCED = declare("reduced-photo", "photos of one camera fly at different heights", BAD_START)
HEIGHT_UNIT = declare(
    "height-unit", "Z of the control is in another unit", BAD_START, Consequence(groups=("camera", "control point"))
)

_VERTICAL = 0.8
"""Cosine of the angle to the vertical up to which a photo looks down, or up: 37 degrees."""

_MOST = 0.8
"""Part of the photos that has to be vertical."""

_FEWEST = 3
"""Control points without which nothing says where above and below are."""

_SHARED = 3
"""Points that photos from above and from below have to share: of a solid object they share none."""

_FARTHEST_CEILING = 50.0
"""Metres up to which a ceiling may be photographed from below; farther away nothing is."""

_FACTORS = (2.0, 4.0)
"""Of reduced pictures."""

_SIMILAR = 1.2
"""Ratio up to which heights over the points are the same."""

_FEWEST_POINTS = 5
"""Points of a photo that all lie in one quarter by chance with a probability of a thousandth."""

_SUSPECTED = 3.0
"""Difference of costs at which heights in another unit are likelier than a lens that is far off: of all factors only
that of feet and metres is tried, while C may be anything."""

_OTHER_LENS = 0.2
"""Part of C by which no lens is off."""

_EDGE = 1.01
"""Tolerance at the edge of a reduced picture."""


def misread_vertical_photos(misfit: Misfit) -> list[ProjectWarning]:
    """Return what is probably mistaken in a block of vertical photos over nearly flat ground; often nothing."""
    block = misfit.solved.block
    known = [point for point in block.control_points if not point.rejected and None not in point.coordinates]
    cosines = misfit.solved.state.rotations[:, 2, 2]
    if len(known) < _FEWEST or block.is_free_network or not np.mean(np.abs(cosines) > _VERTICAL) >= _MOST:
        return []
    trials = _Trials(misfit.solution, misfit.solved, misfit.readjuster)
    if (cosines < -_VERTICAL).any():
        return trials.of_photos_looking_up(cosines < -_VERTICAL, cosines > _VERTICAL)
    return trials.of_reduced_photos() or trials.of_heights()


class _Trials(Struct, frozen=True):
    """Readings of a block, adjusted and compared with the one that was given."""

    solution: Solution
    solved: SolvedBlock
    readjuster: Readjuster

    def of_photos_looking_up(self, up: BoolArray, down: BoolArray) -> list[ProjectWarning]:
        """Return what is probably wrong where photos look up: all, or some that see what others see from above."""
        names = [photo.name for photo, mine in zip(self.solved.block.photos, up, strict=True) if mine]
        if down.any():
            # of a thin sheet near by both sides may be photographed
            least = -DECIDED if self._distance() > _FARTHEST_CEILING else DECIDED
            if not self._share_points(up, down) or not self._gain(_mirrored(self.readjuster.block, names)) > least:
                return []
            it = agreeing(len(names), "it is a mirror image", "they are mirror images")
            text = (
                f"{it}: rows seem to count upwards, or columns from the right, or film was scanned from its back; "
                "correct the POINTS lines. As given, the adjustment puts the camera below the ground, looking up at "
                "points that the other photos see from above"
            )
            return [ProjectWarning(LOOKING_UP, counted_names("photo", names), text)]
        gain = self._gain(_mirrored(self.readjuster.block, names))
        if gain < -DECIDED:
            return []
        if gain < DECIDED and not self._distance() > _FARTHEST_CEILING:
            return []
        better = "better" if gain > DECIDED else "as well"
        text = (
            "pixel rows seem to count upwards (they count down from the upper edge), or X and Y of the control are "
            "exchanged (north, east in place of X = east, Y = north), or film was scanned from its back: as given, the "
            f"adjustment puts all cameras below the control, looking up, and mirror images fit {better}, from above. "
            "Look at the columns X and Y of the control file first"
        )
        return [ProjectWarning(LOOKING_UP, "photos", text)]

    def of_reduced_photos(self) -> list[ProjectWarning]:
        """Return which photos were measured in reduced pictures: higher than the others, with points in one corner."""
        block = self.solved.block
        reached = _reached(block)
        if not (reached < _EDGE / min(_FACTORS)).any():
            return []
        heights = _heights(self.solved)
        for row in range(len(block.cameras)):
            of_camera = block.photo_camera == row
            for factor in _FACTORS:
                reduced = of_camera & (reached < _EDGE / factor)
                others = of_camera & ~reduced & np.isfinite(heights)
                if not reduced.any() or not others.any():
                    continue
                ratio = np.median(heights[reduced]) / np.median(heights[others]) / factor
                names = [photo.name for photo, mine in zip(block.photos, reduced, strict=True) if mine]
                if not 1.0 / _SIMILAR < ratio < _SIMILAR:
                    continue
                if not self._gain(_enlarged(self.readjuster.block, names, factor)) > -DECIDED:
                    continue
                text = (
                    f"{agreeing(len(names), 'it seems', 'they seem')} to be measured at a lower resolution: measure "
                    f"the picture in its full size, or multiply columns and rows by {factor:g}. As given, the camera "
                    f"flies {ratio * factor:.2g} times as high as for the other photos of {block.cameras[row].name}, "
                    "and all points lie in the upper left corner of the picture"
                )
                return [ProjectWarning(REDUCED, counted_names("photo", names), text)]
        return []

    def of_heights(self) -> list[ProjectWarning]:
        """Return that the control's Z is in another unit, where control or photos fit badly, and then well."""
        fits = is_good(fit_of_adjustment(self.solved)) and not group_findings(self.solution)
        if fits or self.readjuster.is_oriented:
            return []
        found = [(self._gain(tried.block), tried) for tried in control_heights(self.readjuster.block)]
        gain, best = max(found, key=lambda each: each[0], default=(-np.inf, None))
        if best is None or not gain > (_SUSPECTED if self._accuses_lens() else DECIDED):
            return []
        adjusted = self.readjuster.adjust(best.block)
        if adjusted is None or not is_good(fit_of_adjustment(adjusted)):
            return []
        return [replace(found, code=HEIGHT_UNIT) for found in best.findings(adjusted)]

    def _accuses_lens(self) -> bool:
        """Tell whether C is said to be off by more than any lens: heights in another unit have the same effect."""
        given = {camera.name: camera.parameters[0] for camera in self.solved.block.cameras}
        return any(
            group.doubted and group.component == "C" and abs(group.shift) > _OTHER_LENS * given.get(group.worst, np.inf)
            for group in self.solution.groups
        )

    def _gain(self, block: Block) -> float:
        """Return by how much the cost is lower with another reading; minus infinity where it cannot be adjusted."""
        if not self.readjuster.is_worthwhile:
            return -np.inf
        adjusted = self.readjuster.adjust(block)
        if adjusted is None or not adjusted.converged:
            return -np.inf
        weighing = self.solved.weighing
        return weighing.cost(self.solved.equations) - weighing.cost(adjusted.equations)

    def _share_points(self, one: BoolArray, other: BoolArray) -> bool:
        points = self.solved.block.photo_points
        seen = [np.bincount(points.point[points.in_use & chosen[points.photo]]) for chosen in (one, other)]
        both = min(len(seen[0]), len(seen[1]))
        return int(np.count_nonzero((seen[0][:both] > 0) & (seen[1][:both] > 0))) >= _SHARED

    def _distance(self) -> float:
        """Return how far the cameras are from their points in height, metres."""
        return float(np.nanmedian(np.abs(_heights(self.solved)))) * METRES_PER_GROUND_UNIT.get(
            self.solved.block.ground_unit, 1.0
        )


def _heights(solved: SolvedBlock) -> FloatArray:
    """Return the heights (number of photos,) of the cameras above the middle of their points; NaN without points."""
    points, state = solved.block.photo_points, solved.state
    heights, in_use = np.full(len(solved.block.photos), np.nan), points.in_use
    for photo, rows in enumerate(rows_of_groups(points.photo, len(heights))):
        mine = points.point[rows[in_use[rows]]]
        if len(mine):
            heights[photo] = state.centres[photo, 2] - np.median(state.points[mine, 2])
    return heights


def _reached(block: Block) -> FloatArray:
    """Return the farthest column or row (number of photos,) of the points, as a part of those of the sensor.

    Infinite without a sensor, or with fewer points than tell it.
    """
    points, count = block.photo_points, len(block.photos)
    sizes = np.array([(np.nan, np.nan) if of.sensor is None else of.sensor.size for of in block.cameras])
    if np.isnan(sizes).all():
        return np.full(count, np.inf)
    size = sizes[block.photo_camera[points.photo]]
    parts = np.maximum(*(np.abs(points.xy - size * [-0.5, 0.5]) / size).T)
    reached = np.zeros(count)
    np.maximum.at(reached, points.photo, np.where(np.isfinite(parts), parts, np.inf))
    reached[np.bincount(points.photo, minlength=count) < _FEWEST_POINTS] = np.inf
    return reached


def _of_photos(block: Block, names: list[str]) -> Iterator[tuple[int, IntArray]]:
    for photo, record in enumerate(block.photos):
        if record.name in names:
            yield photo, np.flatnonzero(block.photo_points.photo == photo)


def _mirrored(block: Block, names: list[str]) -> Block:
    """Return a block with the opposite sign of y in some photos, which have no orientation any more."""
    xy, orientation = block.photo_points.xy.copy(), block.photo_orientation.copy()
    for photo, rows in _of_photos(block, names):
        xy[rows] *= [1.0, -1.0]
        orientation[photo] = np.nan
    return replace(block, photo_points=replace(block.photo_points, xy=xy), photo_orientation=orientation)


def _enlarged(block: Block, names: list[str], factor: float) -> Block:
    """Return a block with the pixels of some photos multiplied by a factor."""
    xy, orientation = block.photo_points.xy.copy(), block.photo_orientation.copy()
    for photo, rows in _of_photos(block, names):
        sensor = block.cameras[block.photo_camera[photo]].sensor
        assert sensor is not None, "the photo has pixels"
        corner = np.array([-sensor.width, sensor.height]) / 2.0
        xy[rows] = (xy[rows] - corner) * factor + corner
        orientation[photo] = np.nan
    return replace(block, photo_points=replace(block.photo_points, xy=xy), photo_orientation=orientation)
