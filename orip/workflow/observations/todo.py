"""`orip observations todo`: what to measure again, as a measurement file whose coordinates are still missing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orip.errors import ProjectWarning, UsageError
from orip.files.listings.observations import todo_text
from orip.files.text.atomic import replace_text, reporting_failure
from orip.files.text.natural_order import natural_key
from orip.interior.replay import replay
from orip.records.listed_observation import ListedObservation, Pair, PointToMeasure, WhyAgain
from orip.records.measurement import Measured, PhotoObservations
from orip.records.names import record_key
from orip.workflow.observations.at_hand import BundleAtHand, bundle_at_hand
from orip.workflow.observations.listed import listed_observations
from orip.workflow.observations.names import without_kills
from orip.workflow.observations.places import NOWHERE, Place, Places
from orip.workflow.project.texts import measurement_files, raise_complaints, read_log


@dataclass(frozen=True, slots=True)
class Todo:
    """What to measure again, and the measurement file that asks for it; `file` is None where it was not written."""

    bundle: str
    points: tuple[PointToMeasure, ...]
    text: str
    file: Path | None
    warnings: tuple[ProjectWarning, ...]


def measure_again(
    folder: Path, bundle: str | None = None, output: Path | None = None, *, overwrite: bool = False
) -> Todo:
    """Return the points of a bundle that ask for a new measurement, and write them to a file if one is named.

    These are points that are down-weighted, disregarded or killed, and points that a single photo sees: they are asked
    for in the photos that make a model with it or, by the last adjustment, show them.

    Parameters
    ----------
    folder : Path
    bundle : str or None
        None: the project's only one.
    output : Path or None
        Relative to the project folder.
    overwrite : bool
        Replace a file that is there.

    Raises
    ------
    UsageError
        If the file is there already and may not be replaced.
    InputError
        If nothing is measured, or a measurement file is at fault.
    """
    at_hand = bundle_at_hand(folder, bundle)
    path = None if output is None else at_hand.project.folder / output
    if path is not None and path.exists() and not overwrite:
        message = f"{output} is there already; name another file, or replace it with --force"
        raise UsageError(message)
    points = _points_to_measure(at_hand)
    text = todo_text(points, at_hand.name, at_hand.solution.run if at_hand.solution else None)
    warnings = at_hand.warnings
    if path is not None:
        _write(path, text)
        warnings = (*warnings, *_would_be_replayed(at_hand, path))
    return Todo(at_hand.name, points, text, path, warnings)


def _write(path: Path, text: str) -> None:
    with reporting_failure(path, "choose another file"):
        replace_text(path, text)


def _would_be_replayed(at_hand: BundleAtHand, path: Path) -> Iterator[ProjectWarning]:
    if path.resolve() in {each.resolve() for each in measurement_files(at_hand.project).records}:
        text = (
            "is among the project's measurement files by its name: 'orip measure' and 'orip run' will complain of it "
            "until its coordinates are filled in; give it another extension than they have to avoid that"
        )
        yield ProjectWarning("unfinished-measurements", at_hand.project.shown(path), text)


def _points_to_measure(at_hand: BundleAtHand) -> tuple[PointToMeasure, ...]:
    places = Places(at_hand)
    again = _killed(at_hand, places)
    again += [each for row in listed_observations(at_hand) for each in _of_observation(at_hand, row, places)]
    order = {key: place for place, key in enumerate(at_hand.definitions.photos)}
    # one line a point and photo: what is wrong there says more than that another photo alone sees the point
    again.sort(key=lambda each: each.why != "single ray")
    first = {(record_key(each.photo), each.point): each for each in again}
    return tuple(
        sorted(first.values(), key=lambda each: (order[record_key(each.photo)], natural_key(each.point), each.point))
    )


def _of_observation(at_hand: BundleAtHand, row: ListedObservation, places: Places) -> Iterator[PointToMeasure]:
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
        for other in at_hand.photos
        if other != key
        and (
            row.point in places.predicted(other)
            or (other in at_hand.models_of(key) and not places.can_predict(other, row.point))
        )
    ]
    for other in others:
        predicted = _predicted(places, other, row.point)
        yield PointToMeasure(at_hand.photos[other], row.point, "single ray", NOWHERE, predicted, NOWHERE, NOWHERE)
    if not others:
        yield PointToMeasure(
            row.photo, row.point, "single ray", before, _predicted(places, key, row.point), NOWHERE, NOWHERE
        )


def _predicted(places: Places, photo: str, point: str) -> Pair:
    return places.predicted(photo).get(point, Place(NOWHERE, NOWHERE)).log_xy


def _killed(at_hand: BundleAtHand, places: Places) -> list[PointToMeasure]:
    """Return the points that the measurement files would leave measured if nothing in them were killed."""
    log = read_log(at_hand.project)
    raise_complaints(log.complaints)
    alive = replay(without_kills(log.records.records), at_hand.definitions, Measured()).measured
    found = alive.observations.get(record_key(at_hand.name))
    if found is None:
        return []
    there = set(_names(at_hand.observations))
    rows = zip(_names(found), found.measured.tolist(), strict=True)
    killed = [(key, point, (x, y)) for (key, point), (x, y) in rows if (key, point) not in there]
    return [
        PointToMeasure(
            at_hand.definitions.photos[key].name, point, "killed",
            before=places.measured(key, xy).log_xy if not np.isnan(xy).any() else NOWHERE,
            predicted=_predicted(places, key, point),
            residual=NOWHERE, weight_factor=NOWHERE,
        )
        for key, point, xy in killed
    ]  # fmt: skip


def _names(observations: PhotoObservations) -> Iterator[tuple[str, str]]:
    return zip(map(record_key, observations.photos), observations.points, strict=True)
