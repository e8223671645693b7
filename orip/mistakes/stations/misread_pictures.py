"""Single photos whose position seems wrong because their picture is turned by 180°, or taken with another zoom.

Such a photo fits the others: it is turned back, or rises and sinks. Its position alone shows the mistake.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Findings, Readjuster, finding
from orip.mistakes.misread_photos import TURNED
from orip.mistakes.mistake import Consequence, declare
from orip.mistakes.stations.contradicting_positions import CODE, contradicting_positions
from orip.mistakes.stations.doubted_camera import is_better
from orip.records.block import Block
from orip.structs import replace

_OTHER_ZOOM = declare("other-zoom", "", Consequence(warnings=("points-outside",), of_same_photo=True))

_MOST = 3
"""Positions of which a picture is tried."""

_OTHER_LENS = 0.005
"""Difference of principal distances, as a part of these, that is another zoom."""


def pictures_instead_of_positions(
    found: Sequence[ProjectWarning], solved: SolvedBlock, readjuster: Readjuster
) -> list[ProjectWarning]:
    """Return warnings of positions, of which those that a wrong picture explains are warnings of the photo.

    Parameters
    ----------
    found : sequence of ProjectWarning
        Of single positions.
    solved : SolvedBlock
        The adjustment that they come from.
    readjuster : Readjuster
        Of the block as gathered.
    """
    single = [warning for warning in found if warning.code == CODE and warning.where.startswith("exposure station ")]
    if not readjuster.is_worthwhile or len(single) > _MOST:
        return list(found)
    return [_of_picture(warning, solved, readjuster) if warning in single else warning for warning in found]


def _of_picture(warning: ProjectWarning, solved: SolvedBlock, readjuster: Readjuster) -> ProjectWarning:
    name = warning.where.removeprefix("exposure station ")
    names = [photo.name for photo in readjuster.block.photos]
    if name not in names or "check it" not in warning.text:
        return warning  # a slip in writing explains it
    for block, findings in (*_turned(readjuster.block, names.index(name)), *_zoomed(solved, readjuster.block, name)):
        tried = readjuster.adjust(block)
        if tried is None or not is_better(tried, solved):
            continue
        still = {said.where for said in contradicting_positions(solution_of(tried))}
        if warning.where not in still and (said := findings(tried)):
            return said[0]
    return warning


def _turned(block: Block, photo: int) -> Iterator[tuple[Block, Findings]]:
    """Yield the picture of a photo turned by 180°."""
    sensor = block.cameras[block.photo_camera[photo]].sensor
    if sensor is None:
        return
    rows = block.photo_points.photo == photo
    xy = block.photo_points.xy.copy()
    xy[rows] *= -1.0
    orientation = block.photo_orientation.copy()
    orientation[photo] = np.nan
    text = (
        "it fits when its picture is turned by 180°, and its position fits then, too; turn it as the others are, and "
        f"measure it again (or write {sensor.columns} - column and {sensor.rows} - row)"
    )
    changed = replace(block, photo_points=replace(block.photo_points, xy=xy), photo_orientation=orientation)
    yield changed, finding(TURNED, f"photo {block.photos[photo].name}", text)


def _zoomed(solved: SolvedBlock, block: Block, name: str) -> Iterator[tuple[Block, Findings]]:
    """Yield a photo with a principal distance of its own."""
    photo = [record.name for record in block.photos].index(name)
    row = int(block.photo_camera[photo])
    own = block.cameras[row]
    place = [camera.name for camera in solved.block.cameras].index(own.name)
    values = solved.state.cameras[place].tolist()
    copy = replace(own, name=f"{own.name}_{name}", parameters=tuple(values), unknown=("C",))
    photo_camera = block.photo_camera.copy()
    photo_camera[photo] = len(block.cameras)
    changed = replace(block, cameras=(*block.cameras, copy), photo_camera=photo_camera)

    def findings(tried: SolvedBlock) -> list[ProjectWarning]:
        c = float(tried.state.cameras[[camera.name for camera in tried.block.cameras].index(copy.name), 0])
        if abs(c / values[0] - 1.0) < _OTHER_LENS:
            return []
        text = (
            f"its position fits with C = {c:.4g} mm, and the other photos have {values[0]:.4g} mm: it was taken with "
            "another zoom, or its picture was cropped or enlarged; give it a [[camera]] of its own, or leave it out"
        )
        return [ProjectWarning(_OTHER_ZOOM, f"photo {name}", text)]

    yield changed, findings
