"""`orip observations list`: measured points with their residuals and weights, and their stereo partners."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.reliability import reliability
from orip.errors import InputError, ProjectWarning
from orip.records.listed_observation import ListedObservation, Pair, StereoPartner
from orip.records.names import record_key
from orip.records.solution import Solution
from orip.workflow.observations.at_hand import BundleAtHand, bundle_at_hand
from orip.workflow.observations.places import NOWHERE, Places
from orip.workflow.observations.rays import photos_of_points


@dataclass(frozen=True, slots=True)
class ObservationList:
    """Photo observations of a bundle; `run` is the adjustment that residuals and weights come from."""

    bundle: str
    run: str | None
    observations: tuple[ListedObservation, ...]
    partners: tuple[StereoPartner, ...]
    warnings: tuple[ProjectWarning, ...]


def list_observations(
    folder: Path,
    bundle: str | None = None,
    photo: str | None = None,
    point: str | None = None,
    *,
    every: bool = False,
    with_partners: bool = False,
) -> ObservationList:
    """Return the down-weighted photo observations of a bundle.

    Parameters
    ----------
    folder : Path
    bundle : str or None
        None: the project's only one.
    photo, point : str or None
        That photo or point alone.
    every : bool
        All observations, not the down-weighted ones alone.
    with_partners : bool
        Also the photos that show these points, and where.

    Raises
    ------
    InputError
        If nothing is measured, or nothing adjusted where the adjustment is asked for.
    UsageError
        If a name is not known.
    """
    at_hand = bundle_at_hand(folder, bundle)
    if at_hand.solution is None and not every:
        message = (
            f"bundle {at_hand.name} has not been adjusted, and nothing is down-weighted yet; run 'orip solve' first, "
            "or see all that is measured with --all"
        )
        raise InputError.single(message)
    key = at_hand.photo_key(photo) if photo is not None else None
    if point is not None:
        at_hand.require_point(point)
    rows = tuple(
        each
        for each in listed_observations(at_hand)
        if (every or each.is_down_weighted)
        and (key is None or record_key(each.photo) == key)
        and (point is None or each.point == point)
    )
    partners = tuple(stereo_partners(at_hand, rows, Places(at_hand))) if with_partners else ()
    run = at_hand.solution.run if at_hand.solution else None
    return ObservationList(at_hand.name, run, rows, partners, at_hand.warnings)


def listed_observations(at_hand: BundleAtHand) -> Iterator[ListedObservation]:
    """Yield all photo observations of a bundle in their order, with what the last adjustment says of them."""
    found = at_hand.observations
    adjusted = _Adjusted(at_hand.solution)
    rays = photos_of_points(found)
    rows = zip(
        found.photos, found.points, found.measured.tolist(), found.errors.tolist(), found.disregarded.tolist(),
        strict=True,
    )  # fmt: skip
    for photo, point, (x, y), (x_error, y_error), disregarded in rows:
        error = adjusted.pair(adjusted.a_priori, photo, point)
        yield ListedObservation(
            photo, point, (x, y),
            error=(x_error, y_error) if np.isnan(error).all() else error,
            residual=adjusted.pair(adjusted.residual, photo, point),
            sd=adjusted.pair(adjusted.sd, photo, point),
            weight_factor=adjusted.pair(adjusted.weight_factor, photo, point),
            disregarded=disregarded,
            rays=len(rays[point]),
        )  # fmt: skip


class _Adjusted:
    """Residuals of photo points by photo and point; no solution has none."""

    def __init__(self, solution: Solution | None) -> None:
        self.rows: dict[tuple[str, str], dict[str, int]] = {}
        self.a_priori = self.residual = self.weight_factor = self.sd = np.empty(0)
        if solution is None:
            return
        found = solution.residuals
        for row, kind in enumerate(found.kind):
            if kind == "photo":
                of_point = self.rows.setdefault((record_key(found.photo[row]), found.point[row]), {})
                of_point[found.component[row]] = row
        scale = solution.sigma0 if np.isfinite(solution.sigma0) else 1.0
        self.a_priori, self.residual, self.weight_factor = found.a_priori, found.residual, found.weight_factor
        self.sd = reliability(found, scale).adjusted_sd

    def pair(self, values: FloatArray, photo: str, point: str) -> Pair:
        """Return x and y of a figure for a photo point."""
        rows = self.rows.get((record_key(photo), point), {})
        x, y = (float(values[rows[axis]]) if axis in rows else np.nan for axis in ("x", "y"))
        return x, y


def stereo_partners(
    at_hand: BundleAtHand, rows: Sequence[ListedObservation], places: Places
) -> Iterator[StereoPartner]:
    """Yield for each observation the other photos that show its point: those of its models first.

    A partner in which the point is not measured is found by prediction, within its frame; one of a model is named even
    where the position is not known.
    """
    measured = _measured_places(at_hand)
    shown = _photos_that_show(at_hand, {row.point for row in rows}, places)
    order = {key: place for place, key in enumerate(at_hand.photos)}
    for row in rows:
        key = record_key(row.photo)
        models = at_hand.models_of(key)
        of_point = measured.get(row.point, {})
        others = ({*models, *of_point, *shown.get(row.point, ())} & order.keys()) - {key}
        for other in sorted(others, key=lambda each: (each not in models, order[each])):
            partner = (row.photo, row.point, at_hand.photos[other], models.get(other))
            predicted = places.predicted(other).get(row.point)
            if other in of_point:
                yield StereoPartner(*partner, "measured", *places.measured(other, of_point[other]))
            elif predicted is not None:
                yield StereoPartner(*partner, "predicted", *predicted)
            elif not places.can_predict(other, row.point):
                yield StereoPartner(*partner, "not known", NOWHERE, NOWHERE)


def _measured_places(at_hand: BundleAtHand) -> dict[str, dict[str, Pair]]:
    """Return the stored coordinates of each point by photo (`record_key`), disregarded ones left out."""
    found = at_hand.observations
    places: dict[str, dict[str, Pair]] = {}
    rows = zip(found.photos, found.points, found.measured.tolist(), found.disregarded.tolist(), strict=True)
    for photo, point, (x, y), disregarded in rows:
        if not disregarded:
            places.setdefault(point, {})[record_key(photo)] = x, y
    return places


def _photos_that_show(at_hand: BundleAtHand, points: set[str], places: Places) -> dict[str, list[str]]:
    shown: dict[str, list[str]] = {}
    for photo in at_hand.photos if points else ():
        for point in points & places.predicted(photo).keys():
            shown.setdefault(point, []).append(photo)
    return shown
