"""Who digitises: an operator at the plate processor, a script of what he would do, or a simulation of him.

Whoever it is, what he does comes out of the plate processor's queue of events: RIGHT (foot switch) with the plate
coordinates of both stages, LEFT, or a key. Scripts and simulations are requests that are sent in his place.
"""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.text.lines import field_lines, read_lines
from orip.files.text.shown import Parsed
from orip.multimodel.link.client import ProcessorFault
from orip.multimodel.readout import ObjectReadout
from orip.multimodel.state import Driven, Event, Guide, Position, Rotation, Side, Status
from orip.records.drive_table import DriveCode
from orip.records.measurement import FiducialsRecord, TicksRecord
from orip.records.names import name_fault, record_key
from orip.records.photo import Stage
from orip.wording import first_names, joined
from orip.workflow.observations.films import MountedFilms

_NAMED = 3
"""Marks and points that are named where there are more."""

PAUSE_S = 0.05
"""Seconds between two queries for an event: too short for an operator to notice."""

Tell = Callable[[str], None]
"""What receives a line on each event."""


class Instrument(Protocol):
    """What digitising needs of a plate processor; `orip.multimodel.link.client.PlateProcessorLink` is one."""

    def request(self, line: str) -> str:
        """Send a request."""

    def digest(self) -> str:
        """Return the SHA-256 of the drive table that is loaded."""

    def download(self, table: bytes) -> str:
        """Load a drive table."""

    def drive_plate(self, stage: Stage, x: float, y: float) -> Driven:
        """Drive one stage to plate coordinates."""

    def change_model(self, name: str) -> Driven:
        """Make a model the active one."""

    def position(self, system: Literal["OBJECT"]) -> ObjectReadout:
        """Return where the mark is in the object."""

    def plates(self) -> tuple[Position, Position]:
        """Return where the mark is on the upper and the lower plate."""

    def status(self) -> Status:
        """Return what is set."""

    def is_moving(self) -> bool:
        """Tell whether the stages are on their way."""

    def guide(self, system: Guide) -> Status:
        """Choose the guiding system."""

    def automatic(self, on: bool) -> Status:
        """Let models change at frame lines, or not."""

    def lock(self, side: Side | None) -> Status:
        """Lock a plate, or none."""

    def prism(self, side: Side | None, degrees: Rotation) -> Status:
        """Turn what one eye, or both, see."""

    def next_event(self) -> Event | None:
        """Return the oldest event; None if there is none."""


class Sought(NamedTuple):
    """A mark or point that the operator is to set the measuring mark on.

    `owner` is the `record_key` of its template (of a tick), temtick, camera (of a fiducial), or photo.
    """

    what: Literal["TICK", "MARK", "POINT", "TEMTICK", "FIDUCIAL"]
    owner: str
    name: str
    stage: Stage


class Visit(NamedTuple):
    """What is digitised with one press of the foot switch, and the request that says that it cannot be.

    Attributes
    ----------
    is_new : bool
        The name is only offered: the operator may name another point, or say that there are no more.
    locks : bool
        The left foot switch locks and unlocks a plate; else it skips.
    hint : str
        What foot switches and keys do, where that is something else.
    """

    sought: tuple[Sought, ...]
    refusal: Literal["FOOT LEFT", "KEY ENTER"]
    is_new: bool = False
    locks: bool = False
    hint: str = ""


class Named(NamedTuple):
    """The operator names what he measures next."""

    name: str


class Operator(Protocol):
    """Who sets the measuring mark."""

    def act(self, link: Instrument, visit: Visit) -> Event | Named | None:
        """Return what is done about a visit, once it is; None where the operator has ended."""


class AtTheProcessor:
    """An operator with wheels, foot switches and keys of his own.

    Parameters
    ----------
    waiting : function of a Visit, or None
        Called before he is waited for.
    typed : function or None
        Returns the next line that he has typed at the terminal; None: there is none.
    look : function of the plate processor, or None
        Called while he is waited for.
    """

    def __init__(
        self,
        waiting: Callable[[Visit], None] | None = None,
        typed: Callable[[], str | None] | None = None,
        look: Callable[[Instrument], None] | None = None,
    ) -> None:
        self._waiting, self._typed, self._look = waiting, typed, look

    def act(self, link: Instrument, visit: Visit) -> Event | Named:
        """Wait for him."""
        if self._waiting is not None:
            self._waiting(visit)
        while (event := link.next_event()) is None:
            if visit.is_new and self._typed is not None and (name := self._typed()) is not None:
                return Named(name)
            if self._look is not None:
                self._look(link)
            time.sleep(PAUSE_S)
        return event


class TypedNames:
    """Names of points typed at the terminal, which is read beside the plate processor; names at fault are reported."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._reader: threading.Thread | None = None

    def __call__(self) -> str | None:
        """Return the next name; None: nothing was typed, or nobody could."""
        if self._reader is None:
            self._reader = threading.Thread(target=self._read, daemon=True)
            self._reader.start()
        while not self._lines.empty():
            name = self._lines.get().strip()
            fault = name_fault(name)
            if fault is None:
                return name
            self._tell(f"{fault}; type a name, or press ENTER at the plate processor where there are no more points")
        return None

    def _read(self) -> None:
        if sys.stdin is not None and sys.stdin.isatty():
            for line in sys.stdin:
                self._lines.put(line)


class WaitingHint:
    """Says before each visit what is waited for; the first time for each kind, also where the operator can do it."""

    def __init__(self, tell: Tell, url: str) -> None:
        self._tell, self._url, self._said = tell, url, set[tuple[bool, bool]]()

    def __call__(self, visit: Visit) -> None:
        """Say it."""
        kind = visit.locks, visit.is_new
        if kind not in self._said:
            self._said.add(kind)
            self._tell_where(visit)
        for sought in visit.sought:
            self._tell(f"{'waiting':<10} {sought.what.lower()} {sought.name} of {sought.owner}")

    def _tell_where(self, visit: Visit) -> None:
        left = "locks or unlocks a plate" if visit.locks else "skips"
        enter = "ENTER keeps"
        if visit.is_new:
            enter = "digits and ENTER, or a name typed here, name another point, ENTER alone says no more here"
        hint = visit.hint or (
            f"the right foot switch digitises, the left one {left}; {enter}; ZERO or another key ends"
        )
        self._tell(
            f"waiting for the operator: {hint}. Press them at the plate processor, with 'orip drive foot right' or "
            "'orip drive key ENTER' in another window, or, where a drive table is loaded, on the page of "
            f"'orip drive watch --link {self._url}'"
        )


class Script:
    """Requests of a text, sent until one of them is an event.

    Parameters
    ----------
    requests : iterable of str
        May come as they are typed.
    refused : function of the request and the fault
        What to do about one that the plate processor refuses.
    """

    def __init__(self, requests: Iterable[str], refused: Callable[[str, ProcessorFault], None]) -> None:
        self._requests = iter(requests)
        self._refused = refused

    def act(self, link: Instrument, _visit: Visit) -> Event | Named | None:
        """Send requests."""
        for request in self._requests:
            if request.split()[0].upper() == "NAME":
                return Named(request.split()[1])
            try:
                send(link, request)
            except ProcessorFault as fault:
                self._refused(request, fault)
            event = link.next_event()
            if event is not None:
                return event
        return None


class Simulation:
    """An operator who finds everything where it is known to be.

    Parameters
    ----------
    places : mapping of (what, owner, name) to plate coordinates
    faults : sequence of ProjectWarning
        Why places are missing that the measurement files should give.
    """

    def __init__(self, places: Mapping[tuple[str, str, str], Position], faults: Sequence[ProjectWarning] = ()) -> None:
        self._places, self._faults = places, faults
        self._named: set[tuple[tuple[tuple[str, str], ...], str]] = set()
        self._unknown: dict[str, None] = {}
        self._outside: dict[str, None] = {}

    def warnings(self) -> Iterator[ProjectWarning]:
        """Yield why he could not set the mark where he was asked to."""
        why = ""
        if self._unknown and self._faults:
            first = self._faults[0]
            why = f": {first.where}: {first.text}" if first.where else f": {first.text}"
        if self._unknown:
            text = f"the files of --simulate do not tell where it is{why}"
            yield ProjectWarning("not-simulated", first_names(list(self._unknown), _NAMED), text)
        if self._outside:
            text = "the files of --simulate have it where the stage cannot be driven to"
            yield ProjectWarning("not-simulated", first_names(list(self._outside), _NAMED), text)

    def act(self, link: Instrument, visit: Visit) -> Event | Named | None:
        """Set the measuring mark and press the foot switch; refuse what is not known or cannot be driven to.

        Where the name is only offered, all are named that are known in the photos of the visit.
        """
        if visit.is_new and any(point[:3] not in self._places for point in visit.sought):
            owners = tuple(point[:2] for point in visit.sought)
            known = self._known(owners)
            if not known:
                self._unknown[f"any point in {joined([f'photo {owner}' for _, owner in owners])}"] = None
            for name in known:
                if (owners, name) not in self._named:
                    self._named.add((owners, name))
                    return Named(name)
            send(link, visit.refusal)
        else:
            send(link, "FOOT RIGHT" if self._can_set_mark(link, visit.sought) else visit.refusal)
        return link.next_event()

    def _known(self, owners: Sequence[tuple[str, str]]) -> list[str]:
        """Return the names that are known in all owners."""
        first, *others = ([name for *of, name in self._places if tuple(of) == owner] for owner in owners)
        return [name for name in first if all(name in of_other for of_other in others)]

    def _can_set_mark(self, link: Instrument, sought: Sequence[Sought]) -> bool:
        places = [self._places.get(point[:3]) for point in sought]
        try:
            for point, place in zip(sought, places, strict=True):
                shown = f"{point.what.lower()} {point.name} of {point.owner}"
                if place is None:
                    self._unknown[shown] = None
                    return False
                link.drive_plate(point.stage, *place)
        except ProcessorFault as fault:
            if fault.code != DriveCode.OUTSIDE_STAGE:
                raise
            self._outside[shown] = None
            return False
        return True


def send(link: Instrument, request: str) -> None:
    """Send a request, an event only when the stages have come to rest."""
    while request.split(maxsplit=1)[0].upper() in ("FOOT", "KEY") and link.is_moving():
        time.sleep(PAUSE_S)
    link.request(request)


_REQUESTS = ("FOOT", "KEY", "MOVE", "DRIVE", "GUIDE", "LOCK", "PRISM", "NAME")
"""What an operator can do at the panel, and naming a point."""


def read_script(path: Path, shown: str) -> list[str]:
    """Read a script: a request in each line.

    Raises
    ------
    InputError
        With all lines that are not requests.
    """
    text = read_lines(path, shown)
    script = script_requests(text.value, shown)
    if text.complaints or script.complaints:
        raise InputError([*text.complaints, *script.complaints])
    return script.value


def typed_requests(lines: Iterable[str], tell: Tell) -> Iterator[str]:
    """Yield requests as they are typed; report lines that are not requests."""
    for line in lines:
        found = script_requests([line], "")
        yield from found.value
        for complaint in found.complaints:
            tell(complaint.message)


def script_requests(lines: Sequence[str], shown: str) -> Parsed[list[str]]:
    """Return the requests of lines, without comments, and a complaint for each line that is not a request."""
    requests, complaints = [], []
    for line in field_lines(list(lines)):
        words = [field.text for field in line.fields]
        fault = None
        if words[0].upper() == "NAME":
            fault = name_fault(words[1]) if len(words) == 2 else "write NAME and one name"
        if fault is not None:
            complaints.append(Complaint(fault, shown, line.number))
        elif words[0].upper() in _REQUESTS:
            requests.append(" ".join(words))
        else:
            message = f"'{words[0]}' is not an operator's request; write one of {', '.join(_REQUESTS)}"
            complaints.append(Complaint(message, shown, line.number))
    return Parsed(requests, tuple(complaints))


def places_of(films: MountedFilms) -> dict[tuple[str, str, str], Position]:
    """Return by (what, owner, name) where everything that is measured is on its plate now."""
    places: dict[tuple[str, str, str], Position] = {}
    for key, template in films.definitions.templates.items():
        marks = films.ticks_on_plate(template)
        places |= {("TICK", key, name): _pair(xy) for name, xy in zip(marks.names, marks.measured, strict=True)}
    for key, photo in films.definitions.photos.items():
        marks = films.fiducials_on_plate(photo)
        places |= {("MARK", key, name): _pair(xy) for name, xy in zip(marks.names, marks.measured, strict=True)}
    for record in films.records:
        if isinstance(record, FiducialsRecord | TicksRecord):
            marks = record.marks
            owner = ("FIDUCIAL", record.camera) if isinstance(record, FiducialsRecord) else ("TEMTICK", record.temtick)
            for name, xy in zip(marks.names, marks.measured, strict=True):
                places[owner[0], record_key(owner[1]), name] = _pair(xy)
    for bundle in films.definitions.bundles:
        found = films.points_on_plate(bundle)
        places |= {("POINT", photo, point): xy for (photo, point), xy in found.items()}
    return places


def _pair(xy: Sequence[float]) -> Position:
    return float(xy[0]), float(xy[1])
