"""The first sentence on a project with one mistake names its cause and a mend, and nothing that follows from it."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import Said, orip
from mistakes.first_line import first_line
from mistakes.small_folders import Folder, aerial, images, known
from mistakes.stations.test_misread_stations import PHOTOS, PLACES, SPREAD, told
from support.long_cases import every

from orip.mistakes import explanation
from orip.structs import replace

COLUMNS, PIXEL = 4600, 0.05


def on_a_sensor(made: Folder, folder: Path, read: Callable[[str, float, float], tuple[float, float]]) -> Path:
    """Write a project whose photo points are pixels, as a function of photo, column and row has them."""
    measured = {
        photo: {name: read(photo, x / PIXEL + COLUMNS / 2, COLUMNS / 2 - y / PIXEL) for name, (x, y) in points.items()}
        for photo, points in made.measured.items()
    }
    replace(made, measured=measured).write(folder)
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    sensor = f"sensor = {{ columns = {COLUMNS}, rows = {COLUMNS}, width = 230.0, height = 230.0 }}"
    (folder / "orip.toml").write_text(text.replace("frame = [230.0, 230.0]", sensor), encoding="utf-8")
    return folder


def run(folder: Path) -> Said:
    return orip(folder, "run", "--no-report")


def warnings(said: Said) -> list[str]:
    """Return the complaints; that points have one ray is none, as they have at the edge of a block."""
    lines = (line for line in said.told.splitlines() if "are seen by one ray" not in line)
    return [line for line in lines if re.match("error: |warning: ", line)]


def status(said: Said) -> str:
    return next(line for line in said.told.splitlines() if line.startswith("status "))


@pytest.mark.parametrize("millimetres", ["A", "B"])
def test_a_scale_bar_in_millimetres_is_not_called_a_distance_that_is_off(tmp_path: Path, millimetres: str) -> None:
    made = aerial()
    folder = replace(made, control=["! none"]).write(tmp_path / "folder")
    lines = []
    for name, (start, end) in {"A": ("21", "53"), "B": ("23", "51")}.items():
        length = float(np.linalg.norm(made.points[start] - made.points[end]))
        factor = 1000.0 if name == millimetres else 1.0
        lines.append(f"{name} {start} {end} XYZ {factor * length:.4f} {factor * 0.01}\n")
    (folder / "T.LEN").write_text("".join(lines))
    toml = folder / "orip.toml"
    toml.write_text(f'{toml.read_text()}datum = "free"\n')
    said = run(folder)
    assert f"with the factor 0.001 for {millimetres}" in first_line([said]), said.told
    assert "distances are in another unit" in status(said)
    assert "check the unit, the calibrated length" not in said.told


@pytest.mark.parametrize(("off", "misread"), [(0.0, 0.0), (3.0, 0.0), (3.0, 0.5)])
def test_control_on_a_line_comes_first(tmp_path: Path, off: float, misread: float) -> None:
    made = aerial(relief=20.0)
    names = ["02", "32", "62", "82"]
    points = {**made.points, **{name: made.points[name] * [1.0, 1.0, 0.0] + [0.0, 0.0, 100.0] for name in names}}
    points["32"] = points["32"] + [0.0, 0.0, off]
    measured = images({f"P{n + 1}": (1000.0 + 900.0 * n, 2000.0, 1600.0, 0.3, 0.5, 1.0) for n in range(4)},
                      points, 150.0, 115.0, 0.004)  # fmt: skip
    measured["P2"]["42"] = (measured["P2"]["42"][0], measured["P2"]["42"][1] + misread)
    said = run(
        replace(made, points=points, measured=measured, control=known(points, 0.02, names)).write(tmp_path / "p")
    )
    if off:
        assert "control points 02, 32, 62 and 1 more lie nearly on a line" in status(said), said.told
        assert ("doubtful: " in status(said)) == bool(misread)
        assert not warnings(said)
    else:  # nothing at all determines the turn then
        assert "about the line of the control points" in said.told


def test_control_that_is_spread_is_not_called_a_line(tmp_path: Path) -> None:
    made = aerial()
    control = known(made.points, 0.02, ["00", "44", "84"])
    # a point of two rays that are nearly parallel lies far from all others
    far = {photo: dict(points) for photo, points in made.measured.items()}
    rays = {name: [photo for photo, points in far.items() if name in points] for name in made.points}
    name = next(name for name, photos in rays.items() if photos == ["P1", "P2"])
    (x, y), (other, _) = far["P1"][name], far["P2"][name]
    far["P2"][name] = (x - 0.06 * (x - other), y)
    for measured in (made.measured, far):
        said = run(replace(made, measured=measured, control=control).write(tmp_path / f"{measured is far}"))
        assert "hardly determined" not in said.told, said.told


@pytest.mark.parametrize("ending", every(2, ["STA", "ELE"]))
def test_a_position_with_a_slip_is_named_with_its_component_and_file(tmp_path: Path, ending: str) -> None:
    places = PLACES.copy()
    places[5, 1] -= 50.0
    said = told(tmp_path / "folder", ending, places)
    line = first_line([said])
    assert line.startswith("warning: exposure station P6: its position contradicts the block: it is off by Y"), (
        said.told
    )
    assert "is probably" in line
    assert f"correct it in the .{ending} file" in line
    assert len(warnings(said)) == 1


@pytest.mark.parametrize("ending", every(2, ["ELE", "STA"]))
def test_positions_off_alike_are_one_complaint(tmp_path: Path, ending: str) -> None:
    said = told(tmp_path / "folder", ending, PLACES + np.outer(np.arange(12) < 4, [0.0, 1.83, 0.0]))
    (line,) = warnings(said)
    assert "exposure stations P1, P2, P3 and P4: their positions contradict the block, and are all off by Y" in line
    assert f"correct them in the .{ending} file" in line


@pytest.mark.parametrize("ending", every(2, ["STA", "ELE"]))
def test_a_position_that_is_far_off_is_not_corrected_in_orip_toml(tmp_path: Path, ending: str) -> None:
    places = PLACES.copy()
    places[5] += [900.0, 400.0, 0.0]
    said = told(tmp_path / "folder", ending, places)
    assert "P6" in first_line([said]), said.told
    assert f"the .{ending} file" in first_line([said])
    assert "orip.toml" not in first_line([said])


def test_pixels_from_the_middle_are_one_warning(tmp_path: Path) -> None:
    middle = COLUMNS / 2
    said = run(on_a_sensor(aerial(), tmp_path / "folder", lambda _, c, r: (c - middle, r - middle)))
    (line,) = warnings(said)
    assert "pixels from the centre of the picture" in line


@pytest.mark.parametrize("ending", every(2, ["ELE", "STA"]))
def test_a_photo_that_was_turned_is_not_accused_of_its_position_as_well(tmp_path: Path, ending: str) -> None:
    made = aerial(photos=PHOTOS)
    spread = replace(made, control=known(made.points, 0.02, SPREAD))

    def read(photo: str, column: float, row: float) -> tuple[float, float]:
        return (row + 200.0, column) if photo == "P6" else (column, row)

    folder = on_a_sensor(spread, tmp_path / "folder", read)
    text = (folder / "orip.toml").read_text()
    (folder / "orip.toml").write_text(
        text.replace("rows = 4600", "rows = 4900").replace("height = 230.0", "height = 245.0")
    )
    lines = []
    for name, (x, y, z, *_) in PHOTOS.items():
        if ending == "STA":
            lines.append(f"{name} {x} {y} {z} 0.03 0.03 0.03")
        else:
            lines += [
                f"{name} PHOTO {kind} {value} 0.03" for kind, value in zip(("X0", "Y0", "Z0"), (x, y, z), strict=True)
            ]
    (folder / f"T.{ending}").write_text("".join(f"{line}\n" for line in lines))
    said = run(folder)
    assert "photo P6" in first_line([said]), said.told
    assert not [line for line in warnings(said)[1:] if "P6" in line.split(":")[1]], said.told
    # the camera takes up what is left of the photo
    assert "DY of camera" not in said.told, said.told


def test_a_shift_of_strips_needs_strips(tmp_path: Path) -> None:
    said = told(tmp_path / "folder", "STA", PLACES)
    toml = tmp_path / "folder" / "orip.toml"
    toml.write_text(f'{toml.read_text()}[[antenna]]\nname = "GNSS"\nshift = "strip"\n')
    said = run(tmp_path / "folder")
    assert 'antenna GNSS: shift = "strip" needs the strips of stations' in first_line([said])
    toml.write_text(toml.read_text().replace('shift = "strip"', 'shift = "session"'))
    assert not warnings(run(tmp_path / "folder"))


def test_a_strip_that_no_station_has_is_named(tmp_path: Path) -> None:
    told(tmp_path / "folder", "STA", PLACES)
    stations, toml = tmp_path / "folder" / "T.STA", tmp_path / "folder" / "orip.toml"
    stations.write_text("".join(f"{line} - - - - - - - S1\n" for line in stations.read_text().splitlines()))
    toml.write_text(f'{toml.read_text()}[[antenna]]\nname = "GNSS"\nshift = "strip"\nstrips = ["S3"]\n')
    assert "no station has strip S3, which strips names; those of the .STA file are: S1" in first_line(
        [run(toml.parent)]
    )


MADE_UP = '''
"""Photos that were taken on a Monday."""

from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Misfit
from orip.mistakes.mistake import Consequence, declare

MONDAY = declare("monday", "photos were taken on a Monday", Consequence(warnings=("unused-control",)))


def photos_of_mondays(misfit: Misfit) -> list[ProjectWarning]:
    return [ProjectWarning(MONDAY, "photo P1", "it is of a Monday; take it again")]
'''


def test_a_mistake_is_one_module_and_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = aerial().write(tmp_path / "folder")
    with (folder / "T.PNT").open("a") as control:
        control.write("UNSEEN 1000 2000 100 0.02 0.02 0.02\n")
    before = orip(folder, "run", "--no-report").told
    assert "is not measured in any photo" in before

    (tmp_path / "mistaken_mondays.py").write_text(MADE_UP, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    find = import_module("mistaken_mondays").photos_of_mondays
    monkeypatch.setattr(explanation, "SIGNS_IN_RESULT", (*explanation.SIGNS_IN_RESULT, find))
    said = orip(folder, "solve").told

    assert "warning: photo P1: it is of a Monday; take it again" in said
    (status,) = (line for line in said.splitlines() if line.startswith("status"))
    assert "doubtful" in status
    assert "photos were taken on a Monday" in status
    assert "is not measured in any photo" not in said
