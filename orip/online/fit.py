"""How what is measured and given fits in a session: residuals, redundancy numbers, w, and the whole of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from orip.online.answers import words_of
from orip.online.measuring import Measuring
from orip.online.sequential.standings import falls, redundancies

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
