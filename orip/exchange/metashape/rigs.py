"""Multi-camera systems of Metashape: slave sensors on a master, and the cameras that took photos with their master.

A slave sensor has ``master_id``, and its axes and place in the axes of the master, both y down, z forward, in the unit
of the chunk. A slave camera has ``master_id``, and in most documents no transform of its own: it is where its master
and its sensor have it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.exchange.sources.xml_tree import PlacedElement, XmlEdit, XmlElement, XmlFields, is_true
from orip.records.exchanged import ExchangedExposure, ExchangedMounting, ExchangedProject, ExchangedRig
from orip.wording import counted_names

_FIXED = ("fixed_location", "fixed_rotation")


def slave_matrix(sensor: XmlElement, fields: XmlFields) -> FloatArray | None:
    """Return the matrix (4, 4) from a slave sensor's axes to its master's; None where the document has none."""
    if sensor.child("rotation") is None or sensor.child("translation") is None:
        return None
    rotation, translation = fields.decimals(sensor, "rotation", 9), fields.decimals(sensor, "translation", 3)
    if rotation is None or translation is None:
        return None
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = np.array(rotation).reshape(3, 3), translation
    return found


def is_rolling(sensor: XmlElement) -> bool:
    """Tell whether Metashape compensates the rolling shutter of a sensor."""
    return is_true(_property(sensor, "rolling_shutter"), missing=False)


def rigs_of_sensors(sensors: Sequence[tuple[str, XmlElement]], places: Mapping[str, int]) -> tuple[ExchangedRig, ...]:
    """Return a rig for each master sensor; slaves are held where location and rotation are fixed."""
    slaves: dict[str, list[ExchangedMounting]] = {}
    for key, sensor in sensors:
        master = sensor.attributes.get("master_id", key)
        if key in places and master in places and master != key:
            is_held = all(is_true(_property(sensor, name), missing=False) for name in _FIXED)
            slaves.setdefault(master, []).append(ExchangedMounting(places[key], is_held=is_held))
    labels = {key: sensor.attributes.get("label", "") for key, sensor in sensors}
    return tuple(
        ExchangedRig(labels[master] or "RIG", (ExchangedMounting(places[master]), *others))
        for master, others in slaves.items()
    )


def exposures_of_cameras(cameras: Iterator[XmlElement], photos: Mapping[str, int]) -> tuple[ExchangedExposure, ...]:
    """Return the photos that slave cameras took with their master, by the places of photos by their ids."""
    groups: dict[str, list[int]] = {}
    for camera in cameras:
        key = camera.attributes.get("id", "")
        if key in photos:
            groups.setdefault(camera.attributes.get("master_id", key), []).append(photos[key])
    return tuple(
        ExchangedExposure(f"E{master}", tuple(members)) for master, members in groups.items() if len(members) > 1
    )


def _property(sensor: XmlElement, name: str) -> str | None:
    found = (item.attributes.get("value") for item in sensor.all("property") if item.attributes.get("name") == name)
    return next(found, None)


def mounted_on(project: ExchangedProject, camera: int, master: int) -> FloatArray | None:
    """Return the matrix (4, 4) from a camera's axes to those of another one on its rig; None if there is none."""
    for rig in project.rigs:
        poses = {one.camera: one for one in rig.mountings if one.rotation and one.offset}
        if camera in poses and master in poses:
            return np.asarray(np.linalg.inv(_matrix(poses[master])) @ _matrix(poses[camera]))
    return None


def _matrix(mounting: ExchangedMounting) -> FloatArray:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = np.reshape(mounting.rotation, (3, 3)), mounting.offset
    return found


def masters_of_photos(project: ExchangedProject) -> dict[int, int]:
    """Return by the places of photos of a rig the photo of its reference camera, of the same exposure."""
    reference = {one.camera: rig.mountings[0].camera for rig in project.rigs for one in rig.mountings}
    found: dict[int, int] = {}
    for exposure in project.exposures:
        of = {project.photos[n].camera: n for n in exposure.photos if project.photos[n].rotation}
        for camera, photo in of.items():
            master = of.get(reference.get(camera, camera))
            if master is not None and master != photo:
                found[photo] = master
    return found


def mount(edit: XmlEdit, sensor: PlacedElement, matrix: FloatArray, scale: float) -> None:
    """Give a slave sensor of a document its mounting (4, 4), ground unit; the chunk's are `scale` of these."""
    rotation, translation = (next(sensor.all(tag), None) for tag in ("rotation", "translation"))
    if rotation is not None and translation is not None:
        edit.replace(rotation, matrix[:3, :3].ravel().tolist())
        edit.replace(translation, (matrix[:3, 3] / scale).tolist())


def require_rigs(project: ExchangedProject, found: Sequence[tuple[str, PlacedElement]], path: Path) -> None:
    """Refuse a document whose slave cameras have no transform where the result has them on no rig.

    Parameters
    ----------
    project : ExchangedProject
        The result.
    found : sequence of (str, PlacedElement)
        Cameras of the document with their labels.

    Raises
    ------
    InputError
    """
    of_rig = {project.photos[n].name for n in masters_of_photos(project)}
    lost = [
        label
        for label, element in found
        if "master_id" in element.attributes and label not in of_rig and not any(element.all("transform"))
    ]
    if lost:
        message = (
            f"{counted_names('camera', lost)} of the multi-camera system in the original have no place of their own, "
            "and are of no exposure with their master in the result; export another format, or keep [[rig]] and "
            "[[exposure]] in orip.toml"
        )
        raise InputError.single(message, str(path))
