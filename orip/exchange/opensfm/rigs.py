"""Rigs of OpenSfM: cameras of a rig (``rig_cameras``), and what they took together (``rig_instances``).

A shot has the pose rig camera · instance, both from ground, or rig, to camera. The file names no rigs: cameras of a rig
that were ever together are one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.conversion.poses import rotation_vectors
from orip.exchange.sources.collected import together
from orip.exchange.sources.json_tree import JsonValue
from orip.files.text.shown import shown_token
from orip.geometry.rotation import rotation_about_axes
from orip.records.exchanged import (
    ExchangedCamera,
    ExchangedExposure,
    ExchangedMounting,
    ExchangedPhoto,
    ExchangedProject,
    ExchangedRig,
)
from orip.structs import replace

_SAME = 1e-11
"""Relative; numbers that were written and read again differ by less."""

_Key = tuple[str, int]
"""A camera of a rig, and the place of the camera that it is."""


class RigReader:
    """Gives a reconstruction's photos their rigs.

    Parameters
    ----------
    part : JsonValue
        The reconstruction.

    Attributes
    ----------
    cameras, photos : tuples
        As before, except that each camera of a rig is a camera of its own.
    """

    def __init__(self, part: JsonValue, cameras: Sequence[ExchangedCamera], photos: Sequence[ExchangedPhoto]) -> None:
        self.cameras, self.photos = tuple(cameras), tuple(photos)
        self.rigs: tuple[ExchangedRig, ...] = ()
        self.exposures: tuple[ExchangedExposure, ...] = ()
        instances = self._instances(part)
        bodies = together([list(members.values()) for members in instances.values()])
        if not bodies:
            return
        place = self._separate(bodies, instances)
        self.rigs = tuple(
            ExchangedRig(f"RIG{n}", tuple(ExchangedMounting(place[key]) for key in body))
            for n, body in enumerate(bodies, start=1)
        )
        self.exposures = tuple(
            ExchangedExposure(name, tuple(members))
            for name, members in instances.items()
            if any(key in place for key in members.values())
        )

    def _instances(self, part: JsonValue) -> dict[str, dict[int, _Key]]:
        """Return by the names of instances the photos of each, with their cameras of the rig."""
        found: dict[str, dict[int, _Key]] = {}
        known = {photo.name: n for n, photo in enumerate(self.photos)}
        taken: set[int] = set()
        instances = part.get("rig_instances")
        for name, instance in instances.entries() if instances is not None else ():
            ids = instance.get("rig_camera_ids")
            for shot, rig_camera in ids.entries() if ids is not None else ():
                photo = known.get(shot)
                if photo is None:
                    continue
                if type(rig_camera.value) is not str:
                    rig_camera.complain("the name of a camera of a rig should be here; export it again")
                    continue
                if photo in taken:
                    rig_camera.complain(f"shot '{shown_token(shot)}' is of two instances; export it again")
                taken.add(photo)
                found.setdefault(name, {})[photo] = (rig_camera.value, self.photos[photo].camera)
        return found

    def _separate(
        self, bodies: Sequence[Sequence[_Key]], instances: Mapping[str, Mapping[int, _Key]]
    ) -> dict[_Key, int]:
        """Return the place of the camera of each camera of a rig; one that two of them share becomes two."""
        cameras, place = list(self.cameras), {}
        used: set[int] = set()
        for key in (key for body in bodies for key in body):
            camera = key[1]
            if camera in used:
                cameras.append(replace(cameras[camera], name=f"{cameras[camera].name} {key[0]}"))
                place[key] = len(cameras) - 1
            else:
                place[key] = camera
            used.add(camera)
        photos = list(self.photos)
        for members in instances.values():
            for photo, key in members.items():
                photos[photo] = replace(photos[photo], camera=place.get(key, key[1]))
        self.cameras, self.photos = tuple(cameras), tuple(photos)
        return place


def matrix_of(owner: Mapping[str, Any]) -> FloatArray | None:
    """Return the pose (4, 4) of a shot, an instance or a camera of a rig; None where it has none."""
    parts = [owner.get("rotation"), owner.get("translation")]
    numbers = [one for part in parts if isinstance(part, list) and len(part) == 3 for one in part]
    if len(numbers) != 6 or not all(isinstance(one, int | float) and math.isfinite(one) for one in numbers):
        return None
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation_about_axes(np.array([numbers[:3]], dtype=np.float64))[0], numbers[3:]
    return found


def set_matrix(owner: dict[str, Any], pose: FloatArray) -> None:
    """Give a shot, an instance or a camera of a rig a pose (4, 4); what it says already stays as it is written."""
    owner["rotation"] = as_written(owner.get("rotation"), rotation_vectors(pose[None, :3, :3])[0].tolist())
    owner["translation"] = as_written(owner.get("translation"), pose[:3, 3].tolist())


def set_rigs(part: dict[str, Any], project: ExchangedProject) -> None:
    """Put the rigs of a project into a reconstruction whose shots have their poses.

    Instances and cameras of rigs keep their names, and the first camera of a rig its pose. A shot that is of no
    exposure any more is an instance of its own.
    """
    rig_cameras, before = _table(part.get("rig_cameras")), _table(part.get("rig_instances"))
    if not project.rigs and not any(len(_members(one)) > 1 for one in before.values()):
        return
    part["rig_cameras"] = rig_cameras
    instance_of = {shot: (name, key) for name, one in before.items() for shot, key in _members(one).items()}
    of_camera = _set_mountings(rig_cameras, project, instance_of)
    instances: dict[str, Any] = {}
    done: set[str] = set()
    for exposure in project.exposures:
        shots = [name for n in exposure.photos if (name := project.photos[n].name) in part["shots"]]
        cameras = {
            name: of_camera[project.photos[n].camera]
            for n in exposure.photos
            if (name := project.photos[n].name) in shots and project.photos[n].camera in of_camera
        }
        if len(cameras) == len(shots) and shots:
            named = [instance_of[shot][0] for shot in shots if shot in instance_of]
            _add_instance(part, instances, named[0] if named else exposure.name, cameras, before)
            done |= set(shots)
    camera_of = {photo.name: photo.camera for photo in project.photos}
    for shot in part["shots"]:
        if shot not in done:
            own = of_camera.get(camera_of.get(shot, -1), str(part["shots"][shot].get("camera")))
            rig_cameras.setdefault(own, _in_its_place())
            _add_instance(part, instances, instance_of.get(shot, (shot, ""))[0], {shot: own}, before)
    part["rig_instances"] = instances


def _table(value: object) -> dict[str, Any]:
    return {key: one for key, one in value.items() if isinstance(one, dict)} if isinstance(value, dict) else {}


def _members(instance: object) -> dict[str, str]:
    ids = instance.get("rig_camera_ids") if isinstance(instance, dict) else None
    return {shot: str(key) for shot, key in ids.items()} if isinstance(ids, dict) else {}


def _set_mountings(
    rig_cameras: dict[str, Any], project: ExchangedProject, instance_of: Mapping[str, tuple[str, str]]
) -> dict[int, str]:
    """Return the names of the cameras of rigs by the places of cameras, after these have the project's mountings."""
    names: dict[int, str] = {}
    for photo in project.photos:
        if photo.name in instance_of:
            names.setdefault(photo.camera, instance_of[photo.name][1])
    found: dict[int, str] = {}
    for rig in project.rigs:
        own = [names.get(one.camera, project.cameras[one.camera].name) for one in rig.mountings]
        base = matrix_of(rig_cameras.setdefault(own[0], _in_its_place()))
        for name, one in zip(own, rig.mountings, strict=True):
            found[one.camera] = name
            mounted = rig_cameras.setdefault(name, _in_its_place())
            if not one.rotation or not one.offset or one is rig.mountings[0] or base is None:
                continue
            to_reference = np.eye(4)
            to_reference[:3, :3], to_reference[:3, 3] = np.reshape(one.rotation, (3, 3)), one.offset
            set_matrix(mounted, np.linalg.inv(to_reference) @ base)
    return found


def _in_its_place() -> dict[str, Any]:
    """Return a camera of a rig that is where the rig is."""
    return {"rotation": [0.0] * 3, "translation": [0.0] * 3}


def _add_instance(
    part: Mapping[str, Any], instances: dict[str, Any], name: str, cameras: Mapping[str, str], before: Mapping[str, Any]
) -> None:
    """Add an instance where its first shot has it."""
    shot, rig_camera = next(iter(cameras.items()))
    name = name if name not in instances else shot
    own, pose = matrix_of(part["rig_cameras"][rig_camera]), matrix_of(part["shots"][shot])
    found = {**before.get(name, {})}
    if own is not None and pose is not None:
        set_matrix(found, np.linalg.inv(own) @ pose)
    instances[name] = {**found, "rig_camera_ids": dict(cameras)}


def as_written(old: Any, new: Any) -> list[float]:
    """Return the old numbers if the new ones are equal up to rounding."""
    return list(old) if is_same(old, new) else list(new)


def is_same(old: Any, new: Any) -> bool:
    """Return whether numbers are equal up to rounding."""
    if not isinstance(old, list) or len(old) != len(new) or not all(isinstance(one, int | float) for one in old):
        return False
    size = max(1.0, *(abs(value) for value in new))
    return all(abs(first - second) <= _SAME * size for first, second in zip(old, new, strict=True))
