"""Measured points with residuals, weights and stereo partners, the rays of each, and where they are in photos."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.bundle.local_frame import ground_system
from orip.bundle.results.covariance import predict_photo_coordinates
from orip.bundle.results.reliability import reliability
from orip.errors import InputError, ProjectWarning, UsageError
from orip.interior.in_force import stored_to_log
from orip.interior.mounting import frame_corners
from orip.records.interior import ListedObservation, Pair, StereoPartner
from orip.records.measurement import Measured, PhotoObservations
from orip.records.names import near_names, record_key
from orip.records.observation_kinds import measurement_name, observed_before
from orip.records.results.solution import Solution
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.state import Part
from orip.workflow.project.texts import raise_complaints


class LeftAlone(Struct, frozen=True):
    """A point that had two rays or more before and has fewer now: its bundle, and its remaining photos."""

    bundle: str
    point: str
    photos: tuple[str, ...]


def photos_of_points(observations: PhotoObservations) -> dict[str, list[str]]:
    """Return the photos that see each point, disregarded measurements left out, by point in the order measured."""
    photos: dict[str, list[str]] = {name: [] for name in observations.points}
    rows = zip(observations.photos, observations.points, observations.disregarded.tolist(), strict=True)
    for photo, point, disregarded in rows:
        if not disregarded and photo not in photos[point]:
            photos[point].append(photo)
    return photos


def left_alone(before: Measured, after: Measured) -> tuple[LeftAlone, ...]:
    """Return the points that have a single ray or none after an edit, and had more before it."""
    found = []
    for key, observations in before.observations.items():
        now: Mapping[str, list[str]] = photos_of_points(after.observations[key]) if key in after.observations else {}
        for point, photos in photos_of_points(observations).items():
            left = now.get(point, [])
            if len(photos) >= 2 > len(left):
                found.append(LeftAlone(observations.bundle, point, tuple(left)))
    return tuple(found)


NOWHERE: Pair = (np.nan, np.nan)

_LEAST_RAYS = 2
"""Least number of rays: a point with a single ray has a guessed distance, and a prediction of it means nothing."""


class PredictedPlace(NamedTuple):
    """Photo coordinates (mm) of a point, and those to drive to, as in a log."""

    photo_xy: Pair
    log_xy: Pair


class Places:
    """Places of the points of a bundle; those of a photo are predicted once, when they are first asked for.

    Raises
    ------
    InputError
        If the ground control or preliminary points are at fault.
    """

    def __init__(self, bundle: BundleState) -> None:
        self._bundle = bundle
        self._known = _ground_coordinates(bundle) if bundle.solution else {}
        self._predicted: dict[str, dict[str, PredictedPlace]] = {}
        self._anywhere: dict[str, dict[str, PredictedPlace]] = {}

    def measured(self, photo: str, stored: Pair) -> PredictedPlace:
        """Return the place of a point with stored coordinates in a photo (`record_key`)."""
        xy = np.array([stored])
        to_photo = self._bundle.interior.to_photo.get(photo)
        return PredictedPlace(_pair(to_photo.apply(xy)[0]) if to_photo else NOWHERE, _pair(self._log(photo, xy)[0]))

    def can_predict(self, photo: str, point: str) -> bool:
        """Tell whether it is known if and where a photo (`record_key`) shows a point."""
        solution = self._bundle.solution
        return solution is not None and point in self._known and photo in map(record_key, solution.photos.names)

    def predicted(self, photo: str) -> dict[str, PredictedPlace]:
        """Return by name the points that a photo (`record_key`) should show within its frame."""
        if photo not in self._predicted:
            corners = frame_corners(self._bundle.records.camera_of(self._bundle.records.photos[photo]))
            found = self.anywhere(photo)
            inside = _inside(corners, np.array([place.photo_xy for place in found.values()]).reshape(-1, 2))
            self._predicted[photo] = {name: found[name] for name, seen in zip(found, inside, strict=True) if seen}
        return self._predicted[photo]

    def anywhere(self, photo: str) -> dict[str, PredictedPlace]:
        """Return by name the points in front of a photo (`record_key`), also beyond its frame lines."""
        if photo not in self._anywhere:
            self._anywhere[photo] = self._predict(photo)
        return self._anywhere[photo]

    def _predict(self, photo: str) -> dict[str, PredictedPlace]:
        bundle, definitions = self._bundle, self._bundle.records
        solution = bundle.solution
        if solution is None or not self._known or photo not in map(record_key, solution.photos.names):
            return {}
        record = definitions.photos[photo]
        camera = definitions.camera_of(record)
        definition = bundle.project.definition
        ground = ground_system(definition.crs, definition.ground_unit, (), solution.photos.values[:, :3])
        xy = predict_photo_coordinates(solution, record.name, camera, np.array([*self._known.values()]), ground)
        to_photo = bundle.interior.to_photo.get(photo)
        log = self._log(photo, to_photo.inverse().apply(xy)) if to_photo else np.full_like(xy, np.nan)
        names = list(self._known)
        return {
            names[row]: PredictedPlace(_pair(xy[row]), _pair(log[row]))
            for row in np.flatnonzero(np.isfinite(xy).all(axis=1)).tolist()
        }

    def _log(self, photo: str, stored: FloatArray) -> FloatArray:
        definitions = self._bundle.records
        back = stored_to_log(definitions.photos[photo], definitions, self._bundle.interior.to_template)
        return back.apply(stored) if back else np.full_like(stored, np.nan)


def _inside(corners: tuple[FloatArray, FloatArray] | None, xy: FloatArray) -> NDArray[np.bool_]:
    if corners is None:
        return np.ones(len(xy), dtype=bool)
    return np.asarray((xy >= corners[0]).all(axis=1) & (xy <= corners[1]).all(axis=1))


def _pair(xy: FloatArray) -> Pair:
    return float(xy[0]), float(xy[1])


def _ground_coordinates(bundle: BundleState) -> dict[str, tuple[float, float, float]]:
    """Return the project's coordinates of points: adjusted from two rays or more, else given."""
    found = bundle.state.texts.control_input(bundle.name)
    raise_complaints(found.complaints)
    known: dict[str, tuple[float, float, float]] = {}
    for point in found.value.preliminary:
        known[point.name] = point.coordinates
    for control in found.value.control.points:
        x, y, z = control.coordinates
        if not control.rejected and x is not None and y is not None and z is not None:
            known[control.name] = x, y, z
    solution = bundle.solution
    if solution is not None:
        rows = zip(solution.points.names, solution.points.values.tolist(), solution.point_rays.tolist(), strict=True)
        known.update({name: (x, y, z) for name, (x, y, z), rays in rows if rays >= _LEAST_RAYS})
    return known


LISTED_FROM: tuple[Part, ...] = ("definitions", "marks", "observations", "solutions")
"""What lists of photo observations need of the stores."""


class ObservationList(Struct, frozen=True):
    """Photo observations of a bundle; `run` is the adjustment that residuals and weights come from."""

    bundle: str
    run: str | None
    observations: tuple[ListedObservation, ...]
    partners: tuple[StereoPartner, ...]
    warnings: tuple[ProjectWarning, ...]


def list_observations(
    bundle: BundleState,
    photo: str | None = None,
    point: str | None = None,
    *,
    every: bool = False,
    with_partners: bool = False,
) -> ObservationList:
    """Return the down-weighted photo observations of a bundle.

    Parameters
    ----------
    bundle : BundleState
        With `LISTED_FROM`.
    photo, point : str or None
        That photo or point alone.
    every : bool
        All observations, not only the down-weighted ones.
    with_partners : bool
        Also the photos that show these points, and where.

    Raises
    ------
    InputError
        If nothing is measured, or nothing adjusted where the adjustment is asked for.
    UsageError
        If a name is not known.
    """
    require_observations(bundle)
    if bundle.solution is None and not every:
        message = (
            f"bundle {bundle.name} has not been adjusted, and nothing is down-weighted yet; run 'orip solve' first, "
            "or see all that is measured with --all"
        )
        raise InputError.single(message)
    key = _photo_key(bundle, photo) if photo is not None else None
    if point is not None:
        _require_point(bundle, point)
    rows = tuple(
        row
        for row in listed_observations(bundle)
        if (every or row.is_down_weighted)
        and (key is None or record_key(row.photo) == key)
        and (point is None or row.point == point)
    )
    partners = tuple(stereo_partners(bundle, rows, Places(bundle))) if with_partners else ()
    run = bundle.solution.run if bundle.solution else None
    return ObservationList(bundle.name, run, rows, partners, outdated_warnings(bundle))


def require_observations(bundle: BundleState) -> None:
    """Raise InputError unless the project is initialised and something of the bundle is measured or adjusted."""
    bundle.state.require_initialised()
    if not bundle.observations.points and bundle.solution is None:
        raise bundle.not_measured()


def outdated_warnings(bundle: BundleState) -> tuple[ProjectWarning, ...]:
    """Return a warning if the photo observations are not those that were adjusted."""
    if bundle.solution is None:
        return ()
    path = bundle.project.shown(bundle.project.observations(bundle.name))
    if dict(bundle.solution.inputs).get(path) == bundle.digest_of_observations:
        return ()
    text = "has changed since the last adjustment, whose residuals and weights are shown; run 'orip solve'"
    return (ProjectWarning("out-of-date", path, text),)


def _photo_key(bundle: BundleState, name: str) -> str:
    """Return the `record_key` of a photo that the bundle has; raise UsageError, with names like it, if none."""
    key = record_key(name)
    if key not in bundle.photos:
        message = f"bundle {bundle.name} has no photo {name}; {near_names(name, bundle.photos.values())}"
        raise UsageError(message)
    return key


def _require_point(bundle: BundleState, name: str) -> None:
    """Raise UsageError, with names like it, unless a point of this name is measured."""
    points = bundle.observations.points
    if name not in points:
        message = f"bundle {bundle.name} has no point {name}; {near_names(name, points)}"
        raise UsageError(message)


def listed_observations(bundle: BundleState) -> Iterator[ListedObservation]:
    """Yield all photo observations of a bundle in their order, with their figures in the last adjustment."""
    found = bundle.observations
    adjusted = _Adjusted(bundle.solution)
    rays = photos_of_points(found)
    rows = zip(
        found.photos, found.points, found.measured.tolist(), found.errors.tolist(), found.disregarded.tolist(),
        observed_before(found).tolist(), strict=True,
    )  # fmt: skip
    for photo, point, (x, y), (x_error, y_error), disregarded, before in rows:
        name = measurement_name(point, before)
        error = adjusted.pair(adjusted.a_priori, photo, name)
        yield ListedObservation(
            photo, point, (x, y),
            error=(x_error, y_error) if np.isnan(error).all() else error,
            residual=adjusted.pair(adjusted.residual, photo, name),
            sd=adjusted.pair(adjusted.sd, photo, name),
            weight_factor=adjusted.pair(adjusted.weight_factor, photo, name),
            disregarded=disregarded,
            rays=len(rays[point]),
            before=before,
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
        """Return x and y of a figure for a photo point; `point` is what its measurement is called."""
        rows = self.rows.get((record_key(photo), point), {})
        x, y = (float(values[rows[axis]]) if axis in rows else np.nan for axis in ("x", "y"))
        return x, y


def stereo_partners(bundle: BundleState, rows: Sequence[ListedObservation], places: Places) -> Iterator[StereoPartner]:
    """Yield for each observation the other photos that show its point, those in a model with its photo first.

    A partner in which the point is not measured is found by prediction, within its frame; one of a model is named even
    where the position is not known.
    """
    measured = _measured_places(bundle)
    shown = _photos_that_show(bundle, {row.point for row in rows}, places)
    order = {key: place for place, key in enumerate(bundle.photos)}
    for row in rows:
        key = record_key(row.photo)
        models = bundle.models_of_photos.get(key, {})
        of_point = measured.get(row.point, {})
        others = ({*models, *of_point, *shown.get(row.point, ())} & order.keys()) - {key}
        for other in sorted(others, key=lambda photo: (photo not in models, order[photo])):
            partner = (row.photo, row.point, bundle.photos[other], models.get(other))
            predicted = places.predicted(other).get(row.point)
            if other in of_point:
                yield StereoPartner(*partner, "measured", *places.measured(other, of_point[other]))
            elif predicted is not None:
                yield StereoPartner(*partner, "predicted", *predicted)
            elif not places.can_predict(other, row.point):
                yield StereoPartner(*partner, "not known", NOWHERE, NOWHERE)


def _measured_places(bundle: BundleState) -> dict[str, dict[str, Pair]]:
    """Return the stored coordinates of each point by photo (`record_key`), disregarded ones left out."""
    found = bundle.observations
    places: dict[str, dict[str, Pair]] = {}
    rows = zip(found.photos, found.points, found.measured.tolist(), found.disregarded.tolist(), strict=True)
    for photo, point, (x, y), disregarded in rows:
        if not disregarded:
            places.setdefault(point, {})[record_key(photo)] = x, y
    return places


def _photos_that_show(bundle: BundleState, points: set[str], places: Places) -> dict[str, list[str]]:
    shown: dict[str, list[str]] = {}
    for photo in bundle.photos if points else ():
        for point in points & places.predicted(photo).keys():
            shown.setdefault(point, []).append(photo)
    return shown
