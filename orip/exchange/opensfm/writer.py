"""A project as a reconstruction of OpenSfM: a new one, or the result in a copy of the one that it was imported from."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from orip.errors import InputError
from orip.exchange.format import WITHOUT_GROUND, Conventions, Format, require_without
from orip.exchange.opensfm.reconstruction import READING, is_shots_geojson, largest_reconstruction
from orip.exchange.opensfm.rigs import as_written, is_same, set_rigs
from orip.exchange.opensfm.source import is_opensfm, read_opensfm, reconstruction_file
from orip.exchange.sources.json_tree import read_json
from orip.exchange.sources.names import distinct_names
from orip.exchange.sources.text import Faults
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedProject

_NAME = "reconstruction.json"
_NOTHING = 1e-11
"""Parameters that are smaller are none."""

_RADIAL = ("k1", "k2", "k3")
_DECENTRING = ("p1", "p2")
_FISHEYE = ("k1", "k2", "k3", "k4")
_PLANE = ("fx", "fy", "cx", "cy")
OPENSFM_TERMS = (*_PLANE, *_RADIAL, *_DECENTRING)
OPENSFM_FISHEYE_TERMS = (*_PLANE, *_FISHEYE, *_DECENTRING)
_SCALE = 0.001
"""Size of a feature; it has no part in OpenSfM's adjustment unless it is asked for."""

_GREY = [128.0, 128.0, 128.0]


def write_opensfm(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:
    """Return reconstruction.json; without an original also tracks.csv, in which all points are tracks.

    Points have their covariances (m²) as ``covariance``. Shots have as ``covariance`` that of the rotation vector from
    camera to ground (radians) and of the projection centre (m), 6 by 6, as OpenSfM's own adjustment gives it and its
    reader takes it; and ``position_covariance``, ``omega_phi_kappa_sd`` (degrees), which OpenSfM passes over.

    Raises
    ------
    InputError
        If the original is damaged or gone.
    """
    path = reconstruction_file(original) if original is not None and is_copied_reconstruction(original) else None
    if path is None:
        return {_NAME: _encoded([_new(project)]), "tracks.csv": _tracks(project)}
    faults = Faults(str(path))
    document = read_json(path, faults)
    if document is None or largest_reconstruction(document) is None or faults.complaints:
        raise InputError(faults.complaints)
    parts = [part for part in document.value if isinstance(part, dict) and isinstance(part.get("shots"), dict)]
    _update(max(parts, key=lambda part: len(part["shots"])), project)
    data = document.source.data
    ending = data[len(data.rstrip()) :]
    return {path.name: _encoded(document.value, is_indented=data[:3].split() == [b"["]) + ending}


def is_copied_reconstruction(original: Path) -> bool:
    """Return whether a result is put into a copy: of a reconstruction, and not of the shots of a report."""
    return not is_shots_geojson(original) and reconstruction_file(original) is not None


def _encoded(document: object, *, is_indented: bool = False) -> bytes:
    """Return a document as OpenSfM writes it, with indentation or without."""
    return json.dumps(document, indent=4 if is_indented else None, ensure_ascii=False).encode()


def _new(project: ExchangedProject) -> dict[str, Any]:
    cameras = {camera.name: _new_camera(camera) for camera in project.cameras}
    shots = {
        photo.name: {
            "rotation": list(photo.rotation),
            "translation": list(photo.position),
            "camera": project.cameras[photo.camera].name,
            **_precision(photo),
        }
        for photo in project.photos
        if photo.rotation
    }
    found: dict[str, Any] = {"cameras": cameras, "shots": shots, "points": {}}
    names = distinct_names(project.points)
    for row, values in _points(project).items():
        found["points"][names[row]] = {"color": _GREY, **values}
    set_rigs(found, project)
    return found


def _tracks(project: ExchangedProject) -> bytes:
    """Return the measurements as ``tracks.csv``; a feature has its number among all of them."""
    rays, names = project.rays, distinct_names(project.points)
    lines = ["OPENSFM_TRACKS_VERSION_v2"]
    for feature in np.flatnonzero(rays.is_active).tolist():
        photo = project.photos[int(rays.photo[feature])]
        camera = project.cameras[photo.camera]
        longer = max(camera.columns, camera.rows)
        x, y = rays.image[feature].tolist()
        place = f"{(x - camera.columns / 2.0) / longer!r}\t{(y - camera.rows / 2.0) / longer!r}"
        track = names[int(rays.point[feature])]
        lines.append(f"{photo.name}\t{track}\t{feature}\t{place}\t{_SCALE}\t128\t128\t128\t-1\t-1")
    return ("\n".join(lines) + "\n").encode()


def _update(part: dict[str, Any], project: ExchangedProject) -> None:
    """Put poses, cameras and coordinates into a reconstruction; points that the project has not are taken out."""
    for camera in project.cameras:
        old = part["cameras"].get(camera.name)
        part["cameras"][camera.name] = _new_camera(camera) if old is None else _updated_camera(old, camera)
    for photo in project.photos:
        shot = part["shots"].get(photo.name)
        if shot is None or not photo.rotation:
            continue
        before = _pose(shot)
        for key, values in (("rotation", photo.rotation), ("translation", photo.position)):
            shot[key] = as_written(shot.get(key), values)
        shot.update(_precision(photo))
        shot["camera"] = project.cameras[photo.camera].name
        if before != _pose(shot):
            _follow(part.get("rig_instances"), photo.name, before, shot)
    set_rigs(part, project)
    coordinates_of = _points(project)
    points = {name: coordinates_of[row] for name, row in project.points.tracks.items() if row in coordinates_of}
    kept = {name: point for name, point in (part.get("points") or {}).items() if name in points}
    for name, point in kept.items():
        coordinates = as_written(point.get("coordinates"), points[name]["coordinates"])
        point.update(points[name] | {"coordinates": coordinates})
    part["points"] = kept


def _precision(photo: ExchangedPhoto) -> dict[str, Any]:
    """Return covariances of the projection centre and standard deviations of the angles, where they are known."""
    found: dict[str, Any] = {}
    if photo.pose_covariance is not None:
        found["covariance"] = [list(photo.pose_covariance[n : n + 6]) for n in range(0, 36, 6)]
    if photo.position_covariance is not None:
        found["position_covariance"] = [list(photo.position_covariance[n : n + 3]) for n in (0, 3, 6)]
    if photo.angle_deviation is not None:
        found["omega_phi_kappa_sd"] = list(photo.angle_deviation)
    return found


def _points(project: ExchangedProject) -> dict[int, dict[str, Any]]:
    """Return coordinates of points by their places, and covariances where they are known."""
    points = project.points
    covariances = points.covariance
    found: dict[int, dict[str, Any]] = {}
    for row, xyz in enumerate(points.coordinates.tolist()):
        if not all(map(math.isfinite, xyz)):
            continue
        found[row] = {"coordinates": xyz}
        if covariances is not None and np.isfinite(covariances[row]).all():
            found[row]["covariance"] = covariances[row].tolist()
    return found


def _follow(instances: object, name: str, before: tuple[Any, Any], shot: dict[str, Any]) -> None:
    """Give a rig instance that stood where its only photo stood the photo's new pose."""
    for instance in instances.values() if isinstance(instances, dict) else ():
        ids = instance.get("rig_camera_ids") if isinstance(instance, dict) else None
        if not isinstance(ids, dict) or list(ids) != [name] or before[0] is None or before[1] is None:
            continue
        rotation, translation = _pose(instance)
        if is_same(rotation, before[0]) and is_same(translation, before[1]):
            instance["rotation"], instance["translation"] = shot["rotation"], shot["translation"]


def _pose(owner: dict[str, Any]) -> tuple[Any, Any]:
    return owner.get("rotation"), owner.get("translation")


def _updated_camera(old: dict[str, Any], camera: ExchangedCamera) -> dict[str, Any]:
    """Return the camera in its own projection type if that holds it, else as ``brown`` or ``fisheye_opencv``."""
    if camera.lens == "equidistant":
        return _updated_fisheye(old, camera)
    brown = _brown(camera)
    own = {key: brown[key] for key in old if key in brown and key not in ("projection_type", "width", "height")}
    if old.get("projection_type") == "perspective":
        own["focal"] = brown["focal_x"]
        extra = ("c_x", "c_y", "k3", "p1", "p2")
        if brown["focal_x"] != brown["focal_y"] or any(abs(brown[key]) > _NOTHING for key in extra):
            return brown
    elif old.get("projection_type") != "brown":
        return brown
    same = {key: old[key] for key, value in own.items() if is_same([old.get(key)], [value])}
    return old | own | same


def _new_camera(camera: ExchangedCamera) -> dict[str, Any]:
    return _fisheye(camera) if camera.lens == "equidistant" else _brown(camera)


def _updated_fisheye(old: dict[str, Any], camera: ExchangedCamera) -> dict[str, Any]:
    new = _fisheye(camera)
    if old.get("projection_type") == "fisheye":
        extra = ("c_x", "c_y", "k3", "k4", *_DECENTRING)
        if abs(new["focal_x"] - new["focal_y"]) > _NOTHING or any(abs(new.get(key, 0.0)) > _NOTHING for key in extra):
            return new
        new["focal"] = new["focal_x"]
    elif old.get("projection_type") != new["projection_type"]:
        return new
    own = {key: new[key] for key in old if key in new and key not in ("projection_type", "width", "height")}
    return old | {key: value for key, value in own.items() if not is_same([old.get(key)], [value])}


def _fisheye(camera: ExchangedCamera) -> dict[str, Any]:
    """Return a fisheye camera, with decentring where it has any."""
    value = camera.parameters
    if not any(value.get(name) for name in _DECENTRING):
        return _plane(camera, "fisheye_opencv") | {name: value.get(name, 0.0) for name in _FISHEYE}
    terms = (*_FISHEYE, "k5", "k6", *_DECENTRING)
    return _plane(camera, "fisheye62") | {name: value.get(name, 0.0) for name in terms}


def _brown(camera: ExchangedCamera) -> dict[str, Any]:
    require_without(camera, ("k4", "k5", "k6"), "OpenSfM")
    return _plane(camera, "brown") | {name: camera.parameters.get(name, 0.0) for name in (*_RADIAL, *_DECENTRING)}


def _plane(camera: ExchangedCamera, kind: str) -> dict[str, Any]:
    """Return frame, focal lengths and principal point of a camera."""
    longer = max(camera.columns, camera.rows)
    value = camera.parameters
    return {
        "projection_type": kind,
        "width": camera.columns,
        "height": camera.rows,
        "focal_x": value["fx"] / longer,
        "focal_y": value["fy"] / longer,
        "c_x": (value["cx"] - camera.columns / 2.0) / longer,
        "c_y": (value["cy"] - camera.rows / 2.0) / longer,
    }


OPENSFM_FORMAT = Format(
    "opensfm", "OpenSfM, OpenDroneMap: project folder, reconstruction.json, or shots.geojson (orientations only)",
    read_opensfm, is_opensfm, write_opensfm,
    Conventions(
        "opencv", READING, fisheye_lens="equidistant", terms=OPENSFM_TERMS,
        fisheye_terms=OPENSFM_FISHEYE_TERMS, is_copied=is_copied_reconstruction, has_rigs=True,
        lacks=WITHOUT_GROUND,
    ),
)  # fmt: skip
