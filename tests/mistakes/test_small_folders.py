"""What orip says of small projects with one mistake each, and with none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from mistakes.first_line import first_line
from mistakes.small_folders import AERIAL, Folder, aerial, changed, flat_field, images, known, north_first
from support.long_cases import every, with_long

from orip.structs import replace
from orip.units import METRES_PER_FOOT

SPREAD = ("00", "04", "40", "44", "80", "84", "42")


def one_photo() -> Folder:
    photo = {"P1": AERIAL["P1"]}
    made = aerial(photos=photo)
    four = ["00", "04", "20", "24"]
    measured = {"P1": {name: xy for name, xy in made.measured["P1"].items() if name in four}}
    return replace(made, measured=measured, control=known(made.points, 0, list(measured["P1"])))


def free_network() -> Folder:
    made = aerial()
    approximate = tuple(f"{name} {x:.2f} {y:.2f} {z:.2f}" for name, (x, y, z) in made.points.items())
    bundle = f'{made.bundle}\ndatum = "free"'
    return replace(made, control=["! none"], preliminary=approximate, bundle=bundle)


def north_before_east() -> Folder:
    made = aerial(1.0)
    return replace(made, control=north_first(made.points, 0.02))


def north_before_east_in_two_photos() -> Folder:
    made = aerial(photos={name: AERIAL[name] for name in ("P1", "P2")})
    six = {name: made.points[name] for name in ("10", "14", "20", "22", "30", "34")}
    return replace(made, control=north_first(six, 0), bundle="measurement_precision = 0.003")


def y_downwards() -> Folder:
    made = aerial(1.0)
    return replace(made, measured=changed(made.measured, made.measured, lambda x, y: (x, -y)))


def one_mirrored() -> Folder:
    made = aerial()
    mirrored = changed(made.measured, ["P2"], lambda x, y: (x, -y))
    return replace(made, measured=mirrored, control=known(made.points, 0.02, SPREAD))


def micrometres() -> Folder:
    made = aerial()
    return replace(made, measured=changed(made.measured, made.measured, lambda x, y: (1000.0 * x, 1000.0 * y)))


def check_point_off() -> Folder:
    made = aerial()
    wrong = {**made.points, "21": made.points["21"] + [0.0, 1000.0, 0.0]}
    return replace(made, control=[*known(made.points, 0.02, SPREAD), *known(wrong, -1, ("21", "22", "23", "61", "62"))])


def measured_again(setting: str) -> Folder:
    made = aerial()
    name, (x, y) = next(iter(made.measured["P2"].items()))
    bundle = f'{made.bundle}\nrepeated_points = "{setting}"'
    return replace(made, more=("POINTS MAIN P2", f"  {name} {x + 5.0:.4f} {y:.4f}"), bundle=bundle)


def kappa_turned() -> Folder:
    return aerial(given={**AERIAL, "P2": (*AERIAL["P2"][:5], 181.0)})


def orientations_exchanged() -> Folder:
    return aerial(given={**AERIAL, "P2": AERIAL["P3"], "P3": AERIAL["P2"]})


SAID: dict[str, tuple[Callable[[], Folder], int | None, tuple[str, ...]]] = {
    "one photo": (one_photo, 0, ("status   converged",)),
    "free network": (free_network, 0, ("status   converged",)),
    "no mistake": (aerial, 0, ("status   converged",)),
    "north before east": (north_before_east, 4, ("error: ", "X and Y of the control are exchanged")),
    "north before east, two photos": (
        north_before_east_in_two_photos,
        4,
        ("error: ", "X and Y of the control are exchanged"),
    ),
    "y downwards": (y_downwards, 4, ("error: ", "as a mirror image", "the photos are mirrored")),
    "one photo mirrored": (one_mirrored, None, ("warning: photo P2: it fits as a mirror image",)),
    "micrometres": (micrometres, 4, ("warning: camera C: photo coordinates reach", "they seem to be in micrometres")),
    "check point off": (check_point_off, 0, ("warning: check point 21", "+1000.", "one digit is wrong")),
    "height of a test field": (
        flat_field,
        0,
        (
            "one of them is wrong, and all others fit without it",
            "6_6 by Z -0.100 ",
        ),
    ),
    "measured again, replaced": (lambda: measured_again("replace"), 0, ("of photo P2 was measured before, 5 mm",)),
    "measured again, averaged": (lambda: measured_again("mean"), 0, ("of photo P2 was measured before, 5 mm",)),
    "measured again, both": (lambda: measured_again("both"), 0, ("of photo P2 was measured before, 5 mm",)),
    "kappa off by 180 degrees": (kappa_turned, 0, ("warning: photo P2", "KAPPA is off by 180°")),
    "orientations exchanged": (orientations_exchanged, 0, ("warning: photos P2 and P3 are exchanged",)),
}
"""What is made, the exit code, and words of the first line that is said of it.

Where one photo of four is mirrored, nothing says whether the others, which share few points, converge without it.
"""


@pytest.mark.parametrize("name", with_long(["one photo mirrored"], SAID))
def test_the_first_line_names_the_mistake(tmp_path: Path, name: str) -> None:
    make, code, words = SAID[name]
    said = orip(make().write(tmp_path / "folder"), "run", "--no-report")
    line = first_line([said])
    assert [word for word in words if word not in line] == [], line
    assert code is None or said.code == code


def bars(made: Folder, factor: float, count: int = 3) -> str:
    """Return lines of some distances, of which the first is multiplied by a factor."""
    ends = [("00", "44", factor), ("20", "64", 1.0), ("40", "84", 1.0)][:count]
    lengths = [np.linalg.norm(made.points[start] - made.points[end]) * by for start, end, by in ends]
    errors = [0.001 * factor, 0.001, 0.001]
    return "".join(
        f"BAR{row} {start} {end} XYZ {lengths[row]:.4f} {errors[row]:.6f}\n" for row, (start, end, _) in enumerate(ends)
    )


@pytest.mark.parametrize(
    ("factor", "multiplied", "unit", "others"),
    every(
        3,
        [
            (1000.0, 0.001, "millimetres", "BAR1"),
            (100.0, 0.01, "centimetres", "BAR1, BAR2"),
            (1.0 / METRES_PER_FOOT, 0.3048, "feet", "BAR1, BAR2"),
        ],
    ),
)
def test_one_distance_in_another_unit_is_named_without_control(
    tmp_path: Path, factor: float, multiplied: float, unit: str, others: str
) -> None:
    made = free_network()
    folder = made.write(tmp_path / "folder")
    (folder / "T.LEN").write_text(bars(made, factor, 1 + len(others.split())))
    line = first_line([orip(folder, "run", "--no-report")])
    assert f"factor {multiplied} for BAR0: written in {unit}, as it seems, and {others} in metres" in line


@pytest.mark.parametrize("factor", every(2, [1.0, 2.0]))
def test_no_unit_is_named_where_none_explains_the_distances(tmp_path: Path, factor: float) -> None:
    made = free_network()
    folder = made.write(tmp_path / "folder")
    (folder / "T.LEN").write_text(bars(made, factor))
    said = orip(folder, "run", "--no-report").told
    assert "status  " in said
    assert "as it seems" not in said
    assert "seem to be in" not in said


def test_images_are_those_of_the_photos() -> None:
    made = aerial()
    assert all(len(points) >= 20 for points in images(AERIAL, made.points, 150.0, 115.0, 0.0).values())
