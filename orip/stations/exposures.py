"""The exposures of photos from what GNSS and INS have: which event is whose, and where it was."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.geometry.rotation import rotation_from_angles, rotation_from_navigation
from orip.records.epochs import Epochs, Quality
from orip.records.names import record_key
from orip.stations.in_project import Exposures
from orip.stations.interpolation import (
    Interpolated,
    in_seconds_of_week,
    interpolate,
    motions_at,
    moved,
    time_complaints,
    without_contradicting_velocities,
)
from orip.stations.matching import NO_EVENT, match_at_offset, match_by_time, strips_of_flight
from orip.structs import replace
from orip.wording import agreeing, first_names

MOST_WARNINGS = 20
"""Events of a kind that are named one by one."""

_LEAST_JUMPED = 3
"""Photos that fit together at another offset of the clock: it has jumped."""

_SECONDS_PER_DAY = 86_400.0

_ORDER: Sequence[Quality] = ("code", "", "float", "fixed")
_NAMED = {
    "code": "from code measurements alone",
    "float": "float, its ambiguities are not fixed",
    "": "of unknown kind",
}


_USUAL_ERRORS: Mapping[Quality, tuple[float, float, float]] = {"float": (0.5, 0.5, 1.0), "code": (5.0, 5.0, 10.0)}
"""East, north, up, m: of positions without standard deviations that are not fixed."""


class Sources(Struct, frozen=True):
    """What was read.

    Parameters
    ----------
    solution : Epochs
        A trajectory, or the positions of events.
    events : Epochs or None
        Times at which photos were taken, if `solution` is a trajectory.
    photo_times : Epochs or None
        Names and times of photos by the clock of their camera.
    photos : sequence of str
        Photos of the project.
    """

    solution: Epochs
    events: Epochs | None = None
    photo_times: Epochs | None = None
    photos: Sequence[str] = ()


class Matching(Struct, frozen=True):
    """How photos and events are brought together.

    Parameters
    ----------
    names : str or None
        Pattern of photos' names with the number of the event, such as ``DJI_{:04d}``.
    offset : float or None
        Event time less photo time, seconds; None: found from the pattern of the times.
    tolerance : float
        Seconds within which a photo belongs to an event.
    accepted : sequence of Quality
        Positions of other qualities are only compared.
    finds_strips : bool
        Strips are found by the course of the flight.
    """

    names: str | None = None
    offset: float | None = None
    tolerance: float = 0.75
    accepted: Sequence[Quality] = ("fixed", "")
    finds_strips: bool = True


def find_exposures(sources: Sources, matching: Matching) -> tuple[Exposures, tuple[ProjectWarning, ...]]:
    """Return the exposures of photos, and what is said of events and photos that do not fit.

    Raises
    ------
    InputError
        If it cannot be said which event is which photo's, or the trajectory's clock goes backwards.
    """
    events = sources.events or sources.solution
    photo, row, warnings = _photos_of_events(sources, events, matching)
    if sources.events is None:
        found, quality = _own_places(events, row), [events.quality[index] for index in row]
        missing = np.isnan(found.place).any(axis=1) & np.isnan(found.rotation[:, 0, 0])
        warnings += [
            _warning("no-position", events, index, "has no position; 0, 0 counts as none") for index in row[missing]
        ]
    else:
        if complaints := time_complaints(sources.solution):
            raise InputError(complaints)
        found, quality, missing, said = _interpolated_places(sources.solution, events, row)
        warnings += said
    used, said = _used(events, row, quality, matching, ~missing)
    warnings += said
    kept = np.flatnonzero(~missing)
    exposures = Exposures(
        photo=tuple(photo[index] for index in kept),
        place=found.place[kept],
        is_geographic=sources.solution.is_geographic,
        covariance=_with_usual_errors(found.covariance, quality)[kept],
        rotation=found.rotation[kept],
        angle_error=found.angle_error[kept],
        time=events.time[row[kept]],
        is_used=tuple(used[index] for index in kept),
        strip=tuple(events.strip[index] for index in row[kept]),
        motions=None if found.motions is None else found.motions.of(kept),
    )
    return (_with_strips(exposures) if matching.finds_strips else exposures), tuple(warnings)


def _photos_of_events(
    sources: Sources, events: Epochs, matching: Matching
) -> tuple[list[str], IntArray, list[ProjectWarning]]:
    """Return photos, the rows of their events, and warnings."""
    if any(events.photo):
        rows = [row for row, name in enumerate(events.photo) if name]
        photo = [events.photo[row] for row in rows]
        _require_once(photo, events, rows)
        return photo, np.array(rows, dtype=np.int64), []
    if sources.photo_times is not None:
        return _matched(sources.photo_times, events, matching)
    if (events.number > 0).any():
        names = _by_number(events, sources.photos, matching.names)
        rows = [row for row, number in enumerate(events.number.tolist()) if number in names]
        photo = [names[int(events.number[row])] for row in rows]
        _require_once(photo, events, rows)
        places = np.array(rows, dtype=np.int64)
        return photo, places, list(_without_photo(events, places))
    message = (
        "the events have neither names nor numbers of photos; give the times of the photos with --photos, "
        "a table with photo and time or the folder of the image files: the order alone is no proof"
    )
    raise InputError.single(message, events.shown)


def _require_once(photo: Sequence[str], epochs: Epochs, rows: Iterable[int]) -> None:
    """Raise an error if photos of some rows of a file have the same name."""
    first: dict[str, int] = {}
    complaints = []
    for name, row in zip(photo, rows, strict=True):
        line = int(epochs.line[row])
        if first.setdefault(record_key(name), line) != line:
            text = f"photo '{name}' is already on line {first[record_key(name)]}; keep one of the two"
            complaints.append(Complaint(text, epochs.shown, line))
    if complaints:
        raise InputError(complaints)


def _by_number(events: Epochs, photos: Sequence[str], pattern: str | None) -> Mapping[int, str]:
    """Return the names of photos by the numbers that events have."""
    numbers = {int(number) for number in events.number if number > 0}
    if pattern is not None:
        try:
            names = {number: pattern.format(number) for number in sorted(numbers)}
        except (ValueError, LookupError, AttributeError):
            names = {}
        if len(set(names.values())) < len(numbers):
            message = f"names '{pattern}' do not number the photos; write for example 'DJI_{{:04d}}'"
            raise InputError.single(message)
        return names
    found: dict[int, str] = {}
    for name in photos:
        digits = re.findall(r"\d{1,9}", name)
        if digits and int(digits[-1]) in numbers:
            other = found.setdefault(int(digits[-1]), name)
            if other != name:
                message = (
                    f"photos {other} and {name} both have the number {int(digits[-1])}; "
                    "give the pattern of the names with --names, such as 'DJI_{:04d}'"
                )
                raise InputError.single(message)
    if not found:
        message = (
            "no photo of the project has the number of an event at the end of its name; give the pattern of the names "
            "with --names, such as 'DJI_{:04d}'"
        )
        raise InputError.single(message, events.shown)
    return found


def _matched(
    photo_times: Epochs, events: Epochs, matching: Matching
) -> tuple[list[str], IntArray, list[ProjectWarning]]:
    """Return photos with their events by time."""
    event_time, photo_time = events.time, photo_times.time
    if not (events.has_week and photo_times.has_week):
        event_time, photo_time = in_seconds_of_week(events), in_seconds_of_week(photo_times)
    if complaints := [
        Complaint("this photo has no time", photo_times.shown, int(photo_times.line[row]))
        for row in np.flatnonzero(np.isnan(photo_time))
    ]:
        raise InputError(complaints)
    if matching.offset is not None:
        match = match_at_offset(photo_time, event_time, matching.offset, matching.tolerance)
    else:
        match = match_by_time(photo_time, event_time, matching.tolerance)
    if match.alternative is not None:
        message = (
            f"the times of the photos fit those of the events at an offset of {match.offset:.3f} s and of "
            f"{match.alternative:.3f} s alike; give the right one with --offset (event less photo, seconds)"
        )
        raise InputError.single(message, photo_times.shown)
    warnings: list[ProjectWarning] = []
    event = match.event
    unmatched = np.flatnonzero(event == NO_EVENT)
    if matching.offset is None and len(unmatched) >= _LEAST_JUMPED:
        event, warnings = _after_jump(photo_times, event, photo_time, event_time, match.offset, matching.tolerance)
    found = np.flatnonzero(event != NO_EVENT)
    photo, row = [photo_times.photo[index] for index in found], event[found]
    _require_once(photo, photo_times, found.tolist())
    warnings += [
        _warning("no-event", photo_times, int(index), f"photo {photo_times.photo[index]} has no event at its time")
        for index in np.flatnonzero(event == NO_EVENT)
    ]
    return photo, row, [*_first(warnings), *_without_photo(events, row)]


def _after_jump(
    photo_times: Epochs,
    event: IntArray,
    photo_time: FloatArray,
    event_time: FloatArray,
    offset: float,
    tolerance: float,
) -> tuple[IntArray, list[ProjectWarning]]:
    """Match photos that fit no event with those that are free, at another offset of the camera's clock."""
    photos = np.flatnonzero(event == NO_EVENT)
    free = np.setdiff1d(np.arange(len(event_time)), event)
    match = match_by_time(photo_time[photos], event_time[free], tolerance)
    matched = match.event != NO_EVENT
    if np.count_nonzero(matched) < _LEAST_JUMPED or match.alternative is not None:
        return event, []
    result = event.copy()
    result[photos[matched]] = free[match.event[matched]]
    first = photos[matched][0]
    text = (
        f"the clock of the camera jumps by {offset - match.offset:+.2f} s at photo {photo_times.photo[first]}; "
        f"{agreeing(int(np.count_nonzero(matched)), 'photo')} matched beyond the jump: "
        f"{int(np.count_nonzero(matched))}"
    )
    return result, [_warning("clock-jump", photo_times, int(first), text)]


def _without_photo(events: Epochs, row: IntArray) -> Iterator[ProjectWarning]:
    others = np.setdiff1d(np.arange(len(events)), row)
    return _first(
        [_warning("event-without-photo", events, int(index), "no photo belongs to this event") for index in others]
    )


def _own_places(events: Epochs, row: IntArray) -> Interpolated:
    """Return the places that the events have themselves."""
    if events.mount == "photo":
        rotation = rotation_from_angles(events.angles[row])
    else:
        rotation = rotation_from_navigation(events.angles[row], events.mount)
    return Interpolated(
        events.place[row], events.covariance[row], row, rotation, events.angle_error[row], np.zeros(len(row))
    )


def _interpolated_places(
    trajectory: Epochs, events: Epochs, row: IntArray
) -> tuple[Interpolated, list[Quality], BoolArray, list[ProjectWarning]]:
    """Return the places of events on a trajectory, with the worse quality of the epochs on both sides."""
    trajectory, said = without_contradicting_velocities(trajectory)
    time = events.time[row]
    if not (trajectory.has_week and events.has_week):
        trajectory = replace(trajectory, time=in_seconds_of_week(trajectory))
        time = in_seconds_of_week(events)[row]
    found = interpolate(trajectory, time)
    place = moved(found.place, events.to_camera[row], is_geographic=trajectory.is_geographic)
    missing: BoolArray = np.asarray(np.isnan(place).any(axis=1))
    warnings = [
        _warning(
            "outside-trajectory", events, int(row[index]),
            f"is not within the time of {trajectory.shown}{_day_hint(trajectory.time, time[index])}",
        )
        if np.isnan(found.gap[index])
        else _warning(
            "gap", events, int(row[index]),
            f"falls into a gap of {found.gap[index]:.2f} s of {trajectory.shown} after its line "
            f"{trajectory.line[found.before[index]]}; no position",
        )
        for index in np.flatnonzero(missing)
    ]  # fmt: skip
    last = len(trajectory) - 1
    pairs = [(trajectory.quality[one], trajectory.quality[min(one + 1, last)]) for one in found.before.tolist()]
    quality: list[Quality] = [min(pair, key=_ORDER.index) for pair in pairs]
    return (
        replace(found, place=place, motions=motions_at(trajectory, time)),
        quality,
        missing,
        [*said, *_first(warnings)],
    )


def _day_hint(trajectory: FloatArray, time: float) -> str:
    """Return what to do where a trajectory has seconds of the day, and an event those of the week."""
    in_day = time % _SECONDS_PER_DAY
    first, last = float(np.min(trajectory, initial=np.inf)), float(np.max(trajectory, initial=-np.inf))
    if time == in_day or not 0.0 <= first <= in_day <= last <= _SECONDS_PER_DAY:
        return ""
    return (
        f", {first:.1f} to {last:.1f} s; within the day it would be, at {in_day:.1f} s: is the trajectory in seconds "
        "of the day? Export it with GPS seconds of the week (those of a day are mostly UTC, 18 s behind)"
    )


def _with_usual_errors(covariance: FloatArray, quality: Sequence[Quality]) -> FloatArray:
    """Return covariances, where none is given those that are usual for positions that are not fixed."""
    usual = np.array([np.diag(np.square(_USUAL_ERRORS.get(kind, (np.nan,) * 3))) for kind in quality])
    return np.where(np.isnan(covariance), usual.reshape(covariance.shape), covariance)


def _used(
    events: Epochs, row: IntArray, quality: Sequence[Quality], matching: Matching, wanted: BoolArray
) -> tuple[list[bool], list[ProjectWarning]]:
    used = [kind in matching.accepted for kind in quality]
    warnings = [
        _warning("not-fixed", events, int(row[index]), f"is {_NAMED[quality[index]]}: it is only compared")
        for index in np.flatnonzero(wanted).tolist()
        if not used[index]
    ]
    return used, list(_first(warnings))


def _with_strips(exposures: Exposures) -> Exposures:
    """Return exposures with strips by the course of the flight, where the file names none."""
    known = np.isfinite(exposures.time) & np.isfinite(exposures.place).all(axis=1)
    if any(exposures.strip) or np.count_nonzero(known) < 2:
        return exposures
    rows = np.flatnonzero(known)[np.argsort(exposures.time[known], kind="stable")]
    east, north = exposures.place[rows, 0], exposures.place[rows, 1]
    if exposures.is_geographic:
        east = east * np.cos(np.median(north))
    strips = [""] * len(exposures.photo)
    for index, number in zip(rows.tolist(), strips_of_flight(exposures.time[rows], east, north), strict=True):
        strips[index] = f"S{number}" if number else ""
    return replace(exposures, strip=tuple(strips))


def _warning(code: str, epochs: Epochs, row: int, text: str) -> ProjectWarning:
    return ProjectWarning(code, f"{epochs.shown}:{epochs.line[row]}", text)


def _first(warnings: Iterable[ProjectWarning]) -> Iterator[ProjectWarning]:
    """Yield the first warnings, and of the others the lines."""
    listed = list(warnings)
    yield from listed[:MOST_WARNINGS]
    if others := [warning.where for warning in listed[MOST_WARNINGS:]]:
        text = f"and {len(others)} more: {first_names([place.rpartition(':')[2] for place in others], MOST_WARNINGS)}"
        yield ProjectWarning(listed[0].code, listed[0].where.rpartition(":")[0], text)
