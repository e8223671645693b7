"""Positions of photos in degrees, in another order, unit or height system: the first sentence names it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import Said, orip
from mistakes.data.drone import drone
from mistakes.first_line import first_line
from mistakes.small_folders import aerial, images, known
from support.long_cases import in_turn

from orip.structs import replace

SPREAD = ("00", "04", "40", "44", "80", "84", "42")
PHOTOS = {
    f"P{4 * row + column + 1}": (1000.0 + 900.0 * column, 1500.0 + 500.0 * row, 1600.0 + 7.0 * column, 0.4, 0.5, 1.0)
    for row in range(3)
    for column in range(4)
}
LAST = ("P9", "P10", "P11", "P12")
FOOT = 0.3048

ORIGIN = np.array([563000.0, 5933000.0, 0.0])

PLACES = ORIGIN + [values[:3] for values in PHOTOS.values()]

Change = Callable[[np.ndarray], np.ndarray]


def as_degrees(places: np.ndarray) -> np.ndarray:
    return np.column_stack([places[:, 0] / 66000.0, places[:, 1] / 111000.0, places[:, 2]])


def sorted_as_text(places: np.ndarray) -> np.ndarray:
    return places[np.argsort(list(PHOTOS))]


def some_exchanged(places: np.ndarray) -> np.ndarray:
    return places[[0, 1, 2, 7, 6, 5, 4, 3, 8, 9, 10, 11]]


MISREAD: dict[str, tuple[Change, str, str]] = {
    "degrees": (as_degrees, "are longitude and latitude in degrees", "in degrees stand beside coordinates"),
    "sorted as text": (sorted_as_text, "they are sorted as text", "under the names of others"),
    "another order": (some_exchanged, "that of P4 stands under P8, and so on; match", "under the names of others"),
    "heights above the ellipsoid": (
        lambda places: places + np.array([0.0, 0.0, 42.7]), "different height systems", "in different height systems"
    ),
    "zone before the easting": (
        lambda places: places + np.array([32e6, 0.0, 0.0]), "the number of a zone, 32", "are in different systems"
    ),
    "north before east": (lambda places: places[:, [1, 0, 2]], "columns X and Y of the ", "are in different systems"),
    "feet": (lambda places: places / FOOT, " in feet; write both", "are in different systems"),
    "heights in feet": (lambda places: places / [1.0, 1.0, FOOT], "Z fits when", "in another unit than the control"),
    "leading digits left out": (
        lambda places: places - [500000.0, 5900000.0, 0.0],
        "left out of the positions: write whole coordinates there, as in the control: add +500000 to X and +5900000",
        "leading digits are missing",
    ),
    "local system": (
        lambda places: places - [563412.3, 5933128.7, 0.0],
        "the positions are in a local system: write whole coordinates there, as in the control: add +563412.",
        "are in another system, or a local one",
    ),
    "depths": (lambda places: places * [1.0, 1.0, -1.0], "Z has the opposite sign", "the axes of the stations"),
}  # fmt: skip
"""How positions are changed, words of the first line that is said of it, and of the status."""


def told(folder: Path, ending: str, places: np.ndarray, c_of_last: float = 150.0) -> Said:
    """Write a project with positions of its photos, and return what an adjustment says."""
    made = aerial(photos=PHOTOS)
    others = images(PHOTOS, made.points, c_of_last, 115.0, 0.004)
    measured = {photo: (others if photo in LAST else made.measured)[photo] for photo in PHOTOS}
    points = {name: xyz + ORIGIN for name, xyz in made.points.items()}
    replace(made, measured=measured, control=known(points, 0.02, SPREAD)).write(folder)
    noise = np.random.default_rng(5).normal(scale=0.03, size=places.shape)
    lines = []
    for name, place in zip(PHOTOS, places + (noise if np.abs(places[:, :2]).max() > 180.0 else 0.0), strict=True):
        x, y, z = (f"{value:.8f}" for value in place)
        if ending == "STA":
            lines.append(f"{name} {x} {y} {z} 0.03 0.03 0.03")
        else:
            lines += [
                f"{name} PHOTO {kind} {value} 0.03" for kind, value in zip(("X0", "Y0", "Z0"), (x, y, z), strict=True)
            ]
    (folder / f"T.{ending}").write_text("".join(f"{line}\n" for line in lines))
    return orip(folder, "run", "--no-report")


def status(said: Said) -> str:
    return next(line for line in said.told.splitlines() if re.match("status |error: ", line))


@pytest.mark.parametrize(("name", "ending"), in_turn(MISREAD, ["STA", "ELE"]))
def test_positions_that_were_written_otherwise_are_named_first(tmp_path: Path, name: str, ending: str) -> None:
    change, words, short = MISREAD[name]
    said = told(tmp_path / "folder", ending, change(PLACES))
    line = first_line([said])
    assert words in line, said.told
    assert "of the control file" not in line, "it is the positions that are wrong"
    assert short in status(said), said.told
    assert "set lever_arm" not in said.told
    assert "set shift" not in said.told


@pytest.mark.parametrize("ending", ["STA", "ELE"])
def test_positions_as_they_should_be_are_not_doubted(tmp_path: Path, ending: str) -> None:
    said = told(tmp_path / "folder", ending, PLACES)
    assert first_line([said]).startswith("status   converged"), said.told


def test_control_without_heights_is_named_and_not_the_stations(tmp_path: Path) -> None:
    control = drone(tmp_path / "drone") / "DRONE.PNT"
    control.write_text(re.sub(r"(?m)^(\w+ +\S+ +\S+) +\S+", r"\1 0.000", control.read_text()))
    said = orip(tmp_path / "drone", "run", "--no-report")
    assert first_line([said]).startswith("warning: control points: all 5 have the height 0, and the stations"), (
        said.told
    )
    assert "the heights of the control are not filled in" in status(said)


def test_a_system_of_another_scale_is_named_before_the_heights(tmp_path: Path) -> None:
    text = drone(tmp_path / "drone") / "orip.toml"
    text.write_text(text.read_text().replace("EPSG:25832", "EPSG:3857"))
    said = orip(tmp_path / "drone", "run", "--no-report")
    # northing 5934170 is 47 degrees of the Mercator projection, where lengths are 1 / cos(47 degrees) = 1.46 times
    assert "warning: crs: its grid makes lengths at the block 1.46" in said.told
    assert "different height systems" not in said.told
    assert "crs is probably not the system of the coordinates" in status(said)


def test_no_lever_arm_or_shift_of_hundreds_of_metres_is_advised(tmp_path: Path) -> None:
    said = told(tmp_path / "folder", "STA", PLACES + np.array([310.0, -140.0, 260.0]))
    assert "are all off by" in said.told
    assert "set " not in said.told
    assert "no shift is so large" in said.told


@pytest.mark.long
def test_a_shift_that_gnss_can_be_off_by_is_still_to_be_set(tmp_path: Path) -> None:
    said = told(tmp_path / "folder", "STA", PLACES + np.array([3.0, -1.5, 2.0]))
    assert "set shift" in said.told


@pytest.mark.long
@pytest.mark.parametrize("ending", ["STA", "ELE"])
def test_photos_of_two_lenses_under_one_camera_are_named_instead_of_their_stations(tmp_path: Path, ending: str) -> None:
    said = told(tmp_path / "folder", ending, PLACES, c_of_last=153.0)
    line = first_line([said])
    assert "photos P9, P10, P11 and 1 more: they fit with C = 153" in line, said.told
    # the adjustment of the data as given may end without convergence: then the status says that alone
    assert "converged, but photos of one camera were taken with two lenses" in status(said) or said.code == 4


def test_a_strip_whose_heights_are_off_is_not_taken_for_another_lens(tmp_path: Path) -> None:
    said = told(tmp_path / "folder", "STA", PLACES + 30.0 * np.outer(np.arange(12) >= 8, [0.0, 0.0, 1.0]))
    assert "another lens" not in said.told
