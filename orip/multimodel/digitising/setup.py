"""What a session of digitising takes, and what it leaves: the account, and whether the log counts as it stands."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from math import dist
from pathlib import Path

from msgspec import Struct

from orip.errors import LinkError, OripError, ProjectWarning
from orip.files.log.writing import Log, LogFile, NoLog
from orip.multimodel.digitising.operator import (
    AtTheProcessor,
    Instrument,
    Operator,
    Script,
    Simulation,
    Tell,
    TypedNames,
    WaitingHint,
    places_of,
    read_script,
    typed_requests,
)
from orip.multimodel.digitising.screen import Screen
from orip.multimodel.digitising.session import Ending, Entry, Rehearsal, Session
from orip.multimodel.link.client import ProcessorFault, host_link
from orip.multimodel.state import Position
from orip.records.interior import MarkAdjustment
from orip.records.names import record_key
from orip.workflow.observations.films import MountedFilms, films_of, mounted_films, plate_of_log, position
from orip.workflow.project.outputs import remove_leftovers_of_kills
from orip.workflow.project.state import Part

_SAME_PLACE = 0.5e-4
"""Plate units: half the last digit of a log."""


class Digitised(Struct, frozen=True):
    """What was digitised.

    Parameters
    ----------
    log : str
        The file that it was written to, as the user would name it.
    is_trial : bool
        It would be so: nothing was driven or written.
    entries : tuple of Entry
        In the order of digitising.
    ending : str
        Whether everything was visited, or who ended it.
    orientations : tuple of MarkAdjustment
        Of templates or photos whose marks suffice.
    """

    log: str
    is_trial: bool
    entries: tuple[Entry, ...]
    ending: Ending
    orientations: tuple[MarkAdjustment, ...]
    warnings: tuple[ProjectWarning, ...]

    def count(self, outcome: str) -> int:
        """Return how many entries have an outcome."""
        return sum(entry.outcome == outcome for entry in self.entries)


class DigitisingSetup(Struct, frozen=True):
    """Where and how marks and points are digitised.

    Parameters
    ----------
    path : Path
        Measurement text that is written to, relative to the project folder.
    operator : function of the films
    log : function of the films
    tell : function of a line
    is_trial : bool
        Nothing is driven or written.
    """

    folder: Path
    path: Path
    link: Callable[[], AbstractContextManager[Instrument]]
    operator: Callable[[MountedFilms], Operator]
    log: Callable[[MountedFilms], Log]
    tell: Tell
    is_trial: bool = False

    def films(self, *parts: Part) -> MountedFilms:
        """Return the films as the measurement texts leave them, with parts of the stores; see `mounted_films`."""
        return mounted_films(self.folder, self.path, *parts)

    @contextmanager
    def session(self, films: MountedFilms, going_on: str) -> Iterator[Session]:
        """Open a session: the model is held while stages are driven, and the plate processor is left as it was found.

        A session that is interrupted tells how much was digitised, and by `going_on` where that is and how to go on.
        """
        operator, log = self.operator(films), self.log(films)
        with self.link() as link:
            session, before = Session(link, operator, log, self.tell), link.status()
            try:
                link.automatic(False)
                yield session
                if isinstance(operator, Simulation):
                    session.warnings += operator.warnings()
            except (KeyboardInterrupt, OripError):
                done = session.digitised
                self.tell(f"{done} digitised so far; {going_on}" if done else "nothing is digitised yet")
                raise
            finally:
                with suppress(LinkError):
                    link.lock(None)
                    link.guide(before.guide)
                    link.automatic(before.automatic)

    def outcome(self, films: MountedFilms, session: Session, orientations: Sequence[MarkAdjustment] = ()) -> Digitised:
        """Return the outcome of a session, with warnings of what does not count when the log is replayed."""
        entries = tuple(session.entries)
        warnings = (*films.warnings, *session.warnings)
        if not self.is_trial:
            after = self.films()
            warnings = (*session.warnings, *after.warnings, *_without_effect(after, entries))
        return Digitised(
            films.shown_log, self.is_trial, entries, session.ending, tuple(orientations),
            tuple(dict.fromkeys(warnings)),
        )  # fmt: skip


def log_file(films: MountedFilms) -> LogFile:
    """Return the log of a session in its file."""
    remove_leftovers_of_kills(films.project)
    return LogFile(films.log, films.shown_log, f"measured for {films.project.owner}")


def by_link(
    folder: Path,
    path: Path,
    url: str,
    tell: Tell,
    *,
    simulate: Sequence[Path] = (),
    script: Path | None = None,
    screen: Screen | None = None,
) -> DigitisingSetup:
    """Return the means of digitising at a plate processor.

    Parameters
    ----------
    folder, path : Path
        See `DigitisingSetup`.
    url : str
        See `orip.multimodel.link.client.host_link`.
    tell : function of a line
    simulate : sequence of Path
        Measurement files; everything is digitised where they have it. Relative ones are in the project folder.
    script : Path or None
        What the operator does, a request in each line; ``-``: as it is typed. With neither of both, the events of the
        plate processor.
    screen : Screen or None
        Shows what is told, and the plates while the operator is waited for.
    """
    tell = tell if screen is None else screen.tell

    def operator(films: MountedFilms) -> Operator:
        if screen is not None:
            screen.project = films.project.definition.name
        if simulate:
            simulated = films_of(films, simulate)
            return Simulation(places_of(simulated), simulated.warnings)
        if script is None and screen is not None:
            return AtTheProcessor(screen.waiting, TypedNames(tell), screen.look)
        if script is None:
            return AtTheProcessor(WaitingHint(tell, url), TypedNames(tell))
        if str(script) == "-":
            return Script(typed_requests(sys.stdin, tell), lambda _request, fault: tell(str(fault)))
        return Script(read_script(films.project.folder / script, str(script)), _stop_at)

    return DigitisingSetup(folder, path, lambda: host_link(url), operator, log_file, tell)


def _stop_at(request: str, fault: ProcessorFault) -> None:
    message = f"'{request}' of the script: {fault}"
    raise LinkError(message)


def rehearsal(folder: Path, path: Path, tell: Tell) -> DigitisingSetup:
    """Return the means of a dry run: the order and the places without a link, and nothing is written."""
    stand_in = Rehearsal()
    return DigitisingSetup(
        folder, path, lambda: nullcontext(stand_in), lambda _: stand_in, lambda _: NoLog(), tell, is_trial=True
    )


def _without_effect(films: MountedFilms, entries: Sequence[Entry]) -> Iterator[ProjectWarning]:
    """Warn of what a later text measures again, deletes or disregards."""
    places, disregarded = places_of(films), _disregarded(films)
    for entry in entries:
        if entry.outcome != "digitised" or entry.xy is None:
            continue
        key = (entry.what.upper(), record_key(entry.owner), entry.name)
        where = f"{entry.what} {entry.name} of {entry.owner}"
        found = places.get(key)
        if found is None or dist(found, _on_plate(films, entry, entry.xy)) > _SAME_PLACE:
            text = "was digitised, but has no effect: a file that is replayed later measures it again, or deletes it"
            yield ProjectWarning("does-not-count", where, text)
        elif key[1:] in disregarded:
            text = "was digitised, but is still disregarded; 'orip observations include' gives it weight again"
            yield ProjectWarning("disregarded", where, text)


def _disregarded(films: MountedFilms) -> set[tuple[str, str]]:
    return {
        (record_key(photo), point)
        for found in films.measured.observations.values()
        for photo, point, off in zip(found.photos, found.points, found.disregarded.tolist(), strict=True)
        if off
    }


def _on_plate(films: MountedFilms, entry: Entry, logged: Position) -> Position:
    scan = None  # fiducial marks and tick marks of records are digitised on the plate
    if entry.what == "tick":
        scan = films.template(entry.owner).scan
    elif entry.what in ("mark", "point"):
        scan = films.scan_of(films.photo(entry.owner))
    return position(plate_of_log(scan), logged)
