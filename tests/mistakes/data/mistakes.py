"""Fifteen mistakes in data, not in their form: how each is made, what the first line has to tell, and must not."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from mistakes.data.drone import (
    COLUMNS,
    ROWS,
    Line,
    calibrated_drone,
    drone,
    image,
    in_lines,
    in_measurements,
    moved,
    truth,
)
from mistakes.data.simulated_projects import scale_bar_project, two_camera_project
from msgspec import Struct
from workflow.small_projects import replace_in

Score = int
"""Of a first line: 3 names mistake and place, 2 only one of them, 1 neither, 0 something else in their place."""


class DataMistake(Struct, frozen=True):
    """A mistake.

    Attributes
    ----------
    title : str
    clean : callable
        Writes the project without the mistake into a new folder.
    make : callable
        Makes the mistake in it.
    cause, place : tuple of str
        Words of the first line: what is wrong, and where; each of them has to be there.
    """

    title: str
    clean: Callable[[Path], Path]
    make: Callable[[Path], None]
    cause: tuple[str, ...]
    place: tuple[str, ...]

    def score(self, line: str) -> Score:
        """Return how well a first line tells the mistake."""
        cause, place = (all(words in line for words in parts) for parts in (self.cause, self.place))
        if cause and place:
            return 3
        if cause or place:
            return 2
        return 1 if line.startswith("status   converged") else 0


DATA_MISTAKES: dict[str, DataMistake] = {}


def mistake(
    title: str, cause: tuple[str, ...], place: tuple[str, ...],
    clean: Callable[[Path], Path] = drone,
) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:  # fmt: skip
    """Enter a function that makes a mistake into the catalogue, under its name."""

    def enter(make: Callable[[Path], None]) -> Callable[[Path], None]:
        DATA_MISTAKES[make.__name__] = DataMistake(title, clean, make, cause, place)
        return make

    return enter


@mistake("Stations of the antenna in place of the camera", ("lever arm",), ("exposure stations",), calibrated_drone)
def antenna_offset(folder: Path) -> None:
    kappa = {name: np.radians(values[5]) for name, values in truth()["photos"].items()}

    def of_antenna(words: Line) -> Line:
        c, s = np.cos(kappa[words[0]]), np.sin(kappa[words[0]])
        return moved(words, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ [0.06, 0.12, 0.36])

    in_lines(folder / "DRONE.STA", of_antenna)


@mistake("RTK positions moved by one photo", ("moved by one photo",), ("exposure stations",))
def moved_by_one_photo(folder: Path) -> None:
    path = folder / "DRONE.STA"
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    shifted = [[name[0], *values[1:]] for name, values in pairwise(lines)]
    path.write_text("".join("  ".join(words) + "\n" for words in shifted), encoding="utf-8")


@mistake("Control above the geoid, stations above the ellipsoid", ("height",), ("control points", "stations"))
def two_height_systems(folder: Path) -> None:
    in_lines(folder / "DRONE.PNT", lambda words: moved(words, np.array([0.0, 0.0, -42.317])))


@mistake("The zone's number before the easting in one file", ("zone", "32"), ("control points",))
def zone_prefix(folder: Path) -> None:
    in_lines(folder / "DRONE.PNT", lambda words: moved(words, np.array([32_000_000.0, 0.0, 0.0])))


@mistake("Measured in pictures of half the resolution", ("multiplied by 2", "lower resolution"), ("ZENMUSE",))
def half_resolution(folder: Path) -> None:
    in_measurements(folder, lambda _, point, column, row: (point, column / 2.0, row / 2.0))


@mistake("One photo in portrait format", ("turned by 90",), ("DJI_0030",))
def one_portrait_photo(folder: Path) -> None:
    in_measurements(
        folder,
        lambda photo, point, column, row: (point, ROWS - row, column) if photo == "DJI_0030" else (point, column, row),
    )


@mistake("Names of control points with a hyphen", ("K-1", "K1", "hyphen"), ("control point",))
def hyphen_in_names(folder: Path) -> None:
    in_lines(folder / "DRONE.PNT", lambda words: [f"{words[0][0]}-{words[0][1:]}", *words[1:]])


@mistake("A control point at the wrong stone in all photos", ("measured", "surveyed"), ("control point K1",))
def wrong_stone(folder: Path) -> None:
    place = np.array(truth()["points"]["K1"])
    stone = place + np.array([0.9, -0.6, 0.1])

    def at_stone(photo: str, point: str, column: float, row: float) -> tuple[str, float, float]:
        off = image(photo, stone) - image(photo, place) if point == "K1" else np.zeros(2)
        return point, column + float(off[0]), row + float(off[1])

    in_measurements(folder, at_stone)


@mistake("File names with .JPG in the stations alone", (".JPG",), ("exposure stations",))
def jpg_in_one_file(folder: Path) -> None:
    in_lines(folder / "DRONE.STA", lambda words: [f"{words[0]}.JPG", *words[1:]])


@mistake("A file of control that is not read", ("not read",), ("gcp.csv",))
def unread_file(folder: Path) -> None:
    path = folder / "DRONE.PNT"
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("!")]
    rows = ["name,easting,northing,height", *(",".join(words[:4]) for words in lines)]
    (folder / "gcp.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    path.unlink()


@mistake("datum forgotten", ('datum = "free"',), ("bundle",), scale_bar_project)
def datum_forgotten(folder: Path) -> None:
    replace_in(folder / "orip.toml", 'datum = "free"\n', "")


@mistake('datum = "free" beside stations', ('datum = "free"',), ("exposure stations",))
def free_with_stations(folder: Path) -> None:
    replace_in(folder / "orip.toml", 'name = "FLIGHT"\n', 'name = "FLIGHT"\ndatum = "free"\n')


@mistake("The wrong one of two cameras", ("camera LEFT", "not with RIGHT"), ("photo L05",), two_camera_project)
def wrong_camera_of_two(folder: Path) -> None:
    replace_in(folder / "orip.toml", 'name = "L05"\ncamera = "LEFT"', 'name = "L05"\ncamera = "RIGHT"')


@mistake("Control in US survey feet", ("feet",), ("control",))
def us_feet(folder: Path) -> None:
    def in_feet(words: Line) -> Line:
        return [words[0], *(f"{float(value) * 3937.0 / 1200.0:.4f}" for value in words[1:])]

    in_lines(folder / "DRONE.PNT", in_feet)


@mistake("Photos of another flight under numbers that are used again", ("another flight",), ("DJI_0055",))
def another_flight(folder: Path) -> None:
    of_flight = {name for name, strip in truth()["strips"].items() if strip == "S6"}
    numbers = [name for name in truth()["points"] if name.isdigit()]
    other = dict(zip(numbers, [*numbers[37:], *numbers[:37]], strict=True))
    in_measurements(
        folder,
        lambda photo, point, column, row: (other.get(point, point) if photo in of_flight else point, column, row),
    )


assert len(DATA_MISTAKES) == 15
assert COLUMNS > ROWS
