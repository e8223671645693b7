"""Blunders of every kind that is planted in published blocks: of photo points, control, stations, cameras and photos.

Each is a function that changes a block in place and returns what there is to find, or None where the block has nothing
that it could be made in.
"""

from __future__ import annotations

import copy
import re
import zlib
from collections.abc import Sequence

import numpy as np
from mistakes.planted import mistakes
from mistakes.planted.blocks import Planted
from mistakes.planted.mistakes import Planting, Truth, name
from mistakes.planted.published import published_block
from msgspec import Struct

import orip
from orip.bundle.results.reliability import suspect_rows
from orip.bundle.solve import solve_block
from orip.prelim.chain import preliminary_values_from_all_rays
from orip.solving.starting_values import started_block
from orip.structs import replace

_CAUSES = {"group", "mistake", "unsteady"}
"""Codes of diagnoses that accuse something."""

_NOTHING = re.compile(
    r"were not used to orient|without preliminary coordinates|computed from preliminary values|"
    r"could not be oriented|see the warning|is left out|differ only in case"
)
"""What accuses nothing."""


class Blunder(Struct, frozen=True):
    """A kind of blunder that is planted: what makes it, and with which word a line about it begins."""

    make: Planting
    subjects: str


def _point(block: Planted, random: np.random.Generator, least: int = 3) -> tuple[str, str]:
    keys = [key for key in block.images if len(block.photos_of(key[1])) >= least]
    return keys[int(random.integers(len(keys)))]


def _in_photo(key: tuple[str, str]) -> Truth:
    return Truth((name(key[0]), name(key[1])), "")


def _sd(block: Planted) -> float:
    precision = block.settings["measurement_precision"]
    if isinstance(precision, str):
        return float(precision.removesuffix("px"))
    sensor = block.cameras[0]["sensor"]
    return float(precision * sensor["columns"] / sensor["width"])


def coordinate_off(block: Planted, random: np.random.Generator) -> Truth:
    """One photo coordinate off by 15 to 200 standard deviations."""
    key = _point(block, random)
    xy = block.images[key].copy()
    size = _sd(block) * np.exp(random.uniform(np.log(15.0), np.log(200.0)))
    xy[int(random.integers(2))] += size * random.choice([-1.0, 1.0])
    block.images[key] = xy
    return _in_photo(key)


def _mistyped(value: float, decimals: int, random: np.random.Generator, least: float) -> float | None:
    text = f"{value:.{decimals}f}"
    for place in random.permutation([k for k, letter in enumerate(text) if letter.isdigit()]).tolist():
        for digit in random.permutation(list("0123456789")).tolist():
            changed = float(text[:place] + digit + text[place + 1 :])
            if abs(changed - value) > least:
                return changed
    return None


def digit_in_a_photo(block: Planted, random: np.random.Generator) -> Truth | None:
    """One digit of a photo coordinate mistyped."""
    key = _point(block, random)
    xy, axis = block.images[key].copy(), int(random.integers(2))
    changed = _mistyped(float(xy[axis]), 1, random, 15.0 * _sd(block))
    if changed is None:
        return None
    xy[axis] = changed
    block.images[key] = xy
    return _in_photo(key)


def x_for_y(block: Planted, random: np.random.Generator) -> Truth:
    """Column and row of a photo point exchanged."""
    key = _point(block, random)
    block.images[key] = block.images[key][::-1]
    return _in_photo(key)


def mirrored_point(block: Planted, random: np.random.Generator) -> Truth:
    """The sign of a photo coordinate (from the centre) lost."""
    key = _point(block, random)
    sensor, axis = block.cameras[0]["sensor"], int(random.integers(2))
    xy = block.images[key].copy()
    xy[axis] = sensor["columns" if axis == 0 else "rows"] - xy[axis]
    block.images[key] = xy
    return _in_photo(key)


def points_exchanged(block: Planted, random: np.random.Generator) -> Truth:
    """The numbers of two points of a photo exchanged, each of them in three photos or more."""
    photo, point = _point(block, random)
    others = [other for other in block.points_of(photo) if other != point and len(block.photos_of(other)) >= 3]
    other = _nearest(block, photo, point, others, random)
    block.images[photo, point], block.images[photo, other] = block.images[photo, other], block.images[photo, point]
    return Truth((name(photo), name(point), name(other)), "exchanged")


def _nearest(block: Planted, photo: str, point: str, others: list[str], random: np.random.Generator) -> str:
    away = sorted(others, key=lambda other: float(np.sum((block.truth[other] - block.truth[point]) ** 2)))
    return away[int(random.integers(min(4, len(away))))]


def neighbours_number(block: Planted, random: np.random.Generator) -> Truth | None:
    """A tie point has the number of a neighbour in a photo, in which that is not measured (any more)."""
    photo, point = _point(block, random, least=4)
    others = [other for other in block.tie_names if other != point and len(block.photos_of(other)) >= 4]
    if not others or point in block.control:
        return None
    other = _nearest(block, photo, point, others, random)
    xy = block.images.pop((photo, point))
    block.images[photo, other] = xy
    return Truth((name(photo), name(other), name(point)), "")


def control_digit(block: Planted, random: np.random.Generator) -> Truth | None:
    """One digit of a control coordinate mistyped, by a part of the extent of the control or less."""
    point = block.control_names[int(random.integers(len(block.control_names)))]
    axis = int(random.integers(3))
    xyz, error = block.control[point]
    size = float(np.ptp([given for given, _ in block.control.values()], axis=0).max())
    changed = _mistyped(float(xyz[axis]), 4 if size < 3.0 else 3, random, 1e-3 * size)
    if changed is None or abs(changed - xyz[axis]) > 3.0 * size:
        return None
    block.control[point] = np.where(np.arange(3) == axis, changed, xyz), error
    return Truth((name(point),), rf"\b{'XYZ'[axis]}\b")


def control_sign(block: Planted, random: np.random.Generator) -> Truth | None:
    """The sign of a control coordinate lost."""
    points = [(point, axis) for point in block.control_names for axis in range(3) if block.control[point][0][axis]]
    point, axis = points[int(random.integers(len(points)))]
    xyz, error = block.control[point]
    size = float(np.ptp([given for given, _ in block.control.values()], axis=0).max())
    if abs(xyz[axis]) > 5.0 * size:
        return None
    block.control[point] = np.where(np.arange(3) == axis, -xyz, xyz), error
    return Truth((name(point),), rf"\b{'XYZ'[axis]}\b")


def control_x_for_y(block: Planted, random: np.random.Generator) -> Truth:
    """X and Y of a control point exchanged."""
    return replace(mistakes.x_for_y_in_a_control_point(block, random), what=r"\bX\b.*\bY\b")


def control_height(block: Planted, random: np.random.Generator) -> Truth:
    """A control height off by half a metre, in small blocks by a twentieth of the extent."""
    point = block.control_names[int(random.integers(len(block.control_names)))]
    xyz, error = block.control[point]
    size = float(np.ptp([given for given, _ in block.control.values()], axis=0).max())
    step = 0.5 if size > 20.0 else 0.05 * size
    block.control[point] = xyz + np.array([0.0, 0.0, step * random.choice([-1.0, 1.0])]), error
    return Truth((name(point),), r"\bZ\b")


def station_off(block: Planted, random: np.random.Generator) -> Truth | None:
    """A coordinate of an observed station off by 15 to 200 standard deviations."""
    given = block.settings.get("stations")
    if given is None:
        return None
    row, axis = int(random.integers(len(block.photos))), int(random.integers(3))
    xyz = np.array(given.coordinates)
    xyz[row, axis] += given.error * np.exp(random.uniform(np.log(15.0), np.log(200.0))) * random.choice([-1.0, 1.0])
    block.settings["stations"] = orip.Stations(given.name, xyz, given.error)
    return Truth((name(block.photos[row]),), rf"\b{'XYZ'[axis]}0?\b")


def camera_constant(block: Planted, random: np.random.Generator) -> Truth | None:
    """Two digits of a held camera constant exchanged."""
    camera = block.cameras[0]
    if "C" in camera.get("unknown", ()):
        return None
    text = f"{camera['c']:.4f}"
    place = int(
        random.choice([k for k in range(len(text) - 1) if text[k : k + 2].isdigit() and text[k] != text[k + 1]])
    )
    camera["c"] = float(text[:place] + text[place + 1] + text[place] + text[place + 2 :])
    return Truth((name(camera["name"]),), r"\bC\b")


def another_lens(block: Planted, random: np.random.Generator) -> Truth | None:
    """A photo has the camera of another lens, whose C is held: one that is unknown would be estimated."""
    return None if "C" in block.cameras[0].get("unknown", ()) else mistakes.one_photo_of_another_lens(block, random)


def photos_exchanged(block: Planted, random: np.random.Generator) -> Truth | None:
    """What was measured in two photos exchanged, where given orientations are good enough to show it."""
    truth = mistakes.two_photos_exchanged(block, random)
    if truth is None:
        return None
    one, other = (next(photo for photo in block.photos if name(photo) == where) for where in truth.where)
    own = [np.linalg.norm(block.orientation[photo][:3] - block.adjusted[photo]) for photo in (one, other)]
    apart = np.linalg.norm(block.adjusted[one] - block.adjusted[other])
    return truth if max(own) < 0.3 * apart else None


def check_point_off(block: Planted, random: np.random.Generator) -> Truth | None:
    """A check point off by a metre, in small blocks by a tenth of the extent."""
    return mistakes.check_point_off_by_a_digit(block, random)


_PHOTO, _CONTROL, ANY_PHOTO = r"photo|point", r"control point", r"photo|camera|points"
KINDS: dict[str, Blunder] = {
    "photo coordinate off": Blunder(coordinate_off, _PHOTO),
    "digit of a photo coordinate": Blunder(digit_in_a_photo, _PHOTO),
    "x and y of a photo point": Blunder(x_for_y, _PHOTO),
    "sign of a photo coordinate": Blunder(mirrored_point, _PHOTO),
    "two points exchanged in a photo": Blunder(points_exchanged, _PHOTO),
    "a neighbour's number": Blunder(neighbours_number, _PHOTO),
    "two numbers for one point": Blunder(mistakes.two_numbers_for_one_point, _PHOTO),
    "control: digit": Blunder(control_digit, _CONTROL),
    "control: two digits exchanged": Blunder(mistakes.two_digits_exchanged, _CONTROL),
    "control: sign": Blunder(control_sign, _CONTROL),
    "control: height": Blunder(control_height, _CONTROL),
    "control: X for Y": Blunder(control_x_for_y, _CONTROL),
    "control: two points exchanged": Blunder(mistakes.two_control_points_exchanged, _CONTROL),
    "check point": Blunder(check_point_off, "check point"),
    "station": Blunder(station_off, "photo|exposure station"),
    "camera constant": Blunder(camera_constant, "camera"),
    "another lens": Blunder(another_lens, ANY_PHOTO),
    "photo mirrored": Blunder(mistakes.one_photo_x_mirrored, ANY_PHOTO),
    "x for y in a photo": Blunder(mistakes.one_photo_x_for_y, ANY_PHOTO),
    "two photos exchanged": Blunder(photos_exchanged, ANY_PHOTO),
    "photo twice": Blunder(mistakes.same_photo_twice, ANY_PHOTO),
    "numbers shifted by a line": Blunder(mistakes.points_shifted_by_a_line, ANY_PHOTO),
}


def said_of(block: Planted) -> list[str]:
    """Return what a user reads of an adjustment, in its order: warnings or errors, contradictions, what misfits."""
    try:
        made = block.block()
        found = made.adjust()
    except orip.OripError as error:
        return [line for line in str(error).splitlines() if not _NOTHING.search(line)]
    record = found._record
    lines = [str(warning) for warning in found.warnings]
    lines += [f"{given.where}: {given.text}" for given in found.diagnosis if given.code in _CAUSES]
    rows = record.residuals
    lines += [
        f"{'photo' if rows.photo[row] else rows.kind[row] + ' point'} {rows.photo[row]} {rows.point[row]} "
        f"{rows.component[row]} misfits"
        for row in suspect_rows(record)[:1].tolist()
    ]
    return [line for line in dict.fromkeys(lines) if not _NOTHING.search(line)]


def squares(block: Planted) -> float:
    """Return the weighted sum of squares of an adjustment with all weights; infinite where there is none."""
    plain = copy.copy(block)
    plain.settings = block.settings | {"max_iterations": 30, "start_down_weight": 30}
    try:
        gathered = plain.block()._gathered
        found = solve_block(started_block(gathered, preliminary_values_from_all_rays).block, lambda _: None, _never)
    except (orip.OripError, ValueError):
        return np.inf
    return found.variance.sigma0_all**2 * found.variance.redundancy if found.converged else np.inf


def _never() -> bool:
    return False


def sound_block(block_name: str) -> tuple[Planted, float]:
    """Return a published block with its points and projection centres as they are adjusted, and its sigma0."""
    sound = published_block(block_name)
    clean = sound.block().adjust()
    sound.truth = dict(zip(clean.points.names, clean.points.coordinates, strict=True))
    sound.adjusted = dict(zip(clean.photos.names, clean.photos.orientations[:, :3], strict=True))
    return sound, float(clean.sigma0_all)


def planted_in(sound: Planted, block_name: str, kind: str, place: int) -> tuple[Planted, Truth | None]:
    """Return a copy of a block with a blunder, and what there is to find; None where it cannot be made."""
    random = np.random.default_rng([place, zlib.crc32(f"{block_name} {kind}".encode())])
    block = copy.deepcopy(sound)
    return block, KINDS[kind].make(block, random)


def judged(said: Sequence[str], truth: Truth, subjects: str) -> str:
    """Return how a blunder was answered."""
    if not said:
        return "silent"
    complete = [_names_all(line, truth) for line in said]
    if complete[0]:
        return "named"
    is_subject = re.match(rf"(warning: |error: )?(?:{subjects})", said[0])
    if is_subject and any(re.search(where, said[0]) for where in truth.where):
        return "placed"
    return "later" if any(complete) else "wrong"


def _names_all(line: str, truth: Truth) -> bool:
    return all(re.search(where, line) for where in truth.where) and bool(re.search(truth.what, line))
