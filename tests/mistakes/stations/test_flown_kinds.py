"""Mistakes of the newest kinds, on other geometry than where they were found: what is said first, as documented."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from mistakes import camera_advice
from mistakes.advice import said_first
from mistakes.edits import in_toml, sample
from mistakes.stations.said import assert_documented, complaints
from msgspec import Struct
from support.long_cases import every
from workflow.small_projects import replace_in

Making = Callable[[camera_advice.Project], None]


class Kind(Struct, frozen=True):
    """A row of the document; words that the first sentence has, and how the mistake is made in a folder."""

    title: str
    words: tuple[str, ...]
    make: Callable[[Path, str], Path]
    endings: tuple[str, ...] = ("STA", "ELE")


def flown(make: Making, **camera: object) -> Callable[[Path, str], Path]:
    """Return how a mistake is made in a flight of a drone."""

    def write(folder: Path, ending: str) -> Path:
        project = camera_advice.sound(ending)
        project.camera.update(camera)
        make(project)
        return project.write(folder)

    return write


def on_film(make: Callable[[Path], None]) -> Callable[[Path, str], Path]:
    def write(folder: Path, _: str) -> Path:
        cliff = sample("small_frame_block", folder)
        make(cliff)
        return cliff

    return write


def control_of_half_the_resolution(project: camera_advice.Project) -> None:
    for points in project.measured.values():
        points.update({name: (0.5 * x, 0.5 * y) for name, (x, y) in points.items() if name.startswith("K")})


def pole(project: camera_advice.Project) -> None:
    project.control = {name: xyz + np.array([0.0, 0.0, 2.0]) for name, xyz in project.control.items()}


def of_another_base(project: camera_advice.Project) -> None:
    for name in list(project.positions)[12:]:
        project.positions[name] = project.positions[name] + np.array([1.7, -2.1, 0.9])


def ahead(project: camera_advice.Project) -> None:
    """All antennas are 1.6 m ahead of the cameras: strips fly to the right and back."""
    for number, name in enumerate(project.positions):
        by = 1.6 if number // camera_advice.PHOTOS % 2 == 0 else -1.6
        project.positions[name] = project.positions[name] + np.array([by, 0.0, 0.0])


def certain_positions(project: camera_advice.Project) -> None:
    project.position_error = 0.0003


def certain_control(project: camera_advice.Project) -> None:
    project.control_error = 0.0001


def zoomed(project: camera_advice.Project) -> None:
    middle = np.array([camera_advice.COLUMNS, camera_advice.ROWS]) / 2.0
    own = project.measured["DJI_0010"]
    project.measured["DJI_0010"] = {name: tuple(middle + 1.12 * (np.array(xy) - middle)) for name, xy in own.items()}


def only_compared(project: camera_advice.Project) -> None:
    project.control_error = -0.02


def exchanged_templates(folder: Path) -> None:
    for log in folder.glob("*.MEA"):
        text = re.sub(r"(?m)^TEMPLATE (LEFT|RIGHT)", lambda of: f"TEMPLATE {'LR'[of[1] == 'LEFT']}", log.read_text())
        log.write_text(text.replace("TEMPLATE L ", "TEMPLATE LEFT ").replace("TEMPLATE R ", "TEMPLATE RIGHT "))


def mirrored_marks(folder: Path) -> None:
    for x, y in ((-18.052, -12.031), (18.047, -12.026), (18.055, 12.034), (-18.049, 12.028), (0.012, -12.029),
                 (18.051, 0.021), (-0.034, 12.031), (-18.050, -0.015)):  # fmt: skip
        in_toml(folder, (f"x = {x:.3f}, y = {y:.3f}", f"x = {x:.3f}, y = {-y:.3f}"))


KINDS = {
    "resolution": Kind(
        "Control measured in pictures of half the resolution",
        ("multiplied by 2", "lower resolution"), flown(control_of_half_the_resolution), ("STA", "")),
    "pole": Kind(
        "Height of the pole not taken off the control", ("m too high", "pole"), flown(pole), ("STA",)),
    "base": Kind(
        "Half of a flight from another base station",
        ("from DJI_0013 to DJI_0024", "base station"), flown(of_another_base)),
    "ahead": Kind(
        "Positions of another moment than the exposures", ("m ahead of their photos along the flight",), flown(ahead)),
    "certain positions": Kind(
        "Errors of positions that no GNSS has", ("smaller than those of any GNSS", "0.03"), flown(certain_positions)),
    "certain control": Kind(
        "Errors of control that no survey has", ("smaller than those of any survey",), flown(certain_control)),
    "compared": Kind(
        "All control points are check points",
        ("all 9 points of the .PNT file have negative errors",), flown(only_compared), ("",)),
    "zoom": Kind(
        "A photo of another zoom", ("photo DJI_0010", "another zoom"), flown(zoomed)),
    "templates": Kind(
        "Tick marks measured under the name of the other template",
        ("templates LEFT and RIGHT", "exchange the names"), on_film(exchanged_templates), ("",)),
    "signs": Kind(
        "Fiducial marks with the wrong sign of y",
        ("a mirror image", "wrong sign of x or of y"), on_film(mirrored_marks), ("",)),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "ending"),
    [case for name, kind in KINDS.items() for case in every(2, [(name, ending) for ending in kind.endings])],
)
def test_the_first_sentence_names_the_cause(tmp_path: Path, name: str, ending: str) -> None:
    kind = KINDS[name]
    said = orip(kind.make(tmp_path / "block", ending), "run", "--no-report")
    first = said_first(said)
    assert [word for word in kind.words if word not in first] == [], first
    if ending == kind.endings[0]:
        assert_documented(kind.title, first)


@pytest.mark.long
def test_templates_are_told_from_points_beside_the_film_where_no_stage_is_given(tmp_path: Path) -> None:
    folder = sample("small_frame_block", tmp_path / "cliff")
    exchanged_templates(folder)
    for log in folder.glob("*.MEA"):
        log.write_text(re.sub(r"(?m)^(TEMPLATE \w+ A) \w+", r"\1", log.read_text()))
    replace_in(folder / "orip.toml", 'stage = "UPPER"\n', "")
    replace_in(folder / "orip.toml", 'stage = "LOWER"\n', "")
    first = said_first(orip(folder, "run", "--no-report"))
    assert "lie outside their fiducial marks" in first, first
    assert "templates LEFT and RIGHT" in first


@pytest.mark.parametrize("ending", ["STA", "ELE"])
def test_errors_of_a_good_survey_are_none_too_small(tmp_path: Path, ending: str) -> None:
    project = camera_advice.sound(ending)
    assert complaints(orip(project.write(tmp_path / "block"), "run", "--no-report")) == 0


def test_errors_of_angles_in_radians_are_told_from_wrong_angles(tmp_path: Path) -> None:
    folder = camera_advice.sound("STA with angles").write(tmp_path / "block")
    replace_in(folder / "T.STA", " 0.05 0.05 0.1", " 0.00087 0.00087 0.00175")
    first = said_first(orip(folder, "run", "--no-report"))
    assert "seem to be in radians" in first, first
    assert "multiply them by 57.2958" in first


def test_angles_of_a_gimbal_are_named(tmp_path: Path) -> None:
    project = camera_advice.sound("STA with angles")
    # looking down a gimbal has pitch -90, and its heading runs clockwise from north
    for name, (omega, phi, kappa) in project.angles.items():
        project.angles[name] = np.array([phi, omega - 90.0, -kappa % 360.0])
    first = said_first(orip(project.write(tmp_path / "block"), "run", "--no-report"))
    assert "of a gimbal" in first, first
    assert "add 90 to the pitch, and write 'ANGLES ROLL PITCH HEADING'" in first
