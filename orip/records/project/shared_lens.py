"""Cameras that have the same lens: principal distance and distortion are common, principal points their own.

`same_lens_as` of a camera names the one whose lens it has. What the lens determines is given, adjusted and updated
there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from orip.records.names import record_key
from orip.records.project.camera import CAMERA_PARAMETERS, OWN_PARAMETERS, Camera
from orip.structs import replace

LENS_PLACES = tuple(place for place, name in enumerate(CAMERA_PARAMETERS) if name not in OWN_PARAMETERS)
"""Places of the lens's parameters among those of a camera."""


def lens_key(camera: Camera) -> str:
    """Return the `record_key` of the camera that a camera's lens is given with."""
    return record_key(camera.same_lens_as or camera.name)


def first_of_lens(cameras: Sequence[Camera]) -> list[int]:
    """Return for each camera the place of the first one with the same lens."""
    first: dict[str, int] = {}
    return [first.setdefault(lens_key(camera), place) for place, camera in enumerate(cameras)]


def with_lens_of(camera: Camera, lens: Camera) -> Camera:
    """Return a camera with the principal distance and distortion of another one."""
    parameters, own = list(camera.parameters), set(camera.unknown) & set(OWN_PARAMETERS)
    for place in LENS_PLACES:
        parameters[place] = lens.parameters[place]
    unknown = own | (set(lens.unknown) - set(OWN_PARAMETERS))
    return replace(
        camera,
        parameters=tuple(parameters),
        distortion_at=lens.distortion_at,
        projection=lens.projection,
        distortion_isp=lens.distortion_isp,
        distortion_curve=lens.distortion_curve,
        unknown=tuple(name for name in CAMERA_PARAMETERS if name in unknown),
    )


def with_shared_lenses(cameras: Iterable[Camera]) -> tuple[Camera, ...]:
    """Return the cameras; those that name another one have its lens, or their own where that one is missing."""
    every = tuple(cameras)
    by_name = {record_key(camera.name): camera for camera in every}
    return tuple(
        with_lens_of(camera, by_name[lens_key(camera)])
        if camera.same_lens_as is not None and lens_key(camera) in by_name
        else camera
        for camera in every
    )


def without_lens(camera: Camera) -> Camera:
    """Return a camera as its record is written: without what its lens determines if it names another camera's lens."""
    own = tuple(name for name in camera.unknown if name in OWN_PARAMETERS)
    parameters = list(camera.parameters)
    for place in LENS_PLACES:
        parameters[place] = 0.0
    return replace(
        camera,
        parameters=tuple(parameters),
        distortion_at="ideal",
        projection="perspective",
        distortion_isp=None,
        distortion_curve=None,
        unknown=own,
    )
