"""Exposure stations in a project: in the adjustment, in the status, and what is said of their photos."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from workflow.commands import project_status
from workflow.quiet import run_quietly
from workflow.small_projects import first_project, replace_in

from orip.errors import InputError

STATIONS = (
    "left 1068.79 2074.17 332.52 0.02 0.02 0.03\n"
    "RIGHT 1132 2077.31 329.77 0.02 0.02 0.03 -0.5 0.92 -0.39 0.05 0.05 0.05 8 S1\n"
)
ELEMENTS = """left PHOTO X0 1068.79 0.02
left PHOTO Y0 2074.17 0.02
left PHOTO Z0 332.52 0.03
right PHOTO X0 1132 0.02
right PHOTO Y0 2077.31 0.02
right PHOTO Z0 329.77 0.03
right PHOTO OMEGA -0.5 0.05
right PHOTO PHI 0.92 0.05
right PHOTO KAPPA -0.39 0.05
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return first_project(tmp_path / "first")


def orientations(project: Path) -> dict[str, dict[str, dict[str, float]]]:
    run_quietly(project)
    return dict(json.loads((project / "result.json").read_text())["photos"])


def test_stations_are_observed(project: Path, tmp_path: Path) -> None:
    (project / "FIRST.STA").write_text(STATIONS)
    by_elements = first_project(tmp_path / "second")
    (by_elements / "FIRST.ELE").write_text(ELEMENTS)
    for folder in (project, by_elements):
        # a station loses its weight as a whole, elements one by one: without that both are the same observations
        replace_in(folder / "orip.toml", 'name = "MAIN"', 'name = "MAIN"\nmax_iterations = 20\nstart_down_weight = 20')
    found, expected = orientations(project), orientations(by_elements)
    for name, photo in expected.items():
        for key in ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA"):
            # iterations end at the same place, to far below the standard deviations of 0.01 m and 0.005 degrees
            assert found[name][key]["value"] == pytest.approx(photo[key]["value"], abs=1e-6)
            assert found[name][key]["sd"] == pytest.approx(photo[key]["sd"], rel=1e-6)


def test_a_change_of_the_stations_makes_the_solution_outdated(project: Path) -> None:
    run_quietly(project)
    assert "station" not in str(project_status(project).counts)
    (project / "FIRST.STA").write_text(STATIONS)
    status = project_status(project)
    assert ("exposure station", 2) in status.counts
    assert status.next_command == "orip solve"


def test_a_photo_that_the_project_does_not_have_is_named_with_the_nearest_ones(project: Path) -> None:
    (project / "FIRST.STA").write_text(STATIONS + "rihgt 1 2 3 1 1 1\n")
    (outcome,) = run_quietly(project)
    warning = ("exposure station rihgt", "is not used: the bundle has no photo rihgt; did you mean right?")
    assert warning in [(place, text) for _, place, text in outcome.solution.warnings]


ANTENNA = """
[[antenna]]
name = "GNSS"
lever_arm = [0.0, 0.0, 0.1]
lever_arm_error = [0.01, 0.01, 0.01]
unknown = ["LZ"]
shift = "session"
shift_error = [0.1, 0.1, 0.1]
"""


def with_text(project: Path, text: str) -> None:
    path = project / "orip.toml"
    path.write_text(path.read_text() + text)


def test_an_antenna_is_in_result_listing_and_stores(project: Path) -> None:
    (project / "FIRST.STA").write_text(STATIONS)
    with_text(project, ANTENNA)
    (outcome,) = run_quietly(project)
    document = json.loads((project / "result.json").read_text())
    antenna = document["antennas"]["GNSS"]
    assert set(antenna) == {"LX", "LY", "LZ", "BX", "BY", "BZ", "DT", "SX", "SY", "SZ", "strips"}
    assert antenna["LX"] == {"value": 0.0, "sd": None}
    # both are weighted by what is known of them, and nothing separates them
    assert 0.0 < antenna["LZ"]["sd"] <= 0.0101 * outcome.solution.sigma0
    assert "ANTENNAS: LEVER ARM" in (project / "BUNDLE_RESULT.OUT").read_text()
    assert outcome.solution.antennas[2].name == "LZ"


def test_a_changed_antenna_makes_the_solution_outdated(project: Path) -> None:
    (project / "FIRST.STA").write_text(STATIONS)
    run_quietly(project)
    with_text(project, ANTENNA)
    assert project_status(project).next_command == "orip solve"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ('unknown = ["LZ", "SX"]', "'SX' is not a parameter"),
        ('cameras = ["NONE"]', "NONE"),
        ("lever_arm_error = [0.1, 0.0, 0.1]", "lever_arm_error"),
        ('name = "GNSS2"\n[[antenna]]\nname = "GNSS"', "antenna 'GNSS2' too; give each its own cameras"),
    ],
)
def test_a_wrong_antenna_is_told_with_its_line(project: Path, wrong: str, message: str) -> None:
    key = wrong.partition(" ")[0]
    lines = [line for line in ANTENNA.splitlines() if not line.startswith(f"{key} ")]
    with_text(project, "\n".join([*lines, wrong, ""]))
    with pytest.raises(InputError, match=r"orip\.toml:") as error:
        run_quietly(project)
    assert message in str(error.value)


def test_listing_and_result_have_strip_time_and_residuals_of_stations(project: Path) -> None:
    (project / "FIRST.STA").write_text(STATIONS)
    run_quietly(project)
    listing = (project / "BUNDLE_RESULT.OUT").read_text()
    table = listing[listing.index("\nEXPOSURE STATIONS\n") :]
    rows = {line.split()[0]: line.split() for line in table.splitlines()[:40] if line.startswith(("  left", "  right"))}
    found = json.loads((project / "result.json").read_text())["stations"]
    assert set(found) == {"left", "right"} == set(rows)
    assert (found["right"]["strip"], found["right"]["time"]) == ("S1", 8.0)
    assert (found["left"]["strip"], found["left"]["time"]) == (None, None)
    residuals = [
        line.split(",") for line in (project / "residuals.csv").read_text().splitlines() if line.startswith("station,")
    ]
    for _, photo, _, component, _, residual, *_ in residuals:
        assert found[photo]["residual"][component] == float(residual)
    assert set(found["right"]["attitude_residual"]) == {"OMEGA", "PHI", "KAPPA"}
    assert "attitude_residual" not in found["left"]
    assert f"{found['left']['residual']['Z']:.3f}" in rows["left"]


def test_stations_in_another_system_end_where_those_in_the_grid_do(tmp_path: Path) -> None:
    from pyproj import Transformer

    first_project(tmp_path / "first")
    for name in ("grid", "geographic"):
        project = first_project(tmp_path / name)
        replace_in(project / "orip.toml", 'name = "FIRST"', 'name = "FIRST", crs = "EPSG:25832"')
        control = [line.split() for line in (project / "FIRST.PNT").read_text().splitlines()]
        shifted = [[n, str(float(x) + 561000), str(float(y) + 5934000), *rest] for n, x, y, *rest in control]
        (project / "FIRST.PNT").write_text("\n".join(map(" ".join, shifted)) + "\n")
        toml = (project / "orip.toml").read_text()
        toml = "\n".join(line for line in toml.splitlines() if line[:3] not in {"X0 ", "Y0 ", "Z0 "})
        (project / "orip.toml").write_text(toml)
    to_degrees = Transformer.from_crs(25832, 4258, always_xy=True)
    places = {"left": (562068.79, 5936074.17, 332.52), "right": (562132.0, 5936077.31, 329.77)}
    grid, geographic = "", "CRS EPSG:4258\n"
    for name, (x, y, z) in places.items():
        longitude, latitude = to_degrees.transform(x, y)
        grid += f"{name} {x!r} {y!r} {z!r} 0.02 0.02 0.03\n"
        geographic += f"{name} {longitude!r} {latitude!r} {z!r} 0.02 0.02 0.03\n"
    (tmp_path / "grid" / "FIRST.STA").write_text(grid)
    (tmp_path / "geographic" / "FIRST.STA").write_text(geographic)
    expected, found = orientations(tmp_path / "grid"), orientations(tmp_path / "geographic")
    for name in places:
        for key in ("X0", "Y0", "Z0"):
            assert found[name][key]["value"] == pytest.approx(expected[name][key]["value"], abs=1e-5)


def test_a_system_that_is_not_known_is_said_with_its_line(project: Path) -> None:
    (project / "FIRST.STA").write_text("! by hand\nCRS EPSG:99999\n" + STATIONS)
    replace_in(project / "orip.toml", 'name = "FIRST"', 'name = "FIRST", crs = "EPSG:25832"')
    with pytest.raises(InputError, match=r"FIRST\.STA:2: crs \"EPSG:99999\" is not known to PROJ"):
        run_quietly(project)
