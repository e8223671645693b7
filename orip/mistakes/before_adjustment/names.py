"""Names in control and preliminary values that the block does not use, and names that look alike."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence

from orip.errors import ProjectWarning
from orip.mistakes.before_adjustment.spelling import control_spelt_otherwise, stations_spelt_otherwise
from orip.records.block import Block
from orip.records.names import look_alikes, near_names, record_key
from orip.records.observations.control import Control, ControlElement, PreliminaryPoint
from orip.wording import agreeing, joined

MOST_WARNINGS = 50
"""Most warnings of a kind that are printed one by one."""

_NAMES = {
    "unused-control": "control observations",
    "unused-preliminary": "preliminary points",
    "look-alike-names": "names",
}
_UNMEASURED = "is not measured in any photo"


def name_warnings(block: Block, control: Control, preliminary: Sequence[PreliminaryPoint]) -> list[ProjectWarning]:
    """Return a warning for each control observation and preliminary point not in the block, and for similar names."""
    points = block.point_index()
    otherwise = _spelt_otherwise(block, control)
    unused: list[tuple[str, str, str]] = [
        ("control", f"control point {point.name}", _UNMEASURED) for point in control.points if point.name not in points
    ]
    unused += [
        ("preliminary", f"preliminary point {point.name}", _UNMEASURED)
        for point in preliminary
        if point.name not in points
    ]
    unused += [
        ("control", f"distance {distance.name}", _unplaced(points, distance.start, distance.end))
        for distance in control.distances
        if distance not in block.distances
    ]
    unused += [
        (
            "control",
            f"direction {direction.set} {direction.station} {direction.target}",
            _unplaced(points, direction.station, direction.target),
        )
        for direction in control.directions
        if direction not in block.directions
    ]
    unused += [
        ("control", f"element {element.group} {element.name} {element.kind}", _unknown(element))
        for element in control.elements
        if element not in block.elements
    ]
    photos = {record_key(photo.name): photo.name for photo in block.photos}
    unused += [
        ("control", f"exposure station {station.photo}", _unknown_photo(station.photo, photos.values()))
        for station in control.stations
        if record_key(station.photo) not in photos
    ]
    warnings = [ProjectWarning(f"unused-{what}", where, text) for what, where, text in unused]
    similar = []
    for group in look_alikes([*block.point_names, *(point.name for point in control.points)]):
        text = f"{', '.join(group)} differ only in case or leading zeros: are they one point?"
        similar.append(ProjectWarning("look-alike-names", f"point {group[0]}", text))
    return [*otherwise, *_first_of_each_code(warnings), *_first_of_each_code(similar)]


def _spelt_otherwise(block: Block, control: Control) -> list[ProjectWarning]:
    """Return warnings of control points and stations that are there under names that are spelt differently."""
    measured, given = block.point_index(), {point.name for point in control.points}
    unmeasured = [point.name for point in control.points if point.name not in measured]
    photos = {record_key(photo.name): photo.name for photo in block.photos}
    of_stations = {record_key(station.photo) for station in control.stations}
    return [
        *control_spelt_otherwise(unmeasured, (name for name in block.point_names if name not in given)),
        *stations_spelt_otherwise(
            [station.photo for station in control.stations if record_key(station.photo) not in photos],
            [name for key, name in photos.items() if key not in of_stations],
        ),
    ]


def _first_of_each_code(warnings: Sequence[ProjectWarning]) -> Iterator[ProjectWarning]:
    """Yield the first warnings of each code, and the number of the others: control may cover a whole country."""
    counts: Counter[str] = Counter()
    for warning in warnings:
        counts[warning.code] += 1
        if counts[warning.code] <= MOST_WARNINGS:
            yield warning
    for code, count in counts.items():
        if count > MOST_WARNINGS:
            what = "look like others" if code == "look-alike-names" else "are not used either"
            yield ProjectWarning(code, "", f"{count - MOST_WARNINGS} more {_NAMES[code]} {what}")


def _unplaced(points: Container[str], *names: str) -> str:
    missing = [name for name in names if name not in points]
    which = joined(missing) or "one of its points"
    verb = agreeing(len(missing) or 1, "is", "are")
    return f"is not used: {which} {verb} neither measured nor given coordinates; correct the name, or measure it"


def _unknown_photo(name: str, photos: Iterable[str]) -> str:
    return f"is not used: the bundle has no photo {name}; {near_names(name, photos)}"


def _unknown(element: ControlElement) -> str:
    what = {"THEODOLITE": "set of directions"}.get(element.group, element.group.lower())
    return f"is not used: the bundle has no {what} {element.name}; correct the name"
