"""Mistakes of more kinds in simulated blocks of other geometry than those on which they were found: what is said first.

What is said first names the cause, says what to write, and is the only complaint.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from mistakes import advice, camera_advice
from mistakes.advice import is_well, said_first
from mistakes.edits import in_logs, in_toml, sample
from mistakes.stations.said import assert_documented, complaints
from pyproj import Transformer
from support.long_cases import every, in_turn, with_long

Making = Callable[[advice.Project], None]


def changed(rows: str, change: Callable[[np.ndarray], np.ndarray]) -> Making:
    def make(project: advice.Project) -> None:
        of = getattr(project, rows)
        for name, xyz in of.items():
            of[name] = change(xyz)

    return make


def converted(target: str) -> Callable[[np.ndarray], np.ndarray]:
    to_target = Transformer.from_crs("EPSG:25832", target, always_xy=True)
    return lambda xyz: np.array([*to_target.transform(xyz[0], xyz[1]), xyz[2]])


def turned(degrees: float) -> Callable[[np.ndarray], np.ndarray]:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return lambda xyz: np.array([cosine * xyz[0] - sine * xyz[1], sine * xyz[0] + cosine * xyz[1], xyz[2]])


def raised(by: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda xyz: xyz + np.array([0.0, 0.0, by])


def scattered(size: float) -> Making:
    def make(project: advice.Project) -> None:
        random = np.random.default_rng(4)
        for name, xyz in project.positions.items():
            project.positions[name] = xyz + random.normal(scale=size, size=3)

    return make


def of_another_base(project: advice.Project) -> None:
    for name in list(project.positions)[5:]:
        project.positions[name] = project.positions[name] + np.array([1.9, -1.2, 0.8])


def heights_of_two(project: advice.Project) -> None:
    for name in ("14", "70"):
        project.control[name] = raised(38.4)(project.control[name])


def heights_of_some(project: advice.Project) -> None:
    for name in ("10", "44", "70"):
        project.control[name] = raised(1.7)(project.control[name])


def a_bent_strip(project: advice.Project) -> None:
    for name in ("P5", "P6", "P7", "P8"):
        project.positions[name] = project.positions[name] + np.array([0.0, 0.8, -0.3])
    project.position_errors = {name: np.full(3, 0.12) for name in project.positions}


SAID: dict[str, tuple[Making, tuple[str, ...]]] = {
    "control in centimetres": (changed("control", lambda xyz: 100.0 * xyz), ("multiplied by 0.01", "centimetres")),
    "positions in millimetres": (changed("positions", lambda xyz: 1000.0 * xyz), ("multiplied by 1000", "millimetres")),
    "control in Gauss-Krüger": (
        changed("control", converted("EPSG:31467")), ("Gauss-Krüger coordinates of zone 3", "UTM", "convert")),
    "positions in Gauss-Krüger": (
        changed("positions", converted("EPSG:31467")), ("Gauss-Krüger coordinates of zone 3", "UTM", "convert")),
    "control of the next zone": (
        changed("control", converted("EPSG:25833")), ("UTM coordinates of the eastern of two zones", "convert")),
    "positions of the zone before": (
        changed("positions", converted("EPSG:25831")), ("UTM coordinates of the eastern of two zones", "convert")),
    "positions of a turned system": (changed("positions", turned(4.4)), ("turned by 4.4 degrees", "convert")),
    "positions of other photos": (scattered(600.0), ("those of other photos", "match")),
    "positions without a fix": (scattered(1.6), ("scatter by", "RTK", "write errors of about")),
    "another base station": (of_another_base, ("from P6 to P12", "base station", "correct them")),
    "another pole": (heights_of_some, ("control points 10, 44 and 70", "1.7", "pole", "correct Z of these")),
    "a strip in which no position loses its weight": (
        a_bent_strip, ("exposure stations P5, P6, P7 and P8", "off by Y", "errors negative")),
    "heights of two points": (heights_of_two, ("control points 14 and 70", "38.4", "system")),
}  # fmt: skip
"""What is made, and words of what is said first."""

LONG = (
    "control in Gauss-Krüger", "positions of the zone before", "positions of other photos", "positions without a fix",
    "two exchanged in a photo", "a sign of the record",
)  # fmt: skip
"""What takes longest, as all else is tried before; each has a sibling."""

ROWS = {
    "positions in Gauss-Krüger": "Positions in another zone or system than the control",
    "positions in millimetres": "Positions in another unit than the control",
    "positions without a fix": "Positions without a fix",
    "two exchanged in a photo": "Two fiducial marks exchanged",
    "one misread": "A fiducial mark misread",
}
"""Rows of the documentation."""


def check_what_is_said(folder: Path, name: str, words: tuple[str, ...]) -> str:
    said = orip(folder, "run", "--no-report")
    first = said_first(said)
    assert [word for word in words if word not in first] == [], first
    assert complaints(said) == 1
    if name in ROWS and ".ELE" not in first:
        assert_documented(ROWS[name], first)
    return first


@pytest.mark.parametrize(("name", "ending"), in_turn(SAID, ["STA", "ELE"], LONG))
def test_what_is_said_first_names_the_cause(tmp_path: Path, name: str, ending: str) -> None:
    make, words = SAID[name]
    project = advice.sound(ending, 5)
    make(project)
    check_what_is_said(project.write(tmp_path / "block"), name, words)


def test_errors_as_advised_make_positions_without_a_fix_fit(tmp_path: Path) -> None:
    project = advice.sound("STA", 5)
    make, words = SAID["positions without a fix"]
    make(project)
    first = check_what_is_said(project.write(tmp_path / "before"), "positions without a fix", words)
    errors = re.search(r"errors of about ([\d.]+) m", first)
    assert errors is not None, first
    project.position_errors = {name: np.full(3, float(errors[1])) for name in project.positions}
    assert is_well(orip(project.write(tmp_path / "after"), "run", "--no-report"))


# ------------------------------------------------------------------------------------------------ blocks with a sensor


@pytest.mark.parametrize("ending", every(2, ["STA", ""]))
def test_control_measured_in_pictures_of_a_quarter_is_named(tmp_path: Path, ending: str) -> None:
    project = camera_advice.sound(ending)
    for points in project.measured.values():
        points.update({name: (0.25 * x, 0.25 * y) for name, (x, y) in points.items() if name.startswith("K")})
    first = said_first(orip(project.write(tmp_path / "block"), "run", "--no-report"))
    assert "multiplied by 4" in first, first
    assert "lower resolution" in first


FREE = {"unknown": ["C", "DX", "DY", "A3"]}


@pytest.mark.parametrize(("by", "camera"), every(2, [(2.0, FREE), (-4.2, {})]), ids=["free", "held"])
def test_a_pole_between_control_and_stations_is_named_and_no_lever_arm(
    tmp_path: Path, by: float, camera: dict[str, object]
) -> None:
    project = camera_advice.sound("STA")
    project.camera.update(camera)
    project.control = {name: raised(by)(xyz) for name, xyz in project.control.items()}
    first = said_first(orip(project.write(tmp_path / "block"), "run", "--no-report"))
    found = re.search(rf"about ([\d.]+) m too {'high' if by > 0.0 else 'low'}", first)
    assert found is not None, first
    assert float(found[1]) == pytest.approx(abs(by), abs=0.3)
    assert "pole" in first


def test_a_lever_arm_is_no_pole(tmp_path: Path) -> None:
    project = camera_advice.sound("STA")
    project.camera.update(FREE)
    project.positions = {name: raised(0.4)(xyz) for name, xyz in project.positions.items()}
    assert "pole" not in orip(project.write(tmp_path / "block"), "run", "--no-report").told


@pytest.mark.parametrize("photo", every(2, ["DJI_0008", "DJI_0016"]))
def test_a_picture_turned_by_180_degrees_is_named_where_the_camera_is_free(tmp_path: Path, photo: str) -> None:
    project = camera_advice.sound("STA")
    project.camera.update(FREE, principal_point=[0.0, 0.0])
    columns, rows = camera_advice.COLUMNS, camera_advice.ROWS
    project.measured[photo] = {name: (columns - x, rows - y) for name, (x, y) in project.measured[photo].items()}
    first = said_first(orip(project.write(tmp_path / "block"), "run", "--no-report"))
    assert f"photo {photo}: it fits when its picture is turned by 180°" in first, first


def test_a_held_c_that_is_one_percent_off_is_named_and_not_the_control(tmp_path: Path) -> None:
    project = camera_advice.sound("STA")
    project.camera["c"] = 8.888
    first = said_first(orip(project.write(tmp_path / "block"), "run", "--no-report"))
    assert "C of camera FC" in first or "camera FC: C = 8.888 mm does not fit" in first, first


# --------------------------------------------------------------------------------------------------------------- marks


def renamed(names: dict[str, str], photo: str | None) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        in_logs(
            folder,
            lambda header, words: (
                [names.get(words[0], words[0]), *words[1:]]
                if header[0] == "PHOTO" and photo in (None, header[1])
                else words
            ),
        )

    return make


def misread(mark: str, photo: str, by: float) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        in_logs(
            folder,
            lambda header, words: (
                [words[0], f"{float(words[1]) + by:.3f}", *words[2:]]
                if header[:2] == ["PHOTO", photo] and words[0] == mark
                else words
            ),
        )

    return make


MARKS: dict[str, tuple[Callable[[Path], None], tuple[str, ...]]] = {
    "two exchanged in a photo": (
        renamed({"5": "8", "8": "5"}, "204"), ("photo 204: the fiducial marks do not", "if 5 and 8 were exchanged")),
    "two exchanged in all photos": (
        renamed({"3": "4", "4": "3"}, None), ("if 3 and 4 were exchanged", "[[camera]] of orip.toml")),
    "one misread": (misread("7", "202", 0.3), ("photo 202: fiducial mark 7 does not fit: it is off by x +0", "again")),
    "a digit of the record": (
        lambda folder: in_toml(folder, ("x = -18.049", "x = -18.409")),
        ("fiducial mark 4 does not fit", "x = -18.409 is probably -18.049")),
    "a sign of the record": (
        lambda folder: in_toml(folder, ("y = 12.034", "y = -12.034")),
        ("fiducial mark 3 does not fit", "y = -12.034 is probably 12.034: its sign is wrong")),
}  # fmt: skip


@pytest.mark.parametrize("name", with_long(LONG, MARKS))
def test_a_wrong_mark_is_the_only_thing_that_is_said(tmp_path: Path, name: str) -> None:
    make, words = MARKS[name]
    folder = sample("small_frame_block", tmp_path / "cliff")
    make(folder)
    check_what_is_said(folder, name, words)


# --------------------------------------------------------------------------------------------------------------- texts


def test_distances_of_a_project_that_was_renamed_are_named(tmp_path: Path) -> None:
    folder = sample("small_frame_block", tmp_path / "cliff")
    (folder / "CLIFF.LEN").rename(folder / "ROCK.LEN")
    first = said_first(orip(folder, "run", "--no-report"))
    assert "ROCK.LEN: this file is not read" in first, first
    assert "rename it to CLIFF.LEN" in first


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ("GCP_{}", "the names differ by 'GCP_' at the beginning alone"),
        ("{}_N", "no name of the control file is one of the measurements"),
    ],
)
def test_control_of_other_names_is_said_with_the_names_that_are_measured(tmp_path: Path, form: str, words: str) -> None:
    project = advice.sound("STA", 5)
    for rows in ("control", "control_errors"):
        setattr(project, rows, {form.format(name): xyz for name, xyz in getattr(project, rows).items()})
    first = said_first(orip(project.write(tmp_path / "block"), "run", "--no-report"))
    assert words in first, first


def test_points_of_figures_that_are_not_measured_are_one_line(tmp_path: Path) -> None:
    folder = sample("small_frame_block", tmp_path / "cliff")
    lines = [f"WALL{figure} PLANE Q{figure}{point} 0.01" for figure in range(3) for point in range(4)]
    (folder / "CLIFF.CON").write_text("\n".join(lines) + "\n")
    said = orip(folder, "run", "--no-report").told
    assert len(re.findall("^warning: .*Q00", said, re.MULTILINE)) == 1
    assert "WALL2 is left out" not in said
