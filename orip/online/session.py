"""A session of measuring in a project: every measurement is in the log on the disk before it is answered."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.errors import UnknownNameError, UsageError
from orip.files.control.text import CONTROL_EXTENSIONS
from orip.files.log.writing import DECIMALS, LogFile, edit_line, measurement_line, points_header
from orip.geometry.plane import PlaneTransformation
from orip.interior.in_force import stored_to_log
from orip.online.answers import Answer, words_of
from orip.online.block.first_photos import THOROUGH, solution_of_what_is_measured
from orip.online.block.measurements import left_to_the_adjustment, places_of
from orip.online.block.online_block import OnlineBlock
from orip.online.film_marks import FilmMarks, MarkEdit, chosen, marks_of, require_dispensable
from orip.online.measuring import Measuring
from orip.online.requests import Background, Operation
from orip.records.measurement import EditRecord, PhotoObservations, TextPlace, no_observations
from orip.records.names import record_key
from orip.structs import replace
from orip.workflow.adjust.gathering import block_input_so_far
from orip.workflow.observations.films import mounted_films
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.outputs import remove_leftovers_of_kills
from orip.workflow.project.texts import EDITS_FILE

# The log is authoritative, as everywhere: what a session knows follows from the measurement files, and a session that
# is started again after a crash is where it was. Lines that others append to measurement files are taken as
# measurements.
#
# An answer is waited for as long as agreed; what takes longer, or follows from it, is told later.

LOG = Path(EDITS_FILE)
"""Where measurements are written: it is replayed after all other measurement files."""

ANSWERED_WITHIN_S = 0.05
"""Seconds that an answer is waited for where somebody measures."""

_DECIMALS = 9
"""Decimals of typed coordinates that count: a millionth of a millimetre shows in the last printed digits."""

What = Literal["POINT", "MARK", "TICK"]


class _Undo(Struct, frozen=True):
    """How the last request is undone: what was measured of a point or mark in a photo before it; None: nothing."""

    photo: str
    point: str
    xy: tuple[float, float] | None
    what: What = "POINT"


class OnlineSession:
    """A session in a project.

    Parameters
    ----------
    bundle : str or None
        None: the project's only one.
    seconds : float or None
        How long an answer is waited for; None: as long as it takes.

    Raises
    ------
    InputError, UsageError
        If the project cannot be read, its measurement files hold faults, or the bundle keeps repeated measurements.
    """

    def __init__(self, folder: Path, bundle: str | None, seconds: float | None = None) -> None:
        self._folder, self._seconds = folder, seconds
        self._films = mounted_films(folder, LOG, "heads")
        self.bundle = self._films.bundle(bundle)
        control = self._films.state.texts.control_of(self.bundle.name)
        left = left_to_the_adjustment(self._films.project.definition.rigs, control)
        self.warnings = (*self._films.warnings, *left)
        if self.bundle.repeated_points == "both":
            message = (
                f'bundle {self.bundle.name} has repeated_points = "both", and a session replaces what is measured '
                'again; use "replace" or "mean"'
            )
            raise UsageError(message)
        remove_leftovers_of_kills(self._films.project)
        self._file = LogFile(
            self._films.log, self._films.shown_log, f"measured on-line for {self._films.project.owner}"
        )
        self._file.chapter("orip online")
        self._blocks: dict[str, dict[str, str]] = {}
        self._undo: list[_Undo] = []
        self._wake: Callable[[], None] = lambda: None
        self._seen, self._seen_control = self._files_now(), self._control_now()
        self._begin()

    @property
    def measuring(self) -> Measuring:
        """Return what is measured, when nothing is under way any more."""
        return self._background.measuring()

    @property
    def changes(self) -> int:
        """Return the number of requests that may have changed what is measured, since it was read."""
        return self._background.count

    @property
    def is_busy(self) -> bool:
        """Return whether something is still being reconsidered."""
        return self._background.is_busy

    def on_news(self, wake: Callable[[], None]) -> None:
        """Have a function called, in any thread, when `reconsidered` may have something to say."""
        self._wake = self._background.wake = wake

    def reconsidered(self) -> Iterator[Answer]:
        """Yield the answers that have changed since they were given, and those that took longer than was waited for."""
        return self._background.reconsidered()

    def measure(self, photo: str, point: str, xy: tuple[float, float]) -> Answer:
        """Write a measurement to the log, then answer it.

        Parameters
        ----------
        xy : tuple
            As in a measurement file.

        Raises
        ------
        UsageError
            If the photo is not defined or not oriented; nothing is written then.
        OripError
            If the log cannot be written.
        """
        record = self._films.photo(photo)
        # as the log has them: a session that starts from it has the same figures
        xy = round(xy[0], _DECIMALS), round(xy[1], _DECIMALS)
        stored = self._to_stored(record.name, xy)
        if record_key(record.name) not in self._films.interior.to_photo:
            message = f"photo {record.name} has no interior orientation; measure its fiducial marks first"
            raise UsageError(message)
        before = self._places.get((record.name, point))
        self._undo.append(_Undo(record.name, point, None if before is None else self.to_log(record.name, before)))
        self._write(record.name, point, xy, again=before is not None)
        return self._measure(record.name, point, stored)

    def written(self, photo: str, point: str, xy: tuple[float, float] | None) -> Answer | None:
        """Answer a measurement that this program has written to a measurement file itself.

        Parameters
        ----------
        xy : tuple or None
            As in the file; None: what was measured of the point there is deleted, and there is no answer.
        """
        name = self._films.photo(photo).name
        self._seen = self._files_now()
        if xy is not None:
            as_written = round(xy[0], DECIMALS), round(xy[1], DECIMALS)
            return self._measure(name, point, self._to_stored(name, as_written))
        if self._places.get((name, point)) is not None:
            self._remove(name, point)
        return None

    def remove(self, photo: str, point: str) -> None:
        """Delete what was measured of a point in a photo."""
        name, before = self._required(photo, point)
        self._undo.append(_Undo(name, point, self.to_log(name, before)))
        self._edit("KILL", name, point)
        self._remove(name, point)

    def exclude(self, photo: str, point: str) -> Answer:
        """Leave a photo point out."""
        name, _ = self._required(photo, point)
        self._edit("DISREGARD", name, point)
        return self._answered(name, point, partial(Measuring.exclude, photo=name, point=point))

    def include(self, photo: str, point: str) -> Answer:
        """Take a photo point in again."""
        name, _ = self._required(photo, point)
        self._edit("INCLUDE", name, point)
        return self._answered(name, point, partial(Measuring.include, photo=name, point=point))

    def decide(self, words: str, *, is_excluded: bool) -> Answer:
        """Leave out what is given, or take it in again, as long as the session lasts: by an update of its equations.

        Raises
        ------
        UnknownNameError
            If nothing that was given is called so.
        """
        block = self.measuring.block
        known = dict.fromkeys([*block.equations.included, *block.left_out])
        key = next((key for key in known if key.kind != "photo" and words_of(key) == words), None)
        if key is None:
            given = [words_of(key) for key in known if key.kind != "photo"]
            raise UnknownNameError(words, "observation with an a-priori error called", given)
        change = Measuring.leave_out if is_excluded else Measuring.take_in
        pending = Answer(key.photo, key.point, "unchecked", f"{words}: the answer follows", is_pending=True)
        return self._background.ask(partial(change, key=key)) or pending

    def undo(self) -> Answer | None:
        """Undo the last measurement or removal; None: the point is not measured any more.

        Raises
        ------
        UsageError
            If there is none in this session.
        """
        if not self._undo:
            message = "nothing has been measured in this session that could be undone"
            raise UsageError(message)
        last, found = self._undo.pop(), None
        if last.what != "POINT":
            self.mark(last.photo, last.what, last.point, last.xy or "KILL")
        elif last.xy is None:
            self.remove(last.photo, last.point)
        else:
            found = self.measure(last.photo, last.point, last.xy)
        self._undo.pop()
        return found

    def marks(self, photo: str) -> list[FilmMarks]:
        """Return the marks that can be measured in the image of a photo."""
        return marks_of(self._films, self._films.photo(photo))

    def mark(self, photo: str, what: str, name: str, to: tuple[float, float] | MarkEdit) -> FilmMarks:
        """Write the place of a fiducial or tick mark, or an edit, to the log; return what the marks give then.

        Raises
        ------
        UsageError
            If there is no such mark, or what is measured needs it; nothing is written then.
        """
        marks = chosen(self._films, photo, what, name)
        if isinstance(to, str):
            require_dispensable(self._films, marks, name, to)
            self._edit(to, marks.owner, name, marks.what)
        else:
            if self._blocks.keys() != {marks.header}:  # a mounting of its own: points of before stay on the film
                self._file.chapter("orip online")
                self._blocks = {marks.header: {}}
            self._file.put(marks.header, marks.lines(name, to))
        if to not in ("DISREGARD", "INCLUDE"):
            self._undo.append(_Undo(photo, name, marks.place(name), marks.what))
        self._films, self._seen = mounted_films(self._folder, LOG, "heads"), self._files_now()
        self._begin()  # with other places of all that is measured there
        return next(found for found in self.marks(photo) if found.what == what)

    def appended(self) -> Iterator[Answer]:
        """Yield answers to what others have written to measurement files since; with other control all begins again.

        Raises
        ------
        InputError
            If a file holds faults; it is read again when it has changed.
        """
        now, control = self._files_now(), self._control_now()
        if (now, control) == (self._seen, self._seen_control):
            return
        is_control_new = control != self._seen_control
        self._seen, self._seen_control = now, control
        films = mounted_films(self._folder, LOG, "heads")
        if is_control_new or films.state.records != self._films.state.records:
            self._films = films
            self._begin()
            return
        self._films = films
        yield from self._taken(films.measured.observations.get(record_key(self.bundle.name)))

    def _taken(self, found: PhotoObservations | None) -> Iterator[Answer]:
        """Yield answers to the differences between what is measured and what the session has."""
        after = places_of(found or no_observations(self.bundle.name))
        measuring = self.measuring
        excluded = {(record_key(key.photo), key.point) for key in measuring.excluded}
        before = {
            (photo, point): (xy, (record_key(photo), point) in excluded)
            for (photo, point), (xy, _) in places_of(measuring.block.measurements.observations).items()
        }
        for photo, point in sorted(before.keys() - after.keys()):
            self._remove(photo, point)
        for (photo, point), (xy, is_disregarded) in after.items():
            known, was_disregarded = before.get((photo, point), (None, False))
            if known != xy:
                yield self._measure(photo, point, xy)
            if is_disregarded and not was_disregarded:
                yield self._answered(photo, point, partial(Measuring.exclude, photo=photo, point=point))
            if was_disregarded and not is_disregarded:
                yield self._answered(photo, point, partial(Measuring.include, photo=photo, point=point))

    def _begin(self) -> None:
        state = BundleState(self._films.state, self.bundle.name)
        first = replace(THOROUGH, solution=solution_of_what_is_measured(state))
        measuring = Measuring(OnlineBlock(block_input_so_far(state)), first)
        self._places = {place: xy for place, (xy, _) in places_of(measuring.block.measurements.observations).items()}
        self._background = Background(measuring, self._seconds)
        self._background.wake = self._wake

    def _measure(self, photo: str, point: str, xy: tuple[float, float]) -> Answer:
        self._places[photo, point] = xy
        return self._answered(photo, point, partial(Measuring.measure, measurement=(photo, point, xy)))

    def _remove(self, photo: str, point: str) -> None:
        del self._places[photo, point]
        self._background.ask(partial(Measuring.remove, photo=photo, point=point))

    def _answered(self, photo: str, point: str, request: Operation) -> Answer:
        """Return the answer to a request about a photo point, or that it follows."""
        text = f"{point} in {photo} is kept; its test follows when what came before it has been reconsidered"
        return self._background.ask(request) or Answer(photo, point, "unchecked", text, is_pending=True)

    def _files_now(self) -> tuple[tuple[str, int, int], ...]:
        """Return name, time and size of the measurement files."""
        return _states_of({*self._films.project.folder.glob("*.MEA"), self._films.log})

    def _control_now(self) -> tuple[tuple[str, int, int], ...]:
        """Return name, time and size of the control files."""
        folder, base = self._films.project.folder, self._films.project.control_base(self.bundle.name)
        return _states_of({folder / f"{base}.{extension}" for extension in CONTROL_EXTENSIONS})

    def _required(self, photo: str, point: str) -> tuple[str, tuple[float, float]]:
        record = self._films.photo(photo)
        before = self._places.get((record.name, point))
        if before is None:
            message = f"point {point} is not measured in photo {record.name}"
            raise UsageError(message)
        return record.name, before

    def _to_stored(self, photo: str, xy: tuple[float, float]) -> tuple[float, float]:
        """Return the stored coordinates of a place in the log."""
        record = self._films.photo(photo)
        to_log = stored_to_log(record, self._films.definitions, self._films.interior.to_template)
        if to_log is None:
            message = f"the template of photo {record.name} is not oriented; measure its tick marks first"
            raise UsageError(message)
        x, y = to_log.inverse().apply(np.array([xy]))[0]
        return float(x), float(y)

    def name_of(self, photo: str) -> str:
        """Return the name of a photo as it is defined; raise UsageError, with names like it, if it is not."""
        return self._films.photo(photo).name

    def to_logs(self) -> dict[str, PlaneTransformation]:
        """Return by `record_key`, of photos that can be measured, stored coordinates to those of a measurement file."""
        films = self._films
        found = {
            key: stored_to_log(photo, films.definitions, films.interior.to_template)
            for key, photo in films.definitions.photos.items()
            if key in films.interior.to_photo
        }
        return {key: to_log for key, to_log in found.items() if to_log is not None}

    def to_photo(self, photo: str, stored: tuple[float, float]) -> tuple[float, float]:
        """Return the photo coordinates, mm, of stored ones."""
        x, y = self._films.interior.to_photo[record_key(photo)].apply(np.array([stored]))[0]
        return float(x), float(y)

    def to_log(self, photo: str, stored: tuple[float, float]) -> tuple[float, float]:
        """Return the coordinates of a measurement file of stored ones."""
        to_log = stored_to_log(self._films.photo(photo), self._films.definitions, self._films.interior.to_template)
        assert to_log is not None, "it has been measured"
        x, y = to_log.apply(np.array([stored]))[0]
        return float(x), float(y)

    def _write(self, photo: str, point: str, xy: tuple[float, float], *, again: bool) -> None:
        header = points_header(self.bundle.name, photo)
        if again:
            # the measurement before it counts no more, whatever the bundle does with repeated ones
            self._edit("KILL", photo, point)
        lines = self._blocks.setdefault(header, {})
        lines[point] = measurement_line(point, xy, decimals=_DECIMALS)
        self._file.put(header, lines.values())
        self._seen = self._files_now()

    def _edit(self, action: MarkEdit, owner: str, name: str, what: What = "POINT") -> None:
        place = TextPlace(self._films.shown_log, 0)
        record = EditRecord(place, action, what, self.bundle.name if what == "POINT" else None, owner, name)
        self._file.edit(edit_line(record))
        self._blocks.clear()
        self._seen = self._files_now()


def _states_of(paths: Collection[Path]) -> tuple[tuple[str, int, int], ...]:
    """Return name, time and size of the files that exist."""
    states = [(path.name, path.stat()) for path in sorted(paths) if path.exists()]
    return tuple((name, state.st_mtime_ns, state.st_size) for name, state in states)
