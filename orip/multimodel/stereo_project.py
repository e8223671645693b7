"""The plate processor of a project's stereo page: the models of the last adjustment whose photos have images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from orip.errors import InputError, ProjectWarning, UsageError
from orip.multimodel.processor import Loaded, load
from orip.multimodel.rectified_model import ImageOnPlate
from orip.multimodel.stereo_pairs import stereo_pairs
from orip.multimodel.stereo_processor import StereoPhoto, StereoProcessor
from orip.multimodel.table import object_ground
from orip.multimodel.table_step import DRIVEN_FROM, current_table
from orip.records.drive_table import Triple
from orip.records.names import record_key
from orip.structs import replace
from orip.wording import counted
from orip.workflow.observations.films import plate_of_log
from orip.workflow.project.bundle_state import read_bundle


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
