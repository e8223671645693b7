"""`orip digitise points --new`: points that the operator selects and names, model by model or photo by photo.

In each model he is offered the next free number. He measures under it, or names another point: one that another photo
has already is transferred from there, with the plate of that photo locked. ENTER leads to the next model.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from msgspec import Struct

from orip.errors import UsageError
from orip.multimodel.digitising.operator import Named
from orip.multimodel.digitising.order import Turn, next_name
from orip.multimodel.digitising.points import PointVisits, Viewing, Written
from orip.multimodel.digitising.session import Session
from orip.multimodel.digitising.setup import Digitised, DigitisingSetup
from orip.multimodel.digitising.wanted import BundlePoints, bundle_points, model_named
from orip.records.names import name_fault, record_key
from orip.wording import listed_names
from orip.workflow.control.edits import list_control
from orip.workflow.observations.films import MountedFilms


class NewPointsChoice(Struct, frozen=True):
    """Where new points are measured, and how they are numbered.

    Parameters
    ----------
    photos : tuple of str
        With one eye: only in these photos; none: in all of the bundle.
    model : str or None
        In stereo: only in this model.
    first : str
        The first name of the series, such as 1000 or G1; names that are taken are left out.
    """

    photos: tuple[str, ...] = ()
    model: str | None = None
    first: str = "1"


class _Place(NamedTuple):
    """A model, or with one eye a photo, in which points are measured; photos and model by their keys."""

    title: str
    photos: tuple[str, ...]
    model: str | None


def digitise_new_points(
    setup: DigitisingSetup,
    bundle: str | None,
    choice: NewPointsChoice,
    *,
    viewing: Viewing | None = None,
    written: Written | None = None,
) -> Digitised:
    """Digitise points that the operator selects and names.

    Parameters
    ----------
    setup : DigitisingSetup
    bundle : str or None
        None: the project's only one.
    choice : NewPointsChoice
    viewing : {"mono", "stereo"} or None
        None: stereo where the bundle has models.
    written : function or None
        Is told of each point that has been written to the log.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    fault = name_fault(choice.first)
    if fault is not None:
        message = f"--first: {fault}"
        raise UsageError(message)
    films = setup.films("solutions")
    points = bundle_points(films, bundle)
    viewing = viewing or ("stereo" if points.block.models and not choice.photos else "mono")
    places = _models(points, choice) if viewing == "stereo" else _photos(points, choice)
    taken = {fields[0] or "" for _, fields, _ in list_control(films.state, "points").rows} | set(points.measured_photos)
    with setup.session(films, f"all of it is in {films.shown_log}; repeat the command") as session:
        visits = PointVisits(session, points, viewing, again=False, written=written)
        for number, place in enumerate(places, start=1):
            session.tell(f"{place.title} ({number} of {len(places)})")
            _tell_single(session, visits, place)
            _measure(session, visits, place, _Numbers(choice.first, taken))
            if session.ending != "complete":
                break
    return setup.outcome(films, session)


def _models(points: BundlePoints, choice: NewPointsChoice) -> list[_Place]:
    if choice.photos:
        message = "photos are for one eye; name a model with --model, or add --mono"
        raise UsageError(message)
    models = sorted(points.bundle.models, key=lambda model: (model.row, model.column))
    if choice.model is not None:
        models = [model_named(points.bundle, choice.model)]
    if not models:
        message = f"bundle {points.bundle.name} has no models to see in stereo; measure with --mono"
        raise UsageError(message)
    return [
        _Place(
            f"model {model.name}: left photo {_on_stage(points.films, model.left)}, right photo "
            f"{_on_stage(points.films, model.right)}",
            (record_key(model.left), record_key(model.right)),
            record_key(model.name),
        )
        for model in models
    ]


def _photos(points: BundlePoints, choice: NewPointsChoice) -> list[_Place]:
    if choice.model is not None:
        message = "a model is for stereo; name photos with --photo"
        raise UsageError(message)
    photos: Iterable[str] = (record_key(points.films.photo(name).name) for name in choice.photos)
    photos = list(photos) or points.block.in_order(list(points.photos))
    return [_Place(f"photo {_on_stage(points.films, points.photos[photo])}", (photo,), None) for photo in photos]


def _on_stage(films: MountedFilms, photo: str) -> str:
    return f"{photo} on the {films.stage_of(photo)} stage"


def _tell_single(session: Session, visits: PointVisits, place: _Place) -> None:
    """Say which points one photo of a model has and the other has not: those to be transferred, if they are there."""
    if len(place.photos) == 2:
        left, right = (set(visits.points_of(photo)) for photo in place.photos)
        if left ^ right:
            session.tell(f"in one of the two only: {listed_names(sorted(left ^ right))}; name one to transfer it")


class _Numbers:
    """Free numbers, and names that have been taken."""

    def __init__(self, first: str, taken: set[str]) -> None:
        self._first, self._taken = first, taken

    def free(self) -> str:
        """Return the next free number."""
        return next_name(self._first, self._taken)

    def take(self, name: str) -> None:
        """Take a name."""
        self._taken.add(name)


def _measure(session: Session, visits: PointVisits, place: _Place, numbers: _Numbers) -> None:
    """Measure points in one place until there are no more, or the operator ends the session."""
    named: str | None = None
    while session.ending == "complete":
        point = named or numbers.free()
        photos = tuple(photo for photo in place.photos if not visits.is_measured(photo, point))
        if not photos:
            session.tell(f"point {point} is measured here; --point {point} --again, without --new, measures it again")
            named = None
            continue
        found = visits.offer(Turn(point, photos, place.model))
        if isinstance(found, Named):
            named = found.name
            continue
        if found.outcome == "kept" and named is None:
            return
        if found.outcome != "kept":
            numbers.take(point)
        named = None
