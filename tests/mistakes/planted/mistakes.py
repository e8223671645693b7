"""Mistakes that are planted in sound blocks, and what a finding has to say to have named them.

A mistake is a function that changes a block in place and returns what there is to find, or None where the block has
nothing that it could be made in.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np
from mistakes.planted.blocks import Planted
from msgspec import Struct


class Truth(Struct, frozen=True):
    """What there is to find.

    Attributes
    ----------
    where : tuple of str
        Names, of which each has to be told; a regular expression.
    what : str
        A regular expression for the mistake.
    is_shown : bool
        Whether something other than residuals shows it: given values that the adjusted ones contradict.
    """

    where: tuple[str, ...]
    what: str
    is_shown: bool = False


Planting = Callable[[Planted, np.random.Generator], Truth | None]

PLANTED: dict[str, tuple[str, Planting]] = {}
"""By its name: the group that a mistake belongs to, and what makes it."""


def planting(group: str) -> Callable[[Planting], Planting]:
    def enter(make: Planting) -> Planting:
        PLANTED[make.__name__] = group, make
        return make

    return enter


def name(word: str) -> str:
    """Return an expression for a name, not as a part of another one."""
    return rf"(?<![\w.]){word}(?![\w])"


def _any(random: np.random.Generator, names: list[str], count: int = 1) -> list[str]:
    return [names[k] for k in random.choice(len(names), count, replace=False)]


MIRRORED = r"mirror|opposite sign|upwards|downwards|to the left|from the right"
EXCHANGED_AXES = rf"{MIRRORED}|x and y|row before|column"


# --------------------------------------------------------------------------------------------------------------- photos


def _changed(block: Planted, photos: list[str], change: Callable[[np.ndarray], np.ndarray]) -> None:
    for key in block.images:
        if key[0] in photos:
            block.images[key] = change(block.images[key])


def _mirrored(block: Planted, axis: int) -> Callable[[np.ndarray], np.ndarray]:
    size = [block.cameras[0]["sensor"][key] for key in ("columns", "rows")] if block.has_sensor else [0.0, 0.0]
    return lambda xy: np.array([size[k] - xy[k] if k == axis else xy[k] for k in (0, 1)])


@planting("one photo mirrored, or x and y exchanged in it")
def one_photo_y_mirrored(block: Planted, random: np.random.Generator) -> Truth:
    (photo,) = _any(random, block.photos)
    _changed(block, [photo], _mirrored(block, 1))
    return Truth((name(photo),), MIRRORED)


@planting("one photo mirrored, or x and y exchanged in it")
def one_photo_x_mirrored(block: Planted, random: np.random.Generator) -> Truth:
    (photo,) = _any(random, block.photos)
    _changed(block, [photo], _mirrored(block, 0))
    return Truth((name(photo),), MIRRORED)


@planting("one photo mirrored, or x and y exchanged in it")
def one_photo_x_for_y(block: Planted, random: np.random.Generator) -> Truth:
    (photo,) = _any(random, block.photos)
    _changed(block, [photo], lambda xy: xy[::-1])
    return Truth((name(photo),), EXCHANGED_AXES)


@planting("all photos mirrored, or x and y exchanged in them")
def all_photos_y_mirrored(block: Planted, random: np.random.Generator) -> Truth:
    _changed(block, block.photos, _mirrored(block, 1))
    return Truth((), MIRRORED)


@planting("all photos mirrored, or x and y exchanged in them")
def all_photos_x_for_y(block: Planted, random: np.random.Generator) -> Truth:
    _changed(block, block.photos, lambda xy: xy[::-1])
    return Truth((), EXCHANGED_AXES)


@planting("photos exchanged, twice, or of another camera")
def two_photos_exchanged(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.is_oriented or len(block.photos) < 3:
        return None
    one, other = _any(random, block.photos, 2)
    names = {one: other, other: one}
    images = {(names.get(photo, photo), point): xy for (photo, point), xy in block.images.items()}
    block.images = {
        (photo, point): xy for kept in block.photos for (photo, point), xy in images.items() if photo == kept
    }
    return Truth((name(one), name(other)), "exchanged", is_shown=True)


@planting("photos exchanged, twice, or of another camera")
def same_photo_twice(block: Planted, random: np.random.Generator) -> Truth:
    one, other = _any(random, block.photos, 2)
    for key in [key for key in block.images if key[0] == other]:
        del block.images[key]
    block.images |= {(other, point): xy for (photo, point), xy in block.images.items() if photo == one}
    return Truth((name(one), name(other)), "one photo", is_shown=True)


@planting("photos exchanged, twice, or of another camera")
def one_photo_of_another_lens(block: Planted, random: np.random.Generator) -> Truth:
    (photo,) = _any(random, block.photos)
    block.cameras.append(block.cameras[0] | {"name": "OTHER", "c": 1.4 * block.cameras[0]["c"]})
    block.photo_camera[photo] = "OTHER"
    return Truth((name(photo), "CAM"), "camera|C =")


@planting("photos exchanged, twice, or of another camera")
def points_shifted_by_a_line(block: Planted, random: np.random.Generator) -> Truth:
    (photo,) = _any(random, block.photos)
    points = block.points_of(photo)
    images = [block.images[photo, point] for point in points]
    for point, xy in zip(points, images[1:] + images[:1], strict=True):
        block.images[photo, point] = xy
    return Truth((name(photo),), "numbers|names|shifted|another place")


# ---------------------------------------------------------------------------------------------------- units and cameras


@planting("units of photo coordinates")
def micrometres(block: Planted, random: np.random.Generator) -> Truth | None:
    if block.has_sensor:
        return None
    _changed(block, block.photos, lambda xy: 1e3 * xy)
    return Truth((), "micromet")


@planting("units of photo coordinates")
def tenth_of_micrometres(block: Planted, random: np.random.Generator) -> Truth | None:
    if block.has_sensor:
        return None
    _changed(block, block.photos, lambda xy: 1e4 * xy)
    return Truth((), r"0\.0001 mm|1e-4 mm|tenths of a micromet")


@planting("units of photo coordinates")
def micrometres_without_frame(block: Planted, random: np.random.Generator) -> Truth | None:
    if block.has_sensor:
        return None
    del block.cameras[0]["frame"]
    _changed(block, block.photos, lambda xy: 1e3 * xy)
    return Truth((), "micromet")


@planting("units of photo coordinates")
def pixels_as_millimetres(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.has_sensor:
        return None
    sensor = block.cameras[0].pop("sensor")
    block.cameras[0]["frame"] = [sensor["width"], sensor["height"]]
    return Truth((), "pixel")


@planting("units of photo coordinates")
def half_resolution(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.has_sensor:
        return None
    _changed(block, block.photos, lambda xy: 0.5 * xy)
    return Truth((), "half|reduced|resolution")


@planting("principal distance")
def another_lens(block: Planted, random: np.random.Generator) -> Truth:
    block.cameras[0]["c"] *= float(random.choice([0.7, 1.4]))
    return Truth((name("CAM"),), "C =")


@planting("a-priori errors")
def precision_in_micrometres(block: Planted, random: np.random.Generator) -> Truth:
    block.settings["measurement_precision"] *= 1e3
    return Truth((), "measurement_precision.*(micromet|µm|times larger)")


@planting("a-priori errors")
def precision_in_metres(block: Planted, random: np.random.Generator) -> Truth:
    block.settings["measurement_precision"] *= 1e-3
    return Truth((), "measurement_precision.*metres")


@planting("a-priori errors")
def control_errors_in_millimetres(block: Planted, random: np.random.Generator) -> Truth | None:
    if any((error == 0.0).any() for _, error in block.control.values()):
        return None
    block.control = {
        point: (xyz, np.where(error > 0.0, 1e3 * error, error)) for point, (xyz, error) in block.control.items()
    }
    return Truth((), "errors.*(thousandths|in mm)|promise", is_shown=True)


# --------------------------------------------------------------------------------------------------- given orientations


@planting("a given orientation")
def kappa_turned(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.is_oriented:
        return None
    (photo,) = _any(random, block.photos)
    block.orientation[photo][5] += 180.0
    return Truth((name(photo),), "KAPPA|180", is_shown=True)


@planting("a given orientation")
def centre_with_x_for_y(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.is_oriented:
        return None
    (photo,) = _any(random, block.photos)
    block.orientation[photo][:2] = block.orientation[photo][1::-1]
    return Truth((name(photo),), "X0|orientation|position|centre", is_shown=True)


@planting("a given orientation")
def slip_in_a_centre(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.is_oriented:
        return None
    (photo,) = _any(random, block.photos)
    block.orientation[photo][int(random.integers(2))] *= 0.1
    return Truth((name(photo),), "X0|Y0|orientation|position|centre", is_shown=True)


@planting("a given orientation")
def angles_in_gon(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.is_oriented:
        return None
    for values in block.orientation.values():
        values[3:] /= 0.9
    return Truth((), "gon")


@planting("a given orientation")
def angles_in_radians(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.is_oriented:
        return None
    for values in block.orientation.values():
        values[3:] = np.radians(values[3:])
    return Truth((), "radians")


# -------------------------------------------------------------------------------------------------------------- control


def _in_control(block: Planted, change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]) -> None:
    block.control = {point: change(xyz, error) for point, (xyz, error) in block.control.items()}


@planting("all control")
def north_east(block: Planted, random: np.random.Generator) -> Truth:
    _in_control(block, lambda xyz, error: (xyz[[1, 0, 2]], error[[1, 0, 2]]))
    return Truth((), "X and Y.*exchanged|north, east")


@planting("all control")
def heights_downwards(block: Planted, random: np.random.Generator) -> Truth:
    _in_control(block, lambda xyz, error: (xyz * [1.0, 1.0, -1.0], error))
    return Truth((), "Z.*(opposite sign|downwards)|one axis has the opposite sign")


@planting("all control")
def heights_in_feet(block: Planted, random: np.random.Generator) -> Truth:
    _in_control(block, lambda xyz, error: (xyz / [1.0, 1.0, 0.3048], error))
    return Truth((), "Z.*feet")


@planting("all control")
def control_in_feet(block: Planted, random: np.random.Generator) -> Truth | None:
    if not (block.is_oriented or block.distances):
        return None
    _in_control(block, lambda xyz, error: (xyz / 0.3048, error))
    return Truth((), "feet")


@planting("a control point")
def two_control_points_exchanged(block: Planted, random: np.random.Generator) -> Truth:
    one, other = _any(random, block.control_names, 2)
    block.control[one], block.control[other] = block.control[other], block.control[one]
    return Truth((name(one), name(other)), "exchanged")


def _with_coordinate(block: Planted, point: str, axis: int, value: float) -> Truth:
    xyz = block.control[point][0].copy()
    xyz[axis] = value
    block.control[point] = xyz, block.control[point][1]
    return Truth((name(point),), rf"\b{'XYZ'[axis]}\b")


@planting("a control point")
def wrong_digit(block: Planted, random: np.random.Generator) -> Truth:
    (point,) = _any(random, block.control_names)
    axis, size = int(random.integers(3)), float(np.ptp([xyz for xyz, _ in block.control.values()]))
    step = 10.0 ** np.floor(np.log10(float(random.choice([0.02, 0.3])) * size))
    return _with_coordinate(block, point, axis, round(float(block.control[point][0][axis] + step), 4))


@planting("a control point")
def two_digits_exchanged(block: Planted, random: np.random.Generator) -> Truth | None:
    (point,) = _any(random, block.control_names)
    axis = int(random.integers(3))
    text = f"{block.control[point][0][axis]:.4f}"
    places = [k for k in range(len(text) - 4) if text[k].isdigit() and text[k + 1].isdigit() and text[k] != text[k + 1]]
    if not places:
        return None
    place = places[int(random.integers(len(places)))]
    text = text[:place] + text[place + 1] + text[place] + text[place + 2 :]
    return _with_coordinate(block, point, axis, float(text))


@planting("a control point")
def height_off_by_a_little(block: Planted, random: np.random.Generator) -> Truth:
    (point,) = _any(random, block.control_names)
    size = float(np.ptp([xyz[0] for xyz, _ in block.control.values()]))
    return _with_coordinate(block, point, 2, block.control[point][0][2] + 0.1 * size)


@planting("a control point")
def zero_for_a_height(block: Planted, random: np.random.Generator) -> Truth:
    (point,) = _any(random, block.control_names)
    return _with_coordinate(block, point, 2, 0.0)


@planting("a control point")
def x_for_y_in_a_control_point(block: Planted, random: np.random.Generator) -> Truth:
    (point,) = _any(random, block.control_names)
    xyz, error = block.control[point]
    block.control[point] = xyz[[1, 0, 2]], error
    return Truth((name(point),), "X and Y")


@planting("a control point")
def another_point_measured_for_control(block: Planted, random: np.random.Generator) -> Truth:
    (point,) = _any(random, block.control_names)
    away = {tie: float(np.linalg.norm(block.truth[tie] - block.truth[point])) for tie in block.tie_names}
    near = min(away, key=away.__getitem__)
    for key in [key for key in block.images if key[1] == point]:
        del block.images[key]
    block.images = {(photo, point if of == near else of): xy for (photo, of), xy in block.images.items()}
    return Truth((name(point),), "contradict|what was measured|off by")


@planting("a check point")
def check_point_far_off(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.check_names:
        return None
    (point,) = _any(random, block.check_names)
    axis = int(random.integers(3))
    return _shown(_with_coordinate(block, point, axis, block.control[point][0][axis] + 1000.0))


@planting("a check point")
def check_point_off_by_a_digit(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.check_names:
        return None
    (point,) = _any(random, block.check_names)
    size = float(np.ptp([xyz for xyz, _ in block.control.values()]))
    axis = int(random.integers(3))
    return _shown(
        _with_coordinate(block, point, axis, block.control[point][0][axis] + 10.0 ** np.floor(np.log10(0.05 * size)))
    )


@planting("a check point")
def two_check_points_exchanged(block: Planted, random: np.random.Generator) -> Truth | None:
    if len(block.check_names) < 2:
        return None
    one, other = _any(random, block.check_names, 2)
    block.control[one], block.control[other] = block.control[other], block.control[one]
    return Truth((name(one), name(other)), "exchanged", is_shown=True)


def _shown(truth: Truth) -> Truth:
    return Truth(truth.where, truth.what, is_shown=True)


# -------------------------------------------------------------------------------------------------------------- numbers


def _renamed(block: Planted, photos: list[str], names: dict[str, str]) -> None:
    block.images = {
        (photo, names.get(point, point) if photo in photos else point): xy
        for (photo, point), xy in block.images.items()
    }


@planting("numbers of points")
def one_number_for_two_points(block: Planted, random: np.random.Generator) -> Truth | None:
    ties = block.tie_names
    pairs = [
        (one, other)
        for one in ties
        for other in ties
        if one != other and not set(block.photos_of(one)) & set(block.photos_of(other))
    ]
    if not pairs:
        # the second point takes over where the first is not measured any more
        one, other = _any(random, ties, 2)
        shared = [photo for photo in block.photos_of(one) if photo in block.photos_of(other)]
        if len(shared) < 4:
            return None
        for rank, photo in enumerate(shared):
            del block.images[photo, other if rank % 2 else one]
        for photo in block.photos_of(other):
            if (photo, one) in block.images:
                del block.images[photo, other]
    else:
        one, other = pairs[int(random.integers(len(pairs)))]
    _renamed(block, block.photos, {other: one})
    return Truth((name(one),), "two points")


@planting("numbers of points")
def two_numbers_for_one_point(block: Planted, random: np.random.Generator) -> Truth | None:
    ties = [point for point in block.tie_names if len(block.photos_of(point)) >= 4]
    if not ties:
        return None
    (point,) = _any(random, ties)
    photos = block.photos_of(point)
    _renamed(block, photos[len(photos) // 2 :], {point: f"{point}x"})
    return Truth((name(point), name(f"{point}x")), "one point|same point", is_shown=True)


@planting("numbers of points")
def another_number_in_a_photo(block: Planted, random: np.random.Generator) -> Truth:
    (photo,) = _any(random, block.photos)
    ties = [point for point in block.points_of(photo) if point in block.tie_names]
    one, other = _any(random, ties, 2)
    del block.images[photo, other]
    _renamed(block, [photo], {one: other})
    return Truth((name(photo), name(one), name(other)), "number|probably")


@planting("numbers of points")
def two_numbers_exchanged_in_a_photo(block: Planted, random: np.random.Generator) -> Truth:
    (photo,) = _any(random, block.photos)
    one, other = _any(random, block.points_of(photo), 2)
    _renamed(block, [photo], {one: other, other: one})
    return Truth((name(photo), name(one), name(other)), "exchanged")


@planting("numbers of points")
def point_measured_in_the_wrong_place(block: Planted, random: np.random.Generator) -> Truth:
    photo, point = list(block.images)[int(random.integers(len(block.images)))]
    xy = np.array(list(block.images.values()))
    block.images[photo, point] = block.images[photo, point] + random.choice([-1.0, 1.0], 2) * 0.03 * np.ptp(xy, axis=0)
    return Truth((name(photo), name(point)), "does not fit|wrong|measure it again")


# ------------------------------------------------------------------------------------------------------------ distances


@planting("distances")
def wrong_distance(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.distances:
        return None
    (bar,) = _any(random, list(block.distances))
    start, end, length, error = block.distances[bar]
    block.distances[bar] = start, end, round(length + 10.0 ** np.floor(np.log10(0.5 * length)), 5), error
    return Truth((name(bar),), "distance")


@planting("distances")
def distances_in_feet(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.distances:
        return None
    block.distances = {
        bar: (start, end, length / 0.3048, error) for bar, (start, end, length, error) in block.distances.items()
    }
    return Truth((), "feet")


@planting("distances")
def distance_to_another_point(block: Planted, random: np.random.Generator) -> Truth | None:
    if not block.distances:
        return None
    (bar,) = _any(random, list(block.distances))
    start, end, length, error = block.distances[bar]
    (other,) = _any(random, [point for point in block.truth if point not in {start, end}])
    block.distances[bar] = start, other, length, error
    return Truth((name(bar),), "distance")


def planted(block: Planted, mistake: str, number: int) -> tuple[Planted, Truth] | None:
    """Return a copy of a block with a mistake, and what there is to find; None where it cannot be made."""
    changed = copy.deepcopy(block)
    random = np.random.default_rng([number, sorted(PLANTED).index(mistake)])
    truth = PLANTED[mistake][1](changed, random)
    return None if truth is None else (changed, truth)
