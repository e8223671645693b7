"""A photo under the name of another camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from orip.bundle.antennas import without_unused_cameras
from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.records.project.camera import Camera
from orip.structs import replace


def other_cameras(block: Block, photos: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield photos with every other camera of the project that, like their own, has a sensor or has none.

    Parameters
    ----------
    block : Block
    photos : sequence of str
        Those that do not fit.
    """
    rows = {photo.name: row for row, photo in enumerate(block.photos)}
    for name in photos:
        own = block.cameras[block.photo_camera[rows[name]]]
        for camera in block.defined_cameras:
            if camera.name == own.name or (camera.sensor is None) != (own.sensor is None):
                continue
            text = (
                f"it fits with camera {camera.name}, and not with {own.name}; write "
                f'camera = "{camera.name}" in its [[photo]]'
            )
            changed = _with_camera_of_photo(block, rows[name], camera)
            yield Hypothesis(changed, finding("other-camera", f"photo {name}", text))


def _with_camera_of_photo(block: Block, photo: int, camera: Camera) -> Block:
    names = [known.name for known in block.cameras]
    cameras = block.cameras if camera.name in names else (*block.cameras, camera)
    photo_camera = block.photo_camera.copy()
    photo_camera[photo] = [known.name for known in cameras].index(camera.name)
    return without_unused_cameras(replace(block, cameras=cameras, photo_camera=photo_camera))
