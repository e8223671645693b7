"""A result for a copy of its original: in the original's ground frame, with its cameras where they have not changed."""

from __future__ import annotations

from pathlib import Path

from orip.conversion.cameras import convert_camera, export_camera
from orip.conversion.ground import from_local_ground, local_ground
from orip.conversion.unsuitable_cameras import UnsuitableCameraError
from orip.errors import InputError
from orip.exchange.format import Format
from orip.records.exchanged import ExchangedCamera, ExchangedProject
from orip.structs import replace

_SAME = 1e-9
"""Relative to the focal length, of parameters that were converted twice and written as texts."""


def in_terms_of(project: ExchangedProject, found: Format, original: Path) -> ExchangedProject:
    """Return a result as a copy of its original needs it.

    A camera that orip does not hold exactly would come back as the nearest one of orip; it comes back as it was unless
    the adjustment has changed it.

    Raises
    ------
    InputError
        If the original is damaged.
    """
    if found.read is None:
        return project
    parsed = found.read(original, str(original))
    source = parsed.value
    if source is None:
        raise InputError(parsed.complaints)
    given = {camera.name: camera for camera in source.cameras}
    cameras = tuple(
        given[camera.name] if camera.name in given and _is_unchanged(camera, given[camera.name], found) else camera
        for camera in project.cameras
    )
    project = replace(project, cameras=cameras)
    ground = local_ground(source) if source.frame.kind == "geocentric" and project.crs is None else None
    return project if ground is None else from_local_ground(project, ground, source.control_crs)


def _is_unchanged(camera: ExchangedCamera, given: ExchangedCamera, found: Format) -> bool:
    """Return whether a camera is what an import and an export make of a given one."""
    conventions = found.conventions
    if conventions is None or camera.lens not in (conventions.lens, conventions.fisheye_lens):
        return False
    terms = conventions.terms if camera.lens == conventions.lens else conventions.fisheye_terms
    try:
        converted = convert_camera(given, given.name, accepts_any_fit=True).camera
        there = export_camera(
            converted, given.name, camera.lens, given.lens_axes, given.ray_axes, terms=terms, accepts_any_fit=True
        ).camera
    except UnsuitableCameraError:
        return False
    size = max(abs(value) for value in there.parameters.values())
    return all(
        abs(camera.parameters.get(name, 0.0) - value) <= _SAME * (1.0 if abs(value) < 1.0 else size)
        for name, value in there.parameters.items()
    )
