"""Where `orip solve` starts: photos that cannot be oriented are left out, and given values that lead astray replaced.

The project is that of two strips of three photos; single photos and flat ground are made here.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from msgspec import Struct
from scipy.spatial.transform import Rotation
from support.strips_project import StripsProject, strips_project

NOISE_MM = 0.002
ELEMENTS = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
FAR_BELOW_SD = 0.02
"""Of a standard deviation: iterations end when corrections are a ten-thousandth of it."""


def with_two_points_in(project: StripsProject, photo: str, neighbour: str) -> list[str]:
    """Leave two points of a photo, which cannot be oriented then; return them."""
    two = [name for name in project.common(photo, neighbour) if not name.startswith("C")][:2]
    project.images[photo] = {point: project.images[photo][point] for point in two}
    return two


def warnings_of(err: str) -> list[str]:
    """Return the warnings, without that of the drive table."""
    warnings = [line.removeprefix("warning: ") for line in err.splitlines() if line.startswith("warning: ")]
    return [text for text in warnings if "camera CAM: has no frame" not in text]


def elements(document: dict, photo: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the adjusted elements of a photo and their standard deviations."""
    found = document["photos"][photo]
    return np.array([found[kind]["value"] for kind in ELEMENTS]), np.array([found[kind]["sd"] for kind in ELEMENTS])


# photos that cannot be oriented


def test_a_photo_that_cannot_be_oriented_is_left_out_with_its_own_points_and_the_rest_is_adjusted(
    tmp_path: Path,
) -> None:
    project = strips_project(NOISE_MM)
    with_two_points_in(project, "P6", "P5")
    project.images["P6"]["alone"] = (1.0, 2.0)
    said = orip(project.write(tmp_path / "six"), "run", "--json", "--no-report")
    assert said.code == 0
    warnings = warnings_of(said.err)
    assert warnings[0].startswith("photo P6")
    left_out = r"photo P6 is left out.*shares 2 points with its neighbours, 5 are needed"
    assert any(re.match(left_out, warning) for warning in warnings)
    assert "alone" not in said.document["points"]
    assert "alone" not in said.err
    del project.images["P6"], project.models["2-2"]
    without = orip(project.write(tmp_path / "five"), "run", "--json", "--no-report").document
    assert set(said.document["photos"]) == {f"P{number}" for number in range(1, 6)}
    # what is left is the block without the photo
    assert said.document["sigma0"] == pytest.approx(without["sigma0"], rel=1e-6)
    for name in ("P1", "P5"):
        (found, sd), (expected, _) = elements(said.document, name), elements(without, name)
        assert np.abs((found - expected) / sd).max() < FAR_BELOW_SD


def test_all_photos_wanted_ends_with_exit_code_4_where_one_is_left_out(tmp_path: Path) -> None:
    project = strips_project(NOISE_MM)
    folder = project.write(tmp_path / "strips")
    assert orip(folder, "run", "--all", "--no-report").code == orip(folder, "solve", "--all", "--no-report").code == 0
    with_two_points_in(project, "P6", "P5")
    project.write(folder)
    for command in ("run", "solve"):
        said = orip(folder, command, "--all", "--no-report")
        assert said.code == 4
        assert "photo P6 is left out" in said.err


def test_a_photo_left_out_by_its_given_orientation_is_not(tmp_path: Path) -> None:
    # the chain cannot orient it, but the user has
    project = strips_project(NOISE_MM)
    with_two_points_in(project, "P6", "P5")
    values = dict(zip(ELEMENTS, project.true_orientations["P6"], strict=True))
    project.orientations["P6"] = "\n".join(f"{kind} = {value!r}" for kind, value in values.items())
    said = orip(project.write(tmp_path / "strips"), "run", "--json", "--no-report")
    assert "P6" in set(said.document["photos"])
    assert "left out" not in said.err


def test_photos_that_cannot_be_oriented_are_named_before_anything_else_is_found(tmp_path: Path) -> None:
    project = strips_project(NOISE_MM)
    project.control, project.settings, project.models = {}, 'datum = "free"', {}
    with_two_points_in(project, "P6", "P5")
    folder = project.write(tmp_path / "strips")
    orip(folder, "init")
    orip(folder, "measure")
    said = orip(folder, "prelim")
    assert said.code == 4
    error = said.err[said.err.index("error: ") :]
    assert error.startswith("error: 1 of 6 photos could not be oriented: photo P6 shares 2 points")
    assert "origin and axes of the block are those of photo P1" in error


# given values that lead astray


@pytest.fixture(scope="module")
def from_nothing(tmp_path_factory: pytest.TempPathFactory) -> dict:
    folder = strips_project(NOISE_MM).write(tmp_path_factory.mktemp("from nothing") / "strips")
    return orip(folder, "run", "--json", "--no-report").document


def given(project: StripsProject, turned: dict[str, tuple[float, float, float]]) -> None:
    for name, values in project.true_orientations.items():
        changed = [*values[:3], *np.add(values[3:], turned.get(name, (0.0, 0.0, 0.0))).tolist()]
        lines = [f"{kind} = {value!r}" for kind, value in zip(ELEMENTS, changed, strict=True)]
        project.orientations[name] = "\n".join(lines)


@pytest.mark.parametrize(
    ("turned", "told"),
    [
        ({"P2": (0.0, 0.0, 180.0)}, r"photo P2: its given orientation is wrong: KAPPA is off by 180°"),
        (
            {f"P{number}": (180.0, 0.0, 0.0) for number in range(1, 7)},
            r"the adjustment from the given values .* computed from preliminary values found by orip",
        ),
    ],
    ids=["one kappa", "all upside down"],
)
def test_wrong_given_orientations_are_told_and_do_not_change_the_result(
    tmp_path: Path, from_nothing: dict, turned: dict[str, tuple[float, float, float]], told: str
) -> None:
    project = strips_project(NOISE_MM)
    given(project, turned)
    said = orip(project.write(tmp_path / "given"), "run", "--json", "--no-report")
    assert said.code == 0
    assert any(re.match(told, warning) for warning in warnings_of(said.err))
    assert said.document["sigma0"] == pytest.approx(from_nothing["sigma0"], rel=1e-6)
    found, sd = elements(said.document, "P2")
    assert np.abs((found - elements(from_nothing, "P2")[0]) / sd).max() < FAR_BELOW_SD


@pytest.mark.long
def test_a_solution_that_was_wrong_is_no_better_start_than_own_values_once_its_blunders_are_corrected(
    tmp_path: Path, from_nothing: dict
) -> None:
    wrong, random = strips_project(NOISE_MM), np.random.default_rng(1)
    for photo in ("P2", "P5", "P3"):
        for point, xy in list(wrong.images[photo].items())[::2]:
            wrong.images[photo][point] = tuple((xy + 3.0 * random.normal(size=2)).tolist())
    folder = wrong.write(tmp_path / "corrected")
    orip(folder, "run", "--no-report")
    assert [orip(folder, "update", what).code for what in ("photos", "points")] == [0, 0]
    strips_project(NOISE_MM).write(folder)
    said = orip(folder, "run", "--json", "--no-report")
    assert said.document["sigma0"] == pytest.approx(from_nothing["sigma0"], rel=1e-6)
    for photo in from_nothing["photos"]:
        (found, sd), (right, _) = elements(said.document, photo), elements(from_nothing, photo)
        assert np.abs((found - right) / sd).max() < FAR_BELOW_SD, photo


def test_given_orientations_that_lead_to_the_minimum_are_not_doubted(tmp_path: Path) -> None:
    project = strips_project(NOISE_MM)
    given(project, {"P2": (2.0, -2.0, 5.0)})
    said = orip(project.write(tmp_path / "strips"), "run", "--no-report")
    assert said.code == 0
    assert "prelim" not in said.err


def test_constant_elements_stay_where_given_values_are_replaced(tmp_path: Path) -> None:
    project = strips_project(NOISE_MM)
    given(project, {"P2": (0.0, 0.0, 180.0)})
    project.orientations["P1"] += '\nconstant = ["Z0"]'
    said = orip(project.write(tmp_path / "strips"), "run", "--json", "--no-report")
    assert "from orip's own preliminary values" in said.err
    assert said.document["photos"]["P1"]["Z0"]["value"] == pytest.approx(project.true_orientations["P1"][2], abs=1e-9)


# the datum of a free network, and lines typed in a .PRE file


def test_a_free_network_has_the_datum_of_the_coordinates_in_its_pre_file(tmp_path: Path) -> None:
    project = strips_project(NOISE_MM)
    project.control, project.settings = {}, 'datum = "free"'
    folder = project.write(tmp_path / "strips")
    random = np.random.default_rng(3)
    some = {name: np.round(np.add(xyz, 0.05 * random.normal(size=3)), 3) for name, xyz in project.points.items()}
    lines = [" ".join([name, *map(str, xyz.tolist())]) for name, xyz in some.items()]
    (folder / "MAIN.PRE").write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    said = orip(folder, "run", "--json", "--no-report")
    assert (said.code, warnings_of(said.err)) == (0, [])
    assert said.document["sigma0"] == pytest.approx(NOISE_MM / 0.003, rel=0.2)
    found = {name: [point[axis]["value"] for axis in "XYZ"] for name, point in said.document["points"].items()}
    corrections = np.array([np.subtract(found[name], xyz) for name, xyz in some.items()])
    # inner constraints: the centroid of all points stays; corrections of the last iteration alone are neglected
    assert corrections.mean(axis=0) == pytest.approx([0.0] * 3, abs=1e-4)
    assert np.abs(corrections).max() < 5 * 0.05


def test_prelim_keeps_the_points_that_were_typed(tmp_path: Path) -> None:
    project = strips_project(NOISE_MM)
    folder = project.write(tmp_path / "strips")
    orip(folder, "init")
    orip(folder, "measure")
    typed = "105 20.3 -27.3 6.7"
    (folder / "MAIN.PRE").write_text(f"{typed}\n", encoding="utf-8")
    said = orip(folder, "prelim")
    assert said.code == 0
    assert "kept     1 point of MAIN.PRE typed by hand (no sX sY sZ)" in said.err
    lines = [line.split() for line in (folder / "MAIN.PRE").read_text(encoding="utf-8").splitlines()]
    assert typed.split() in lines
    assert len(lines) == 1 + len(project.points)


# resection, and control that is a mirror image


class _Camera(Struct, frozen=True):
    centre: tuple[float, float, float]
    angles: tuple[float, float, float]

    def sees(self, xyz: np.ndarray) -> np.ndarray:
        u = (xyz - self.centre) @ Rotation.from_euler("XYZ", self.angles, degrees=True).as_matrix()
        return -150.0 * u[:, :2] / u[:, 2:]


def film_project(folder: Path, cameras: dict[str, _Camera], points: dict[str, np.ndarray], control: list[str]) -> Path:
    """Write a project of film photos of 230 mm with C 150 mm, without noise; some of the points are control."""
    folder.mkdir()
    toml = ['project = { name = "T" }', '[[camera]]\nname = "C"\nc = 150.0\nframe = [230.0, 230.0]']
    toml += [f'[[photo]]\nname = "{name}"\ncamera = "C"' for name in cameras]
    toml.append('[[bundle]]\nname = "MAIN"\nmeasurement_precision = 0.005')
    (folder / "orip.toml").write_text("\n".join(toml) + "\n", encoding="utf-8")
    log = []
    for name, camera in cameras.items():
        log.append(f"POINTS MAIN {name}")
        for point, (x, y) in zip(points, camera.sees(np.array(list(points.values()))).tolist(), strict=True):
            if max(abs(x), abs(y)) < 115.0:
                log.append(f"{point} {x:.5f} {y:.5f}")
    (folder / "T.MEA").write_text("\n".join(log) + "\n", encoding="utf-8")
    lines = [" ".join([name, *(f"{value:.4f}" for value in points[name]), "0.02 0.02 0.02"]) for name in control]
    (folder / "T.PNT").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def test_one_photo_with_four_control_points_is_resected(tmp_path: Path) -> None:
    camera = _Camera((1000.0, 2000.0, 1600.0), (0.3, -0.4, 5.0))
    points = {"a": (100, 1100, 90), "b": (1800, 1200, 140), "c": (300, 2900, 60), "d": (1700, 2800, 110)}
    folder = film_project(
        tmp_path / "one", {"P1": camera}, {k: np.array(v, float) for k, v in points.items()}, [*points]
    )
    said = orip(folder, "run", "--json", "--no-report")
    assert said.code == 0
    found, sd = elements(said.document, "P1")
    # photo coordinates are rounded to a two-hundredth of their a-priori error
    assert np.abs(found - [*camera.centre, *camera.angles]).max() < 0.1 * sd.max()
    assert "without a check" not in said.err


def flat_block() -> tuple[dict[str, _Camera], dict[str, np.ndarray]]:
    """Return four photos of nearly flat ground, all of which see more than six of its points."""
    random = np.random.default_rng(1)
    cameras = {
        f"P{i + 1}": _Camera((1000.0 + 900.0 * i, 2000.0, 1600.0), (0.3 * i - 0.4, 0.5 - 0.2 * i, 1.0))
        for i in range(4)
    }
    points = {
        f"{i}{j}": np.array([400.0 + 500.0 * i, 1000.0 + 500.0 * j, 100.0 + random.uniform(-1.0, 1.0)])
        for i in range(9)
        for j in range(5)
    }
    return cameras, points


def test_control_as_north_east_does_not_put_the_block_below_the_ground(tmp_path: Path) -> None:
    cameras, points = flat_block()
    folder = film_project(tmp_path / "flat", cameras, points, [*points])
    assert orip(folder, "run", "--no-report").code == 0
    exchanged = film_project(tmp_path / "exchanged", cameras, points, [*points])
    lines = [line.split() for line in (folder / "T.PNT").read_text(encoding="utf-8").splitlines()]
    text = "\n".join(" ".join([name, y, x, *rest]) for name, x, y, *rest in lines)
    (exchanged / "T.PNT").write_text(text + "\n", encoding="utf-8")
    said = orip(exchanged, "run", "--no-report")
    assert said.code == 4
    assert "as a mirror image: X and Y of the control are exchanged (north, east in place of X = east" in said.err


def test_rows_counted_downwards_do_not_put_the_block_below_the_ground(tmp_path: Path) -> None:
    cameras, points = flat_block()
    folder = film_project(tmp_path / "flat", cameras, points, [*points])
    lines = [line.split() for line in (folder / "T.MEA").read_text(encoding="utf-8").splitlines()]
    flipped = [line if line[0] == "POINTS" else [line[0], line[1], str(-float(line[2]))] for line in lines]
    (folder / "T.MEA").write_text("\n".join(map(" ".join, flipped)) + "\n", encoding="utf-8")
    said = orip(folder, "run", "--no-report")
    assert said.code == 4
    assert "the photos are mirrored" in said.err


def test_two_photos_whose_given_orientations_are_exchanged_are_told(tmp_path: Path) -> None:
    project = strips_project(NOISE_MM)
    given(project, {})
    exchanged = project.orientations["P3"], project.orientations["P2"]
    project.orientations["P2"], project.orientations["P3"] = exchanged
    said = orip(project.write(tmp_path / "strips"), "run", "--json", "--no-report")
    assert said.code == 0
    assert warnings_of(said.err)[0].startswith("photos P2 and P3 are exchanged")
    (found, sd), expected = elements(said.document, "P2"), project.true_orientations["P2"]
    # errors of measurement: five standard deviations of six elements
    assert np.abs((found - expected) / sd).max() < 5.0
