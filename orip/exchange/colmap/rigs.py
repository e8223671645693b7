"""Rigs and frames of COLMAP 4 as orip's rigs with their exposures, and back.

An image has the pose that its frame and its sensor give it: camera from world = sensor from rig · rig from world. The
frame of the reference sensor is that of the rig.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.colmap.model import CAMERA_SENSOR, IDENTITY, ColmapFrame, ColmapImage, ColmapModel, ColmapRig, Pose
from orip.exchange.conversion.poses import quaternions_from_rotations, rotations_from_quaternions
from orip.records.exchanged import ExchangedExposure, ExchangedMounting, ExchangedProject, ExchangedRig
from orip.structs import replace

_SAME_POSE = 1e-11
"""Of a quaternion and, relative to its size, of a translation: angles and centres were written and read again."""

_ROUNDED_POSE = 1e-6
"""The same of numbers that another program has printed."""


def with_poses_of_frames(model: ColmapModel) -> ColmapModel:
    """Return the model with images where frames and sensors have them, as COLMAP does; rounded digits stay."""
    sensor_poses = {sensor: pose for rig in model.rigs for sensor, pose in zip(rig.sensors, rig.poses, strict=True)}
    wanted: dict[int, Pose] = {}
    for frame in model.frames:
        for kind, sensor, image in frame.data:
            pose = sensor_poses.get((kind, sensor))
            if kind == CAMERA_SENSOR and pose is not None:
                wanted[image] = frame.pose if pose == IDENTITY else composed(pose, frame.pose)
    images = tuple(
        replace(image, pose=wanted[image.id])
        if image.id in wanted and not is_same_pose(wanted[image.id], image.pose, _ROUNDED_POSE)
        else image
        for image in model.images
    )
    return replace(model, images=images)


def exchanged_rigs(model: ColmapModel) -> tuple[tuple[ExchangedRig, ...], tuple[ExchangedExposure, ...]]:
    """Return the rigs with several cameras that took photos together, and their frames; COLMAP estimates mountings."""
    camera_place = {camera.id: n for n, camera in enumerate(model.cameras)}
    image_place = {image.id: n for n, image in enumerate(model.images)}
    photos_of = {
        frame.id: tuple(
            image_place[image] for kind, _, image in frame.data if kind == CAMERA_SENSOR and image in image_place
        )
        for frame in model.frames
    }
    rigs, exposures = [], []
    for rig in model.rigs:
        mine = [frame for frame in model.frames if frame.rig == rig.id and photos_of[frame.id]]
        cameras = [camera_place[one] for kind, one in rig.sensors if kind == CAMERA_SENSOR and one in camera_place]
        if any(len(photos_of[frame.id]) > 1 for frame in mine):
            rigs.append(ExchangedRig(f"RIG{rig.id}", tuple(map(ExchangedMounting, cameras))))
            exposures += [ExchangedExposure(f"E{frame.id}", photos_of[frame.id]) for frame in mine]
    return tuple(rigs), tuple(exposures)


def with_rigs(model: ColmapModel, project: ExchangedProject, before: ColmapModel | None) -> ColmapModel:
    """Return a model with the rigs and exposures of a project; without rigs where the project has none.

    Parameters
    ----------
    model : ColmapModel
        With the images and cameras of the project, and others.
    before : ColmapModel or None
        Whose rigs and frames keep their ids and order.
    """
    if not project.rigs:
        return replace(model, rigs=(), frames=())
    by_name = {image.name: image for image in model.images}
    of_photo = [by_name.get(photo.name) for photo in project.photos]
    camera_of = {project.photos[n].camera: image.camera for n, image in enumerate(of_photo) if image is not None}
    rigs = _rigs(model, project, camera_of, before)
    exposure = {
        image.id: number
        for number, one in enumerate(project.exposures)
        for photo in one.photos
        if (image := of_photo[photo]) is not None
    }
    return replace(model, rigs=rigs, frames=tuple(_frames(model.images, rigs, exposure, before)))


def _rigs(
    model: ColmapModel, project: ExchangedProject, camera_of: Mapping[int, int], before: ColmapModel | None
) -> tuple[ColmapRig, ...]:
    """Return rigs with the mountings of the project, then one for each camera that is on none of them."""
    old = {} if before is None else {sensor: rig for rig in before.rigs for sensor in rig.sensors}
    found: list[ColmapRig] = []
    taken: set[int] = set()
    for rig in project.rigs:
        poses = {
            (CAMERA_SENSOR, camera_of[one.camera]): _sensor_pose(one)
            for one in rig.mountings
            if one.camera in camera_of
        }
        if not poses:
            continue
        known = next((old[sensor] for sensor in poses if sensor in old), None)
        kept = [] if known is None else [one for one in known.sensors if one in poses or one[0] != CAMERA_SENSOR]
        sensors = (*kept, *(one for one in poses if one not in kept))
        reference = poses.get(sensors[0])
        given = {} if known is None else dict(zip(known.sensors, known.poses, strict=True))
        new = {
            sensor: composed(pose, inverse(reference)) if pose is not None and reference is not None else None
            for sensor, pose in poses.items()
        }
        poses_of = tuple(
            IDENTITY if place == 0 else _kept(given.get(sensor), new.get(sensor, given.get(sensor)))
            for place, sensor in enumerate(sensors)
        )
        identity = max([*taken, 0]) + 1 if known is None or known.id in taken else known.id
        taken.add(identity)
        found.append(ColmapRig(identity, sensors, poses_of))
    used = {sensor for rig in found for sensor in rig.sensors}
    for camera in model.cameras:
        alone = (CAMERA_SENSOR, camera.id)
        if alone not in used:
            identity = old[alone].id if alone in old and old[alone].id not in taken else max([*taken, 0]) + 1
            taken.add(identity)
            found.append(ColmapRig(identity, (alone,), (IDENTITY,)))
    return tuple(found)


def _frames(
    images: Sequence[ColmapImage], rigs: Sequence[ColmapRig], exposure: Mapping[int, int], before: ColmapModel | None
) -> Iterator[ColmapFrame]:
    """Yield a frame for each exposure, and for each image of none; earlier frames keep id, order and other data."""
    rig_of = {sensor: rig for rig in rigs for sensor in rig.sensors}
    groups: dict[tuple[int, int], list[ColmapImage]] = {}
    for image in images:
        alone = (-1, image.id)
        groups.setdefault((exposure[image.id], 0) if image.id in exposure else alone, []).append(image)
    old: dict[int, ColmapFrame] = {}
    order: dict[int, int] = {}
    for number, frame in enumerate(() if before is None else before.frames):
        old |= {datum: frame for kind, _, datum in frame.data if kind == CAMERA_SENSOR}
        order[frame.id] = number
    free = max(order, default=0)
    found: list[ColmapFrame] = []
    taken: set[int] = set()
    for group in groups.values():
        rig = rig_of[CAMERA_SENSOR, group[0].camera]
        known = next((old[image.id] for image in group if image.id in old), None)
        if known is not None and known.id in taken:
            known = None
        data = tuple((CAMERA_SENSOR, image.camera, image.id) for image in group)
        if known is None:
            free += 1
            found.append(ColmapFrame(free, rig.id, _rig_pose(rig, group), data))
        else:
            others = tuple(datum for datum in known.data if datum[0] != CAMERA_SENSOR and datum[:2] in rig.sensors)
            kept = tuple(datum for datum in known.data if datum in data or datum in others)
            data = (*kept, *(datum for datum in data if datum not in kept))
            pose = _rig_pose(rig, group)
            taken.add(known.id)
            found.append(ColmapFrame(known.id, rig.id, known.pose if is_same_pose(pose, known.pose) else pose, data))
    yield from sorted(found, key=lambda frame: order.get(frame.id, len(order) + frame.id))


def _rig_pose(rig: ColmapRig, group: Sequence[ColmapImage]) -> Pose:
    """Return the pose of a rig from that of one of its images, its reference if that is there."""
    poses = dict(zip(rig.sensors, rig.poses, strict=True))
    known = {
        rig.sensors.index((CAMERA_SENSOR, image.camera)): image
        for image in group
        if poses[CAMERA_SENSOR, image.camera] is not None
    }
    if not known:
        return group[0].pose
    image = known[min(known)]
    pose = poses[CAMERA_SENSOR, image.camera] or IDENTITY
    return image.pose if pose == IDENTITY else composed(inverse(pose), image.pose)


def _sensor_pose(mounting: ExchangedMounting) -> Pose | None:
    """Return the pose from the reference camera to a camera; None where the mounting is not known."""
    if not mounting.rotation or not mounting.offset:
        return None
    return inverse(_of_parts(np.array(mounting.rotation).reshape(3, 3), np.array(mounting.offset)))


def _kept(old: Pose | None, new: Pose | None) -> Pose | None:
    return old if old is not None and new is not None and is_same_pose(new, old) else new


def is_same_pose(pose: Pose, old: Pose, limit: float = _SAME_POSE) -> bool:
    """Return whether two poses are equal but for the last digits."""
    first, second = np.array(pose), np.array(old)
    length = float(np.linalg.norm(first[:4]) * np.linalg.norm(second[:4]))
    same_rotation = abs(abs(float(first[:4] @ second[:4])) / length - 1.0) < limit**2 + 1e-15
    size = max(1.0, float(np.abs(second[4:]).max()))
    return same_rotation and bool(np.abs(first[4:] - second[4:]).max() <= limit * size)


def composed(second: Pose, first: Pose) -> Pose:
    """Return the pose that is `first` and then `second`."""
    (r1, t1), (r2, t2) = _parts(first), _parts(second)
    return _of_parts(r2 @ r1, r2 @ t1 + t2)


def inverse(pose: Pose) -> Pose:
    """Return the pose that leads back."""
    rotation, translation = _parts(pose)
    return _of_parts(rotation.T, -rotation.T @ translation)


def _parts(pose: Pose) -> tuple[FloatArray, FloatArray]:
    return rotations_from_quaternions(np.array([pose[:4]]))[0], np.array(pose[4:])


def _of_parts(rotation: FloatArray, translation: FloatArray) -> Pose:
    return (*map(float, quaternions_from_rotations(rotation[None])[0]), *map(float, translation))
