"""Names that two files write differently, that the block does not use, and one photo under two names."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from itertools import count
from string import digits

import numpy as np

from orip.arrays import IntArray, parts
from orip.errors import ProjectWarning
from orip.mistakes.mistake import declare
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.control import Control, ControlElement, PreliminaryPoint
from orip.records.names import look_alikes, near_names, record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.wording import agreeing, counted_names, first_names, joined

OTHER_SPELLING = declare("other-spelling", explains_misfit=True, comes_first=True)
_SAME_PHOTO = declare("same-photo", explains_misfit=True)

_NAMED = 3

_ENDING = re.compile(r"\.(jpe?g|tiff?|png|dng|nef|cr[23]|arw|raf|rw2|orf|0)$", re.IGNORECASE)
"""Of image files, and of numbers that a spreadsheet took for measured ones."""
_SEPARATORS = re.compile(r"[-_.\"']")
_ZEROS = re.compile(r"(?<!\d)0+(?=\d)")
"""Leading zeros of a number in a name."""


def control_spelt_otherwise(unmeasured: Sequence[str], unknown: Iterable[str]) -> list[ProjectWarning]:
    """Return a warning for control points whose names the measurements write differently.

    Parameters
    ----------
    unmeasured : sequence of str
        Names of control points that are not measured.
    unknown : iterable of str
        Names of measured points without control.
    """
    pairs = _spelt_otherwise(unmeasured, unknown)
    if not pairs:
        return []
    are = "is" if len(pairs) == 1 else "are"
    text = (
        f"{are} not measured in any photo, but {first_names(list(pairs.values()), _NAMED)} {are}: the names differ by "
        f"{_difference(pairs)} alone; write them alike in control file and measurements"
    )
    return [ProjectWarning(OTHER_SPELLING, counted_names("control point", list(pairs)), text)]


def stations_spelt_otherwise(
    unknown: Sequence[str], without_station: Iterable[str], file: str = ".STA"
) -> list[ProjectWarning]:
    """Return a warning for exposure stations whose photos are named differently in the project.

    Parameters
    ----------
    unknown : sequence of str
        Names in stations that no photo has.
    without_station : iterable of str
        Names of photos without a station.
    file : str
        Ending of the file of the stations.
    """
    pairs = _spelt_otherwise(unknown, without_station)
    if not pairs:
        return []
    text = (
        f"the bundle has no photos of these names, but {first_names(list(pairs.values()), _NAMED)}: the names differ "
        f"by {_difference(pairs)} alone; write them alike in the {file} file and in orip.toml"
    )
    return [ProjectWarning(OTHER_SPELLING, counted_names("exposure station", list(pairs)), text)]


def _spelt_otherwise(names: Sequence[str], others: Iterable[str]) -> dict[str, str]:
    """Return the names of which exactly one other is a different spelling, with that."""
    wanted = set(map(_form, names))
    by_form: dict[str, list[str]] = {}
    for other in others if wanted else ():
        by_form.setdefault(_form(other), []).append(other)
    return {name: found[0] for name in names if len(found := by_form.get(_form(name), [])) == 1 and found[0] != name}


def _form(name: str) -> str:
    plain = _SEPARATORS.sub("", _ENDING.sub("", name)).upper()
    return _ZEROS.sub("", plain)


def _difference(pairs: Mapping[str, str]) -> str:
    """Return what all names differ by, as far as it is the same."""
    found = {_between(*sorted(pair, key=len)) for pair in pairs.items()}
    return found.pop() if len(found) == 1 else "their spelling"


def _between(shorter: str, longer: str) -> str:
    if longer.upper() == shorter.upper():
        return "capitals"
    ending = _ENDING.search(longer)
    if ending and longer[: ending.start()] == shorter:
        return f"the ending {ending[0]}"
    for sign, noun in (("-", "a hyphen"), ("_", "an underscore"), (".", "a point"), ('"', "quotation marks")):
        if longer.replace(sign, "") == shorter:
            return noun
    return "leading zeros" if _ZEROS.sub("", longer) == _ZEROS.sub("", shorter) else "their spelling"


MOST_WARNINGS = 50
"""Most warnings of a kind that are printed one by one."""

_NAMES = {
    "unused-control": "control observations",
    "unused-preliminary": "preliminary points",
    "look-alike-names": "names",
}
_UNMEASURED = "is not measured in any photo"


_FEWEST_OF_FIGURES = 4
"""Points of figures that are not used, of which one warning is given, and none of the figures that lack them."""


def figures_told(points: Container[str], control: Control) -> set[str]:
    """Return the figures of which one warning tells that their points are not used."""
    of_figures = [point for point in control.figure_points if point.point not in points]
    return {point.figure for point in of_figures} if len(of_figures) >= _FEWEST_OF_FIGURES else set()


def name_warnings(block: Block, control: Control, preliminary: Sequence[PreliminaryPoint]) -> list[ProjectWarning]:
    """Return a warning for each control observation and preliminary point not in the block, and for similar names."""
    otherwise, told = _warn_of_other_spellings(block, control)
    unused = [*_unused_points(block, control, preliminary), *_unused_observations(block, control)]
    unused += [*_unused_points_of_figures(block, control), *_of_unknown_records(block, control)]
    warnings = [ProjectWarning(f"unused-{what}", where, text) for what, where, text in unused if where not in told]
    similar = []
    # names that files write differently are said to be one already
    given = [point.name for point in control.points if f"control point {point.name}" not in told]
    for group in look_alikes([*block.point_names, *given]):
        text = f"{', '.join(group)} differ only in case or leading zeros: are they one point?"
        similar.append(ProjectWarning("look-alike-names", f"point {group[0]}", text))
    return [*otherwise, *_first_of_each_code(warnings), *_first_of_each_code(similar)]


_Unused = tuple[str, str, str]
"""Of which kind of text, what, and why."""


def _unused_points(block: Block, control: Control, preliminary: Sequence[PreliminaryPoint]) -> Iterator[_Unused]:
    points = block.point_index()
    for point in control.points:
        if point.name not in points:
            yield "control", f"control point {point.name}", _UNMEASURED
    for one in preliminary:
        if one.name not in points:
            yield "preliminary", f"preliminary point {one.name}", _UNMEASURED


def _unused_observations(block: Block, control: Control) -> Iterator[_Unused]:
    points = block.point_index()
    for distance in control.distances:
        if distance not in block.distances:
            yield "control", f"distance {distance.name}", _unplaced(points, distance.start, distance.end)
    for line in control.directions:
        if line not in block.directions:
            where = f"direction {line.set} {line.station} {line.target}"
            yield "control", where, _unplaced(points, line.station, line.target)
    for given in control.given_directions:
        if given not in block.given_directions:
            yield "control", f"given direction {given.name}", _unplaced(points, given.start, given.end)


def _unused_points_of_figures(block: Block, control: Control) -> Iterator[_Unused]:
    """Yield the points of figures that are not in the block; many together."""
    points = block.point_index()
    unused = [point for point in control.figure_points if point.point not in points]
    if len(unused) < _FEWEST_OF_FIGURES:
        for one in unused:
            yield "control", f"point {one.point} of figure {one.figure}", _unplaced(points, one.point)
        return
    figures = list(dict.fromkeys(one.figure for one in unused))
    names = list(dict.fromkeys(one.point for one in unused))
    where = f"{counted_names('point', names)} of {counted_names('figure', figures)}"
    yield "control", where, "are not used: they are neither measured nor given coordinates; correct them"


def _of_unknown_records(block: Block, control: Control) -> Iterator[_Unused]:
    for element in control.elements:
        if element not in block.elements:
            yield "control", f"element {element.group} {element.name} {element.kind}", _unknown(element)
    photos = {record_key(photo.name): photo.name for photo in block.photos}
    for station in control.stations:
        if record_key(station.photo) not in photos:
            yield "control", f"exposure station {station.photo}", _unknown_photo(station.photo, photos.values())
    for line in control.differences:
        for name in (line.first, line.second):
            if record_key(name) not in photos:
                yield "control", f"station difference {line.name}", _unknown_photo(name, photos.values())


def _warn_of_other_spellings(block: Block, control: Control) -> tuple[list[ProjectWarning], set[str]]:
    """Return warnings of control points and stations that are there under names that are spelt differently.

    And what these are called in warnings of each that is not used, which follow from them.
    """
    measured, given = block.point_index(), {point.name for point in control.points}
    unmeasured = [point.name for point in control.points if point.name not in measured]
    photos = {record_key(photo.name): photo.name for photo in block.photos}
    of_stations = {record_key(station.photo) for station in control.stations}
    in_elements = list(dict.fromkeys(element.name for element in control.elements if element.group == "PHOTO"))
    of_elements = {record_key(name) for name in in_elements}
    points = unmeasured, [name for name in block.point_names if name not in given]
    stations = (
        [station.photo for station in control.stations if record_key(station.photo) not in photos],
        [name for key, name in photos.items() if key not in of_stations],
    )
    elements = (
        [name for name in in_elements if record_key(name) not in photos],
        [name for key, name in photos.items() if key not in of_elements],
    )
    pairs = _spelt_otherwise(*points)
    none_measured = not pairs and len(unmeasured) >= _FEWEST_OF_FILE and len(unmeasured) == len(control.points)
    told = {f"control point {name}" for name in (unmeasured if none_measured else pairs)}
    told |= {f"exposure station {name}" for name in _spelt_otherwise(*stations)}
    told |= {f"element PHOTO {name} {kind}" for name in _spelt_otherwise(*elements) for kind in PHOTO_PARAMETERS}
    of_points = [_of_other_names(*points)] if none_measured else control_spelt_otherwise(*points)
    of_photos = [*stations_spelt_otherwise(*stations), *stations_spelt_otherwise(*elements, ".ELE")]
    return [*of_points, *of_photos], told


_FEWEST_OF_FILE = 3
"""Control points of which none is measured by mistake."""


def _of_other_names(unmeasured: Sequence[str], measured: Iterable[str]) -> ProjectWarning:
    """Return a warning that no control point is measured; the names without a like are probably those of the marks."""
    if prefix := _prefix(unmeasured, set(measured)):
        text = f"are not measured in any photo: the names differ by '{prefix}' at the beginning alone; write them alike"
        text = f"{text} in control file and measurements"
        return ProjectWarning(OTHER_SPELLING, counted_names("control point", unmeasured), text)
    prefixes = Counter(name.rstrip("0123456789") for name in measured)
    # there are fewer marks than other points
    shown = sorted(measured, key=lambda name: prefixes[name.rstrip("0123456789")])
    text = (
        f"are not measured in any photo: no name of the control file is one of the measurements, where points are "
        f"called {first_names(shown, _NAMED)}; write the names of control points alike in both"
    )
    return ProjectWarning(OTHER_SPELLING, counted_names("control point", unmeasured), text)


def _prefix(unmeasured: Sequence[str], measured: AbstractSet[str]) -> str:
    """Return what all names begin with on one side alone; a digit is none, as numbers of other points have it."""
    for prefix in sorted({name.rstrip(digits) for name in unmeasured}):
        if prefix and all(name.startswith(prefix) and name[len(prefix) :] in measured for name in unmeasured):
            return prefix
    for prefix in sorted({name.rstrip(digits) for name in measured}):
        if prefix and all(f"{prefix}{name}" in measured for name in unmeasured):
            return prefix
    return ""


def _first_of_each_code(warnings: Sequence[ProjectWarning]) -> Iterator[ProjectWarning]:
    """Yield the first warnings of each code, and the number of the others: control may cover a whole country."""
    counts: Counter[str] = Counter()
    for warning in warnings:
        counts[warning.code] += 1
        if counts[warning.code] <= MOST_WARNINGS:
            yield warning
    for code, total in counts.items():
        if total > MOST_WARNINGS:
            what = "look like others" if code == "look-alike-names" else "are not used either"
            yield ProjectWarning(code, "", f"{total - MOST_WARNINGS} more {_NAMES[code]} {what}")


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


_FEWEST = 5
"""Least number of common points; fewer may have the same coordinates by chance, as in photos taken in one line."""

_ERRORS = 4.0
"""Standard errors of the difference of two measurements within which they are the same."""

_SAME = 1e-3
"""Largest difference, as a part of the extent of all photo points: a camera that moves by a thousandth of the distance
to its points shifts them by more."""


def photos_under_two_names(block: Block) -> list[ProjectWarning]:
    """Return a warning for each pair of photos that show all their common points at the same coordinates."""
    points = block.photo_points
    order = np.argsort(points.point, kind="stable")
    near = _SAME * max(np.ptp(points.xy[:, 0]), np.ptp(points.xy[:, 1])) if len(points.xy) else 0.0
    # nearly always no two photos have so many points at one place, and nothing else need be looked at
    at_one_place = _shared(points, order, near, near)
    photos = np.unique([pair[:2] for pair in _same(at_one_place)])
    shared = _shared(points, order[np.isin(points.photo[order], photos)], near, np.inf)
    return [_warning(block, *pair) for pair in _same(shared)]


def _shared(points: IndexedPhotoPoints, order: IntArray, near: float, reach: float) -> IntArray:
    """Return the photos of two measurements of a point, and whether these are at the same coordinates (k, 3).

    Parameters
    ----------
    order : array of int
        Their rows, point after point.
    near : float
        Largest difference of the same coordinates, mm.
    reach : float
        Those farther apart in x are left out, mm.
    """
    point, x = points.point[order], points.xy[order, 0]
    found = [np.empty((0, 3), dtype=np.int64)]
    for part in parts(len(order)):
        first = np.arange(part.start, part.stop)
        for offset in count(1):
            first = first[: np.searchsorted(first, len(order) - offset)]
            first = first[point[first] == point[first + offset]]
            if not len(first):
                break
            close = first[np.abs(x[first] - x[first + offset]) <= reach]
            if len(close):
                found.append(_pairs(points, order[close], order[close + offset], near))
    return np.concatenate(found)


def _pairs(points: IndexedPhotoPoints, one: IntArray, other: IntArray, near: float) -> IntArray:
    """Return what `_shared` does of pairs of rows (k,) of the same points."""
    # a point that is measured twice in a photo is no second photo
    in_two = points.photo[one] != points.photo[other]
    one, other = one[in_two], other[in_two]
    difference = np.abs(points.xy[one] - points.xy[other])
    limit = np.minimum(_ERRORS * np.hypot(points.error[one], points.error[other]), near)
    photos = np.sort(np.column_stack([points.photo[one], points.photo[other]]), axis=1)
    return np.column_stack([photos, (difference <= limit).all(axis=1)])


def _same(shared: IntArray) -> list[tuple[int, int, int]]:
    """Return pairs of photos that have all their common points at the same coordinates, and the number of these."""
    if not len(shared):
        return []
    photos = int(shared[:, 1].max()) + 1
    both, which = np.unique(shared[:, 0] * photos + shared[:, 1], return_inverse=True)
    pairs = np.column_stack(np.divmod(both, photos))
    common = np.bincount(which.ravel(), minlength=len(pairs))
    at_one_place = np.bincount(which.ravel(), weights=shared[:, 2], minlength=len(pairs))
    found = np.flatnonzero((common >= _FEWEST) & (at_one_place >= common))
    return [(int(pairs[row, 0]), int(pairs[row, 1]), int(common[row])) for row in found]


def _warning(block: Block, one: int, other: int, count: int) -> ProjectWarning:
    first, second = block.photos[one].name, block.photos[other].name
    text = (
        f"all {count} points that it shares with photo {first} are at the same place in both: probably one photo that "
        "was measured under two names and counts twice; remove one of them"
    )
    return ProjectWarning(_SAME_PHOTO, f"photo {second}", text)
