"""Where points are in photos: as measured, and as the last adjustment predicts them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.bundle.ground_system import ground_system
from orip.bundle.results.figures import predict_photo_coordinates
from orip.interior.in_force import stored_to_log
from orip.interior.mounting import frame_corners
from orip.records.names import record_key
from orip.records.results.interior import Pair
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.texts import raise_complaints

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
