"""`orip digitise points`: photo points visited in one photo or in stereo, and written as lines of the log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

from orip.errors import ProjectWarning, UsageError
from orip.files.log.writing import kill_line, measurement_line, points_header
from orip.multimodel.digitising.operator import Named, Sought, Visit
from orip.multimodel.digitising.order import DigitisingStep, Turn, from_point
from orip.multimodel.digitising.session import Decision, DriveTarget, Entry, Session
from orip.multimodel.digitising.setup import Digitised, DigitisingSetup
from orip.multimodel.digitising.wanted import BundlePoints, PointChoice, bundle_points, wanted_points
from orip.multimodel.link.client import ProcessorFault
from orip.multimodel.state import Position, Rotation, Side
from orip.records.drive_table import DriveCode
from orip.records.photo import Stage

Viewing = Literal["mono", "stereo"]

Written = Callable[[str, str, Position | None], None]
"""Is told of each point that has been written to the log: photo, point, and coordinates; None: it was deleted."""


class PointVisits:
    """The points of a session: what was measured before or is by now, and the blocks of the current chapter."""

    def __init__(
        self, session: Session, points: BundlePoints, viewing: Viewing, *, again: bool, written: Written | None = None
    ) -> None:
        self._session, self._points, self._viewing, self._again = session, points, viewing, again
        self._written = written
        self._measured = dict(points.measured)
        self._blocks: dict[str, dict[str, str]] = {}
        self._chapter: str | None = None
        self._shown: dict[Stage, str] = {}
        status = session.link.status()
        self._active, self._prisms = status.model, status.prisms

    def take(self, turn: Turn) -> None:
        """Digitise a point in the photos of its turn."""
        left = list(turn.photos)
        while left and self._session.ending == "complete":
            rest = turn._replace(photos=tuple(left))
            step = self._step(rest)
            self._begin_chapter(turn.model or step.model, step)
            self._visit(turn.point, step)
            left = [photo for photo in left if photo not in step.photos]

    def offer(self, turn: Turn) -> Decision | Named:
        """Offer a name, and digitise the point in the photos of its turn unless the operator decides otherwise."""
        step = self._step(turn)
        self._begin_chapter(turn.model or step.model, step)
        found = self._visit(turn.point, step, is_new=True)
        if isinstance(found, Decision) and found.outcome == "digitised":
            self.take(turn._replace(photos=tuple(photo for photo in turn.photos if photo not in step.photos)))
        return found

    def is_measured(self, photo: str, point: str) -> bool:
        """Tell whether a point is measured in a photo, before this session or in it."""
        return (photo, point) in self._measured

    def points_of(self, photo: str) -> list[str]:
        """Return the points that are measured in a photo."""
        return [point for of, point in self._measured if of == photo]

    def _step(self, turn: Turn) -> DigitisingStep:
        return self._mono(turn) if self._viewing == "mono" else self._stereo(turn)

    def _mono(self, turn: Turn) -> DigitisingStep:
        return DigitisingStep(turn.photos[:1], None, None)

    def _stereo(self, turn: Turn) -> DigitisingStep:
        measured = [photo for photo, point in self._measured if point == turn.point and photo not in turn.photos]
        return self._points.block.next_step(turn, measured)

    def _begin_chapter(self, model: str | None, step: DigitisingStep) -> None:
        """Begin a chapter of the log with each model, or photo where models have no part."""
        if self._again:
            title = "orip digitise points --again"
        elif self._viewing == "mono":
            title = f"orip digitise points, photo {self._points.photos[step.photos[0]]}"
        else:
            title = "orip digitise points" + (f", model {model}" if model else "")
        if title != self._chapter:
            self._session.log.chapter(title)
            self._chapter, self._blocks = title, {}

    def _visit(self, point: str, step: DigitisingStep, *, is_new: bool = False) -> Decision | Named:
        """Drive to a point, and put into the log what is decided about it; `is_new`: its name is only offered."""
        session, stages = self._session, self._points.block.stages
        session.link.lock(None)
        self._change_model(step.model)
        if step.partner is not None:
            session.drive(stages[step.partner], DriveTarget("measured before", self._measured[step.partner, point]))
            self._shown[stages[step.partner]] = step.partner
        places = {photo: self._drive(photo, point) for photo in step.photos}
        self._prepare(step)
        against = f", against {step.partner}" if step.partner else ""
        shown = " and ".join(f"{self._points.photos[photo]} ({place.known})" for photo, place in places.items())
        session.tell(f"at {'new ' if is_new else ''}point {point} in {shown}{against}")
        sought = tuple(Sought("POINT", photo, point, stages[photo]) for photo in step.photos)
        decision = self._decision(sought, step, is_new=is_new)
        is_done = isinstance(decision, Decision) and decision.outcome is not None
        if isinstance(decision, Decision) and is_done and not (is_new and decision.outcome == "kept"):
            for photo, place in places.items():
                self._enter(photo, point, place, decision)
        return decision

    def _drive(self, photo: str, point: str) -> DriveTarget:
        """Drive to where a point may be; where nothing tells, to the middle of its photo unless that is shown."""
        stage, place = self._points.block.stages[photo], self._points.place(photo, point, again=self._again)
        if place.known == "middle" and self._shown.get(stage) == photo:
            place = DriveTarget("nowhere", None)
        self._shown[stage] = photo
        return self._session.drive(stage, place)

    def _change_model(self, model: str | None) -> None:
        """Make a model the active one; a plate processor without a drive table has none, and needs none."""
        if model is None or model == self._active:
            return
        try:
            self._active = self._session.link.change_model(model).model
        except ProcessorFault as fault:
            if fault.code != DriveCode.NO_TABLE:
                raise

    def _prepare(self, step: DigitisingStep) -> None:
        """Guide the stages that are free, lock that of the partner, and turn the prisms to a side lap and back."""
        stages = self._points.block.stages
        turn: Rotation = 90 if self._points.block.is_side_lap(step) else 0
        if self._prisms != (turn, turn):
            self._prisms = self._session.link.prism(None, turn).prisms
            if turn:
                self._session.tell("side lap: the prisms are turned by 90 degrees")
        self._session.link.guide(stages[step.photos[0]] if len(step.photos) == 1 else "BOTH")
        if step.partner is not None:
            self._session.link.lock(self._side(stages[step.partner]))

    def _side(self, stage: Stage) -> Side:
        """Return the side of the active model on which a stage is seen; without one it is as the eyepieces are."""
        for model in self._points.block.models:
            if model.model == self._active:
                return "LEFT" if self._points.block.stages.get(model.left) == stage else "RIGHT"
        return "LEFT" if stage == "UPPER" else "RIGHT"

    def _decision(self, sought: tuple[Sought, ...], step: DigitisingStep, *, is_new: bool) -> Decision | Named:
        """Return what the operator decides; in stereo his left foot locks and unlocks, with one eye it skips."""
        left_switch = None if self._viewing == "mono" else partial(self._lock_or_unlock, step)
        visit = Visit(sought, "FOOT LEFT" if left_switch is None and not is_new else "KEY ENTER", is_new)
        decide = self._session.decision_or_name if is_new else self._session.decision
        return decide(visit._replace(locks=left_switch is not None), left_switch=left_switch)

    def _lock_or_unlock(self, step: DigitisingStep) -> None:
        link = self._session.link
        side: Side = self._side(self._points.block.stages[step.partner]) if step.partner else "LEFT"
        link.lock(None if link.status().lock else side)

    def _enter(self, photo: str, point: str, place: DriveTarget, decision: Decision) -> None:
        """Put what was decided into the log and the account."""
        session, name, outcome = self._session, self._points.photos[photo], decision.outcome or "kept"
        logged: Position | None = None
        xy = decision.at(self._points.block.stages[photo])
        if xy is not None:
            self._measured[photo, point] = xy
            logged = self._points.to_log(photo, xy)
            header = points_header(self._points.bundle.name, name)
            block = self._blocks.setdefault(header, {})
            block[point] = measurement_line(point, logged)
            session.log.put(header, block.values())
        elif outcome == "skipped" and self._measured.pop((photo, point), None) is not None:
            session.log.edit(kill_line(self._points.bundle.name, name, point))
            self._blocks = {}
        session.enter(Entry("point", name, point, outcome, place.known, place.xy, logged))
        if self._written is not None and (logged is not None or outcome == "skipped"):
            self._written(name, point, logged)


def digitise_points(
    setup: DigitisingSetup,
    bundle: str | None,
    choice: PointChoice,
    *,
    viewing: Viewing | None = None,
    start: str | None = None,
    written: Written | None = None,
) -> Digitised:
    """Digitise photo points of a bundle.

    New points are visited model by model (with one eye photo by photo), those of a list too; with `choice.again` point
    by point. See `orip.multimodel.digitising.order` for stereo partners and the transfer of points.

    Parameters
    ----------
    bundle : str or None
        None: the project's only one.
    viewing : {"mono", "stereo"} or None
        None: stereo where the bundle has models.
    start : str or None
        The point to begin with.
    written : function or None
        Is told of each point that has been written to the log.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    films = setup.films("solutions")
    points = bundle_points(films, bundle)
    wanted = wanted_points(points, choice)
    for photo in {photo for photos in wanted.values() for photo in photos}:
        films.stage_of(points.films.definitions.photos[photo].name)
    viewing = viewing or ("stereo" if points.block.models else "mono")
    turns = _turns(points, wanted, viewing, again=choice.again)
    if start is not None:
        turns = _from(turns, start)
    repeat = "repeat the command, with --from POINT" if choice.again or choice.file else "repeat the command"
    with setup.session(films, f"all of it is in {films.shown_log}; {repeat}") as session:
        visits = PointVisits(session, points, viewing, again=choice.again, written=written)
        if not turns:
            session.warnings.append(_nothing_to_digitise(points))
        for turn in turns:
            visits.take(turn)
            if session.ending != "complete":
                break
    return setup.outcome(films, session)


def _turns(points: BundlePoints, wanted: dict[str, list[str]], viewing: Viewing, *, again: bool) -> list[Turn]:
    block = points.block
    if again:
        return list(block.turns_by_point(wanted))
    if viewing == "mono":
        return list(block.turns_by_photo(wanted))
    elsewhere = {
        point: [photo for photo in photos if photo not in wanted.get(point, ())]
        for point, photos in points.measured_photos.items()
    }
    return list(block.turns_by_model(wanted, elsewhere))


def _from(turns: Sequence[Turn], start: str) -> list[Turn]:
    rest = from_point(turns, start)
    if rest is None:
        message = f"point {start} is not among those to digitise; see them with --dry-run"
        raise UsageError(message)
    return list(rest)


def _nothing_to_digitise(points: BundlePoints) -> ProjectWarning:
    text = (
        "nothing to digitise: what these photos should show by the last adjustment is measured in them; name other "
        "points with --point or --list, or measure again with --again"
    )
    return ProjectWarning("nothing-to-digitise", f"bundle {points.bundle.name}", text)
