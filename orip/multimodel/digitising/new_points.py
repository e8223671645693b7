"""`orip digitise points --new` and `orip digitise ground`: points that the operator selects in an oriented model."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct

from orip.errors import InputError, ProjectWarning, UsageError
from orip.files.control.editing import ControlKind
from orip.files.log.writing import read_work_list
from orip.multimodel.digitising.operator import Named, Sought, Visit
from orip.multimodel.digitising.order import Turn, next_name, numbered
from orip.multimodel.digitising.points import PointVisits, Viewing, Written
from orip.multimodel.digitising.session import Ending, Entry, Outcome, Session
from orip.multimodel.digitising.setup import Digitised, DigitisingSetup
from orip.multimodel.digitising.wanted import BundlePoints, bundle_points, model_named
from orip.multimodel.table import object_ground
from orip.records.definition import StereoModel
from orip.records.drive_table import Triple
from orip.records.ground import GroundSystem
from orip.records.names import name_fault, record_key
from orip.wording import listed_names
from orip.workflow.observations.control import ControlTable, add_control, list_control
from orip.workflow.observations.films import MountedFilms, mounted_films
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import carry_out
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.texts import EDITS_FILE, raise_complaints
from orip.workflow.records.commands import read_records

# In each model he is offered the next free number. He measures under it, or names another point: one that another photo
# has already is transferred from there, with the plate of that photo locked. ENTER leads to the next model.


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
    bundle : str or None
        None: the project's only one.
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


Target = Literal["PNT", "PRE"]


class GroundPoint(Struct, frozen=True):
    """A point as it was set in the model: its coordinates in the project, and the y-parallax that was left (mm)."""

    name: str
    outcome: Outcome
    xyz: Triple | None
    y_parallax: float | None


class GroundChoice(Struct, frozen=True):
    """Which points are taken, and where they go.

    Parameters
    ----------
    target : {"PNT", "PRE"}
        Control points, or preliminary coordinates of the bundle.
    file : Path or None
        A list of names, relative to the project folder.
    first : str or None
        Without names: the first name of a series without end, such as 1000 or G1.
    error : float or None
        A-priori error of control points: positive, 0 for constants, negative for check points.
    """

    model: str
    target: Target
    names: tuple[str, ...] = ()
    file: Path | None = None
    first: str | None = None
    error: float | None = None


class GroundDigitised(Struct, frozen=True):
    """What was taken, and the file that it is in."""

    file: str
    points: tuple[GroundPoint, ...]
    ending: Ending
    warnings: tuple[ProjectWarning, ...]


def digitise_ground(setup: DigitisingSetup, bundle: str | None, choice: GroundChoice) -> GroundDigitised:
    """Take ground coordinates from a model of the last adjustment; each is in its file before the next is asked for.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    if choice.target == "PNT" and choice.error is None:
        message = "a control point needs an a-priori error; say --error 0.05 (0: constant, negative: check point)"
        raise UsageError(message)
    films = mounted_films(setup.folder, Path(EDITS_FILE), "solutions")
    definition = films.bundle(bundle)
    ground = _ground(BundleState(films.state, definition.name))
    model = model_named(definition, choice.model)
    kind: ControlKind
    kind, of_bundle = ("points", None) if choice.target == "PNT" else ("preliminary", definition.name)
    table = list_control(films.state, kind, of_bundle)
    names, file = _names(films, choice, table), table.shown
    points: list[GroundPoint] = []
    with setup.session(films, f"all of it is in {file}; go on with the points that are left") as session:
        session.link.change_model(model.name)
        session.link.guide("OBJECT")
        for name in names:
            point = _take(session, films, model, name, ground)
            if point is None:
                break
            if point.xyz is not None:
                words = _words(point.xyz, choice.error if choice.target == "PNT" else None)
                carry_out(
                    read_records(setup.folder),
                    partial(add_control, kind=kind, name=name, words=words, bundle=of_bundle),
                )
            points.append(point)
            session.enter(Entry("ground point", model.name, name, point.outcome, "nowhere", None, None))
    return GroundDigitised(file, tuple(points), session.ending, (*ground.warnings, *session.warnings))


def _take(
    session: Session, films: MountedFilms, model: StereoModel, name: str, ground: GroundSystem
) -> GroundPoint | None:
    """Let the operator set the mark on a point; None where he ends."""
    session.tell(f"at ground point {name} in model {model.name}")
    sought = tuple(
        Sought("POINT", record_key(photo), name, films.stage_of(photo)) for photo in (model.left, model.right)
    )
    decision = session.decision(Visit(sought, "FOOT LEFT"))
    if decision.outcome is None:
        return None
    if decision.outcome != "digitised":
        return GroundPoint(name, decision.outcome, None, None)
    found = session.link.position("OBJECT")
    x, y, z = ground.to_project(np.array([found.xyz]))[0].tolist()
    return GroundPoint(name, decision.outcome, (x, y, z), found.y_parallax)


def _ground(bundle: BundleState) -> GroundSystem:
    solution = bundle.solution
    if solution is None:
        message = (
            f"bundle {bundle.name} has not been adjusted yet: its models give no ground coordinates; run 'orip solve'"
        )
        raise InputError.single(message)
    return object_ground(bundle.project.definition.crs, solution.ground_unit, solution)


def _words(xyz: Triple, error: float | None) -> list[str]:
    words = [f"{axis}={value:z.4f}" for axis, value in zip("XYZ", xyz, strict=True)]
    return words if error is None else [*words, *(f"a{axis}={error:g}" for axis in "XYZ")]


def _names(films: MountedFilms, choice: GroundChoice, table: ControlTable) -> Iterable[str]:
    """Return the names to ask for: those that were given, or a series that leaves out what is there."""
    there = {fields[0] for _, fields, _ in table.rows}
    given = [*choice.names, *(_listed(films.project, choice.file) if choice.file is not None else ())]
    if bool(given) == (choice.first is not None):
        message = "name the points, in a list with --list or one by one, or say with --first how they are numbered"
        raise UsageError(message)
    if choice.first is not None:
        return (name for name in numbered(choice.first) if name not in there)
    known = [name for name in dict.fromkeys(given) if name in there]
    if known:
        message = f"in {table.shown} already: {', '.join(known)}; take them out of the list, or out of that file"
        raise InputError.single(message)
    return list(dict.fromkeys(given))


def _listed(project: ProjectFolder, file: Path) -> list[str]:
    path = project.folder / file
    found = read_work_list(path, project.shown(path))
    raise_complaints(found.complaints)
    return [row.point for row in found.value]
