"""Standard deviations of photos and points while a block is measured, from the triangle of its equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.unknowns import UnknownName
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation, rotation_from_angles
from orip.online.block.online_block import OnlineBlock
from orip.online.sequential.hyper_rows import ObservationRows
from orip.records.photo import PHOTO_PARAMETERS

_COORDINATES = ("X", "Y", "Z")


def photo_deviations(block: OnlineBlock, orientations: Mapping[str, FloatArray]) -> dict[str, dict[str, float | None]]:
    """Return the standard deviations of X0, Y0, Z0 (ground units), OMEGA, PHI and KAPPA (degrees) of photos.

    None for constants and for what is not determined. They are those of `orip solve` with the cameras held: root of the
    cofactor times sigma0, or 1 without redundancy.

    Parameters
    ----------
    block : OnlineBlock
        Near its solution, on the ground.
    orientations : mapping of str to array (6,)
        Of the photos by name, local coordinates and radians.
    """
    names = list(orientations)
    columns = [
        block.columns.known_places([UnknownName("PHOTO", name, kind) for kind in PHOTO_PARAMETERS]) for name in names
    ]
    rows = [_unit_rows(None, places) for places in columns]
    found = {}
    for name, places, (_, cofactor, is_open) in zip(names, columns, block.equations.predicted(rows), strict=True):
        partials = _partials(block, orientations[name], turned_by_axes=bool((places[3:] >= 0).all()))
        variance = np.diag(partials @ cofactor @ partials.T)
        unknown = (np.abs(partials) @ ((places >= 0) & ~is_open)) > 0.0
        found[name] = _shown(block, PHOTO_PARAMETERS, variance, unknown & ~((np.abs(partials) @ is_open) > 0.0))
    return found


def point_deviations(block: OnlineBlock, points: Mapping[str, FloatArray]) -> dict[str, dict[str, float | None]]:
    """Return the standard deviations of X, Y and Z of points (ground units); see `photo_deviations`."""
    names = list(points)
    tied = [block.columns.known_places([UnknownName("POINT", name, axis) for axis in _COORDINATES]) for name in names]
    rows = [
        _unit_rows(None, places) if (places >= 0).any() else _unit_rows(name, places)
        for name, places in zip(names, tied, strict=True)
    ]
    found = {}
    for name, row, (_, cofactor, is_open) in zip(names, rows, block.equations.predicted(rows), strict=True):
        places = block.ground.cofactors_to_project(points[name][None], cofactor[None])[0]
        known = ~is_open if row.point is None or block.equations.has_point(name) else np.zeros(3, dtype=bool)
        found[name] = _shown(block, _COORDINATES, np.diag(places), known)
    return found


def _unit_rows(point: str | None, places: Sequence[int] | np.ndarray) -> ObservationRows:
    """Return equations that are the unknowns themselves: of a point, or of reduced unknowns at places (k,)."""
    places = np.asarray(places)
    count, order = len(places), np.argsort(places, kind="stable")
    order = order[places[order] >= 0]
    by_point = np.eye(3) if point is not None else np.zeros((count, 3))
    return ObservationRows(point, by_point, places[order], np.eye(count)[:, order], np.zeros(count))


def _partials(block: OnlineBlock, orientation: FloatArray, *, turned_by_axes: bool) -> FloatArray:
    """Return the partials (6, 6) of what is shown of a photo by its unknowns."""
    partials = np.eye(6)
    partials[:3, :3] = block.ground.project_with_partials(orientation[None, :3]).by_local[0]
    if turned_by_axes:
        axes = block.ground.axes_at(block.ground.to_project(orientation[None, :3]))[0]
        angles = angles_from_rotation(axes @ rotation_from_angles(orientation[None, 3:]))
        partials[3:, 3:] = angle_rates_from_axes_rotation(angles)[0] @ axes
    return partials


def _shown(
    block: OnlineBlock, names: Sequence[str], variance: FloatArray, known: np.ndarray
) -> dict[str, float | None]:
    scale = block.sigma0 or 1.0
    sizes = scale * np.sqrt(np.maximum(variance, 0.0))
    units = [np.degrees(1.0) if name in PHOTO_PARAMETERS[3:] else 1.0 for name in names]
    shown = zip(names, (sizes * units).tolist(), known.tolist(), sizes > 0.0, strict=True)
    return {name: size if is_known and is_unknown else None for name, size, is_known, is_unknown in shown}
