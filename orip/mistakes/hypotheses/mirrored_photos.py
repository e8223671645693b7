"""Photo coordinates that count the other way: rows upwards, columns from the right, film seen from its back."""

from __future__ import annotations

from collections.abc import Iterator

from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding, photos_stay_near
from orip.mistakes.photo_readings import exchanged_axes
from orip.records.block import Block
from orip.records.project.camera import Camera
from orip.structs import replace

_X, _Y = 0, 1

_EXCHANGED = "x and y seem to be exchanged; write x, to the right, first, and y upwards"


def mirrored_photos(block: Block) -> Iterator[Hypothesis]:
    """Yield the photos of each camera with the opposite sign of y, of x, and with x and y exchanged."""
    for row, camera in enumerate(block.cameras):
        of_camera = block.photo_camera[block.photo_points.photo] == row
        for axis in (_Y, _X):
            xy = block.photo_points.xy.copy()
            xy[of_camera, axis] *= -1.0
            changed = replace(block, photo_points=replace(block.photo_points, xy=xy))
            text = f"the photos fit as mirror images: {_text(camera, axis)}"
            yield Hypothesis(changed, finding("mirrored", f"camera {camera.name}", text), photos_stay_near)
        xy = block.photo_points.xy.copy()
        xy[of_camera] = xy[of_camera, ::-1] if camera.sensor is None else exchanged_axes(xy[of_camera], camera.sensor)
        changed = replace(block, photo_points=replace(block.photo_points, xy=xy))
        text = f"the photos fit as mirror images: {_EXCHANGED}"
        yield Hypothesis(changed, finding("mirrored", f"camera {camera.name}", text), photos_stay_near)


def _text(camera: Camera, axis: int) -> str:
    if camera.sensor is None:
        left = "x seems to count to the left, as on film seen from its back"
        way = "y seems to count downwards" if axis == _Y else left
        return f"{way}; reverse it, or name the fiducial marks as in the camera's record"
    if axis == _Y:
        return (
            f"pixel rows seem to count upwards; rows count down from the upper edge (write {camera.sensor.rows} - row)"
        )
    return (
        "pixel columns seem to count from the right; columns count from the left edge "
        f"(write {camera.sensor.columns} - column)"
    )
