"""`orip observations todo`: what to measure again, as a measurement file whose coordinates are still missing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.errors import ProjectWarning
from orip.files.listings.observations import todo_text
from orip.files.text.regular_file import natural_key
from orip.interior.replay import replay
from orip.records.names import record_key
from orip.records.observations.measurement import Measured, PhotoObservations
from orip.records.results.interior import ListedObservation, Pair, PointToMeasure, WhyAgain
from orip.workflow.observations.listed import (
    NOWHERE,
    Places,
    PredictedPlace,
    listed_observations,
    outdated_warnings,
    require_observations,
)
from orip.workflow.observations.names import without_kills
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.named_output import require_replaceable
from orip.workflow.project.text_output import TextOutput
from orip.workflow.project.texts import is_measurement_file, raise_complaints


class Todo(Struct, frozen=True):
    """What to measure again, and the measurement file that asks for it; `file` is None where none is written."""

    bundle: str
    points: tuple[PointToMeasure, ...]
    text: str
    file: Path | None
    warnings: tuple[ProjectWarning, ...]


def measure_again(bundle: BundleState, output: Path | None = None, *, overwrite: bool = False) -> Change[Todo]:
    """Return the points of a bundle that need a new measurement, and the file to write if one is named.

    These are points that are down-weighted, disregarded or killed, and points in a single photo: they are to be
    measured in the photos that form a model with it or, by the last adjustment, show them.

    Parameters
    ----------
    bundle : BundleState
        With `orip.workflow.observations.listed.LISTED_FROM`.
    output : Path or None
        Relative to the project folder.
    overwrite : bool
        Replace a file that is there.

    Raises
    ------
    UsageError
        If the file already exists and may not be replaced.
    InputError
        If nothing is measured, or a measurement file is at fault.
    """
    require_observations(bundle)
    path = None if output is None else bundle.project.folder / output
    if path is not None:
        require_replaceable(bundle.project, path, force=overwrite, is_text=True)
    points = _points_to_measure(bundle)
    title = bundle.project.title
    text = todo_text(points, title, bundle.name, bundle.solution.run if bundle.solution else None)
    warnings = outdated_warnings(bundle)
    if path is None:
        return Change(bundle.state, Todo(bundle.name, points, text, None, warnings))
    todo = Todo(bundle.name, points, text, path, (*warnings, *_would_be_replayed(bundle, path)))
    return Change(bundle.state, todo, outputs=(TextOutput(path, lambda: [text], "choose another file"),))


def _would_be_replayed(bundle: BundleState, path: Path) -> Iterator[ProjectWarning]:
    if is_measurement_file(bundle.project, path):
        text = (
            "is among the project's measurement files by its name: 'orip measure' and 'orip run' will complain of it "
            "until its coordinates are filled in; give it an extension that they do not have to avoid that"
        )
        yield ProjectWarning("unfinished-measurements", bundle.project.shown(path), text)


def _points_to_measure(bundle: BundleState) -> tuple[PointToMeasure, ...]:
    places = Places(bundle)
    again = _killed(bundle, places)
    again += [point for row in listed_observations(bundle) for point in _of_observation(bundle, row, places)]
    order = {key: place for place, key in enumerate(bundle.records.photos)}
    # one line for each point and photo: what is wrong there is more important than that the point has a single ray
    again.sort(key=lambda point: point.why != "single ray")
    first = {(record_key(point.photo), point.point): point for point in again}

    def place(point: PointToMeasure) -> tuple[object, ...]:
        return order[record_key(point.photo)], natural_key(point.point), point.point

    return tuple(sorted(first.values(), key=place))


def _of_observation(bundle: BundleState, row: ListedObservation, places: Places) -> Iterator[PointToMeasure]:
    key = record_key(row.photo)
    why: WhyAgain | None = "disregarded" if row.disregarded else "down-weighted" if row.is_down_weighted else None
    before = places.measured(key, row.measured).log_xy
    if why is not None:
        predicted = _predicted(places, key, row.point)
        yield PointToMeasure(row.photo, row.point, why, before, predicted, row.residual, row.weight_factor)
    if row.rays != 1 or row.disregarded:
        return
    others = [
        other
        for other in bundle.photos
        if other != key
        and (
            row.point in places.predicted(other)
            or (other in bundle.models_of_photos.get(key, {}) and not places.can_predict(other, row.point))
        )
    ]
    for other in others:
        predicted = _predicted(places, other, row.point)
        yield PointToMeasure(bundle.photos[other], row.point, "single ray", NOWHERE, predicted, NOWHERE, NOWHERE)
    if not others:
        yield PointToMeasure(
            row.photo, row.point, "single ray", before, _predicted(places, key, row.point), NOWHERE, NOWHERE
        )


def _predicted(places: Places, photo: str, point: str) -> Pair:
    return places.predicted(photo).get(point, PredictedPlace(NOWHERE, NOWHERE)).log_xy


def _killed(bundle: BundleState, places: Places) -> list[PointToMeasure]:
    """Return the points that the measurement files would leave measured if nothing in them were killed."""
    log = bundle.state.texts.log
    raise_complaints(log.complaints)
    alive = replay(without_kills(log.value.records), bundle.records, Measured()).measured
    found = alive.observations.get(record_key(bundle.name))
    if found is None:
        return []
    there = set(_names(bundle.observations))
    rows = zip(_names(found), found.measured.tolist(), strict=True)
    killed = [(key, point, (x, y)) for (key, point), (x, y) in rows if (key, point) not in there]
    return [
        PointToMeasure(
            bundle.records.photos[key].name, point, "killed",
            before=places.measured(key, xy).log_xy if not np.isnan(xy).any() else NOWHERE,
            predicted=_predicted(places, key, point),
            residual=NOWHERE, weight_factor=NOWHERE,
        )
        for key, point, xy in killed
    ]  # fmt: skip


def _names(observations: PhotoObservations) -> Iterator[tuple[str, str]]:
    return zip(map(record_key, observations.photos), observations.points, strict=True)
