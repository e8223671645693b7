"""The steps by models: relative orientation of each, bridging along the rows, connection of the rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

import numpy as np

from orip.prelim.rays.image_rays import ImageRays
from orip.prelim.rays.photo_index import PhotoIndex
from orip.prelim.relative.orientation import orient_two_photos
from orip.prelim.relative.oriented_models import OrientedModel
from orip.prelim.relative.start import POINTS_NEEDED
from orip.prelim.similarity.bridging import JoinedSystems, bridge_row
from orip.prelim.similarity.strip_connection import connect_strips
from orip.records.names import record_key
from orip.records.project.definition import StereoModel
from orip.records.results.preliminary import NotOriented
from orip.structs import replace


def in_driving_order(models: Sequence[StereoModel]) -> list[StereoModel]:
    """Return models by row and column: the order of 'next model'."""
    return sorted(models, key=lambda model: (model.row, model.column))


def orient_model(rays: ImageRays, model: StereoModel, index: PhotoIndex) -> OrientedModel | NotOriented:
    """Orient one model relatively; a photo that has no photo points is the reason why not."""
    return _oriented(rays, _places(rays), model, index)


def _places(rays: ImageRays) -> dict[str, int]:
    return {record_key(name): place for place, name in enumerate(rays.photos)}


def _oriented(
    rays: ImageRays, places: Mapping[str, int], model: StereoModel, index: PhotoIndex
) -> OrientedModel | NotOriented:
    missing = [name for name in (model.left, model.right) if record_key(name) not in places]
    if missing:
        return NotOriented(model.name, "", f"photo {' and photo '.join(missing)} has no photo points")
    left, right = places[record_key(model.left)], places[record_key(model.right)]
    found = orient_two_photos(rays, left, right, model=model.name, index=index)
    if isinstance(found, NotOriented):
        return replace(found, reason=found.reason + _other_partners(rays, (left, right), index))
    return OrientedModel(found, model.row, model.column)


def _other_partners(rays: ImageRays, pair: tuple[int, int], index: PhotoIndex) -> str:
    """Say which photos share more points with a photo of the model than the model's two photos with each other."""
    common = len(index.common_points(*pair)[0])
    partners = []
    for photo in pair:
        seen = np.zeros(len(rays.points), dtype=bool)
        seen[index.points[photo]] = True
        shared = np.bincount(rays.photo[seen[rays.point]], minlength=len(rays.photos))
        shared[photo] = 0
        if (most := int(shared.max())) > max(common, POINTS_NEEDED):
            partners.append(f"photo {rays.photos[photo]} shares {most} with photo {rays.photos[shared.argmax()]}")
    return f"; {' and '.join(partners)}" if partners else ""


def orient_models(
    rays: ImageRays, models: Sequence[StereoModel], index: PhotoIndex
) -> tuple[list[OrientedModel], list[NotOriented]]:
    """Orient all models relatively, in driving order."""
    places = _places(rays)
    found = [_oriented(rays, places, model, index) for model in in_driving_order(models)]
    oriented = [model for model in found if isinstance(model, OrientedModel)]
    return oriented, [model for model in found if isinstance(model, NotOriented)]


def bridge_rows(oriented: Sequence[OrientedModel], rays: ImageRays) -> JoinedSystems:
    """Bridge oriented models, given in driving order, to strips."""
    of_rows = groupby(oriented, lambda model: model.row)
    rows = [bridge_row([model.pair.block for model in of_row], rays) for _, of_row in of_rows]
    return JoinedSystems(
        tuple(system for row in rows for system in row.systems),
        tuple(step for row in rows for step in row.steps),
        tuple(failure for row in rows for failure in row.failures),
    )


def connect_rows(bridged: JoinedSystems, rays: ImageRays) -> JoinedSystems:
    """Connect strips, in the order of their rows, to a block."""
    return connect_strips(bridged.systems, rays)
