"""The plate processor of a project's stereo page: the models of the last adjustment whose photos have images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from orip.arrays import FloatArray
from orip.errors import InputError, ProjectWarning, UsageError
from orip.geometry.rotation import rotation_from_angles
from orip.multimodel.processor import Loaded, load
from orip.multimodel.rectified_model import ImageOnPlate
from orip.multimodel.stereo_processor import StereoPhoto, StereoProcessor
from orip.multimodel.table import object_ground
from orip.multimodel.table_step import DRIVEN_FROM, current_table
from orip.records.definition import StereoModel
from orip.records.drive_table import Triple
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE
from orip.wording import counted
from orip.workflow.observations.films import plate_of_log
from orip.workflow.project.bundle_state import read_bundle

_RATIOS = (0.3, 0.8)
_FEWEST_POINTS = 3
_LEAST_COSINE = 0.5
"""Of the angle between the directions in which the two look."""

_LEAST_ACROSS = 0.35
"""Part of the base across that direction: photos one behind the other show no stereo."""


def stereo_pairs(solution: Solution, ground: GroundSystem) -> tuple[StereoModel, ...]:
    """Return models of pairs of adjusted photos, in one row; none where no two photos show enough points in stereo.

    Parameters
    ----------
    ground : GroundSystem
        In which rays are straight.
    """
    photos = solution.photos
    centres, points = (ground.to_local(values) for values in (photos.values[:, :3], solution.points.values))
    axes = np.swapaxes(ground.axes_at(photos.values[:, :3]), 1, 2)
    rotations = axes @ rotation_from_angles(photos.values[:, 3:] * RADIANS_PER_DEGREE)
    shown = _points_of_photos(solution)
    common = (shown @ shown.T).tocoo()
    weighted = []
    for one, other, count in zip(common.row.tolist(), common.col.tolist(), common.data.tolist(), strict=True):
        if one < other and count >= _FEWEST_POINTS:
            both = shown[[one]].multiply(shown[[other]]).tocoo().col
            pair = [one, other]
            weighted.append((-count * _depth_shows(centres[pair], rotations[pair], points[both]), one, other))
    seen = sorted(found for found in weighted if found[0] < 0.0)
    pairs = sorted(_spanning_tree(len(photos.names), seen))
    models = []
    for column, (one, other) in enumerate(pairs, start=1):
        # the left one is that on whose right side the other one is
        is_left = (centres[other] - centres[one]) @ (rotations[one] + rotations[other])[:, 0] >= 0.0
        left, right = (one, other) if is_left else (other, one)
        models.append(StereoModel(f"S{column}", photos.names[left], photos.names[right], 1, column))
    return tuple(models)


def _points_of_photos(solution: Solution) -> Any:
    """Return which photo shows which point, a sparse array (photos, points) of ones."""
    photos = {record_key(name): row for row, name in enumerate(solution.photos.names)}
    points = {name: row for row, name in enumerate(solution.points.names)}
    rows = solution.residuals
    found = {
        (photos[record_key(photo)], points[point])
        for kind, photo, point in zip(rows.kind, rows.photo, rows.point, strict=True)
        if kind == "photo" and point in points
    }
    row, column = np.array(sorted(found)).reshape(-1, 2).T
    return csr_array((np.ones(len(row), dtype=np.int64), (row, column)), shape=(len(photos), len(points)))


def _depth_shows(centres: FloatArray, rotations: FloatArray, points: FloatArray) -> float:
    """Return from 0 to 1 how well two photos show depth at their common points."""
    cosine = float(rotations[0, :, 2] @ rotations[1, :, 2])
    distance = float(np.median(np.linalg.norm(points - centres.mean(axis=0), axis=1)))
    base = float(np.linalg.norm(centres[1] - centres[0]))
    look = (rotations[0] + rotations[1])[:, 2]
    across = float(np.linalg.norm(np.cross(centres[1] - centres[0], look)) / np.linalg.norm(look))
    if not (cosine > _LEAST_COSINE and distance > 0.0 and across > _LEAST_ACROSS * base):
        return 0.0
    ratio = across / distance
    return cosine * across / base * min(1.0, ratio / _RATIOS[0], _RATIOS[1] / ratio)


def _spanning_tree(count: int, weighted: list[tuple[float, int, int]]) -> Iterator[tuple[int, int]]:
    """Yield the pairs that connect what is not connected yet, the heaviest first (Kruskal)."""
    group = list(range(count))

    def root(photo: int) -> int:
        while group[photo] != photo:
            group[photo] = photo = group[group[photo]]
        return photo

    for _, one, other in weighted:
        first, second = root(one), root(other)
        if first != second:
            group[first] = second
            yield one, other


def open_stereo(
    folder: Path, bundle: str | None, extents: Mapping[str, tuple[float, float, float, float]]
) -> StereoProcessor:
    """Return a plate processor with the models of a bundle's last adjustment.

    Parameters
    ----------
    bundle : str or None
        None: the project's only one.
    extents : mapping of str
        Of the photos that have images, by name: their first and last x and y, log coordinates.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, or none of its models can be driven.
    UsageError
        If no model has two images.
    """
    state = read_bundle(folder, bundle, *DRIVEN_FROM)
    solution = state.adjusted
    ground = object_ground(state.project.definition.crs, solution.ground_unit, solution)
    pairs = state.definition.models or stereo_pairs(solution, ground)
    if not pairs:
        raise UsageError(_without_models(state.name))
    table, warnings = current_table(state, pairs)
    if not state.definition.models:
        text = f"has no models; {counted(len(pairs), 'pair')} of its photos can be seen instead"
        warnings += (ProjectWarning("pairs-of-photos", f"bundle {state.name}", text),)
    photos = {}
    for key in (photo.name for photo in table.photos):
        photo = state.records.photos[key]
        template = state.records.template_of(photo)
        scan = photo.scan or (None if template is None else template.scan)
        camera = state.records.cameras[record_key(photo.camera)]
        image = ImageOnPlate(plate_of_log(scan), extents.get(photo.name, (0.0, 0.0, 0.0, 0.0)))
        photos[key] = StereoPhoto(photo.name, image, camera.sensor is not None)
    seen = tuple(
        model for model in table.models if all(photos[name].name in extents for name in (model.left, model.right))
    )
    if not seen:
        message = "no model has images of both its photos: name them with image = in orip.toml, or give --images"
        raise UsageError(message)
    loaded = load(replace(table, models=seen))
    if not isinstance(loaded, Loaded):
        raise InputError.single("; ".join(fault.text for fault in loaded))
    values = solution.points.values.tolist()
    points: dict[str, Triple] = {
        name: (x, y, z) for name, (x, y, z) in zip(solution.points.names, values, strict=True) if np.isfinite(x + y + z)
    }
    return StereoProcessor(loaded, photos, ground, points, warnings)


def _without_models(bundle: str) -> str:
    return (
        f"bundle {bundle} has no models, and no two photos with points in common that show them in stereo: add some, "
        "for example 'orip model add 1-1 left=P1 right=P2 row=1 column=1', then repeat the command"
    )
