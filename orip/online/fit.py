"""How what is measured and given fits in a session: residuals, redundancy, w, standard deviations, and the whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.unknowns import UnknownName
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation, rotation_from_angles
from orip.online.answers import words_of
from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.sequential.hyper_rows import ObservationRows
from orip.online.sequential.standings import falls, redundancies
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


Shown = dict[str, Any]


def residuals_of(measuring: Measuring, photo: str = "", point: str = "", most: int | None = None) -> list[Shown]:
    """Return the photo points that are in: residuals and redundancy numbers of x and y, w and its limit, largest first.

    Residuals are computed minus observed, divided by the a-priori errors.

    Parameters
    ----------
    photo, point : str
        Those of this photo alone, as it is defined, and of this point; empty: of all.
    most : int or None
        As many; None: all.
    """
    equations = measuring.block.equations
    of_both = measuring.block.included_of([photo] if photo else (), [point] if point else ())
    keys = [
        key
        for key in (of_both if photo or point else equations.included)
        if key.kind == "photo" and photo in ("", key.photo) and point in ("", key.point)
    ]
    standings = equations.standings(keys)
    squares, checked = falls(standings)
    limits = {count: measuring.limit(max(count, 1)) for count in np.unique(checked).tolist()}
    w, limit = np.sqrt(squares), np.array([limits[count] for count in checked.tolist()])
    order = np.argsort(-w / limit, kind="stable")[:most].tolist()
    largest = [standings[place] for place in order]
    return [
        {
            "photo": keys[place].photo,
            "point": keys[place].point,
            "v": standing.residual.tolist(),
            "redundancy": redundancy,
            "w": float(w[place]),
            "limit": float(limit[place]),
        }
        for place, standing, redundancy in zip(order, largest, redundancies(largest), strict=True)
    ]


def given_of(measuring: Measuring) -> list[Shown]:
    """Return what was given and takes part: control, elements, distances, stations; as `residuals_of`, in their order.

    `test` is the root of the fall of the square sum without the observation, `w` that of each component, None where
    nothing checks it.
    """
    equations = measuring.block.equations
    keys = [key for key in equations.included if key.kind != "photo"]
    standings = equations.standings(keys)
    squares, checked = falls(standings)
    return [
        {
            "observation": words_of(key),
            "v": standing.residual.tolist(),
            "redundancy": standing.redundancy.tolist(),
            "w": [None if np.isnan(w) else w for w in np.abs(standing.normalised()).tolist()],
            "test": float(np.sqrt(square)),
            "limit": measuring.limit(max(count, 1)),
        }
        for key, standing, square, count in zip(keys, standings, squares.tolist(), checked.tolist(), strict=True)
    ]


def measured_of(measuring: Measuring) -> list[Shown]:
    """Return the photo points in the order of measuring, and whether each one takes part."""
    found, included = measuring.block.measurements.observations, measuring.block.equations.included
    keys = [measuring.block.key(photo, point) for photo, point in zip(found.photos, found.points, strict=True)]
    return [
        {
            "photo": key.photo,
            "point": key.point,
            "state": "excluded"
            if key in measuring.excluded
            else "suspect"
            if key in measuring.suspects
            else "included"
            if key in included
            else "waiting",
        }
        for key in keys
    ]


def statistics_of(measuring: Measuring) -> Shown:
    """Return the square sum of the standard residuals, redundancy, sigma0, and what they are made of."""
    block = measuring.block
    kinds: dict[str, int] = {}
    for key, rows in block.equations.included.items():
        kinds[key.kind] = kinds.get(key.kind, 0) + len(rows.right)
    equations = sum(kinds.values())
    return {
        "equations": equations,
        "unknowns": equations - block.equations.redundancy,
        "redundancy": block.equations.redundancy,
        "square sum": block.equations.square_sum,
        "sigma0": block.sigma0,
        "by kind": kinds,
        "suspects": len(measuring.suspects),
        "excluded": len(measuring.excluded),
    }
