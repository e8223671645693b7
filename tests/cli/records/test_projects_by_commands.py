"""A project without a record in orip.toml: everything is defined by commands, and is measured and adjusted."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.command_line import Said, orip
from workflow.small_projects import contents, first_project

CAMERA = "camera add C35 c=35.0 sensor={columns=6000,rows=4000,width=36.0,height=24.0}"
PHOTOS = (
    "photo add left camera=C35 X0=1070 Y0=2075 Z0=330 OMEGA=0 PHI=0 KAPPA=0",
    "photo add right camera=C35 X0=1130 Y0=2075 Z0=330 OMEGA=0 PHI=0 KAPPA=0",
)


def done(said: Said) -> Said:
    assert said.code == 0, said.err
    return said


def points_of(bundle: str, folder: Path) -> str:
    """Return the measurements of the first project for a bundle of another name."""
    return (folder / "FIRST.MEA").read_text().replace("POINTS MAIN", f"POINTS {bundle}")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project that only commands have defined, with the control and measurements of the first project."""
    given = first_project(tmp_path / "given")
    said = done(orip(tmp_path, "init", "FIRST", "made", "--user", "K. Dueholm"))
    assert f"orip -C {tmp_path / 'made'} camera add" in said.err
    folder = tmp_path / "made"
    for words in (CAMERA, *PHOTOS, "bundle add MAIN measurement_precision=0.5px"):
        done(orip(folder, *words.split()))
    for name in ("FIRST.PNT", "FIRST.MEA"):
        (folder / name).write_bytes((given / name).read_bytes())
    return folder


def test_it_is_adjusted_like_one_that_is_defined_in_the_text(project: Path, tmp_path: Path) -> None:
    found = done(orip(project, "run", "--json")).document
    expected = done(orip(tmp_path / "given", "run", "--json")).document
    assert (found["project"], found["user"], found["bundle"]) == ("FIRST", "K. Dueholm", "MAIN")
    assert found["points"] == expected["points"]
    assert (project / "BUNDLE_RESULT.OUT").is_file()
    status = done(orip(project, "status", "--json")).document
    assert status["counts"] == {"cameras": 1, "templates": 0, "photos": 2, "bundles": 1, "photo points": 10}
    assert status["next"] is None
    before = contents(project)
    done(orip(project, "init"))
    done(orip(project, "run"))
    assert {name for name, data in contents(project).items() if before.get(name) != data} == set()


def test_copied_and_renamed_bundles_are_adjusted_too(project: Path) -> None:
    done(orip(project, "bundle", "copy", "MAIN", "AGAIN", "max_standard_residual=3"))
    done(orip(project, "bundle", "rename", "AGAIN", "THIRD"))
    (project / "THIRD.MEA").write_text(points_of("THIRD", project))
    done(orip(project, "run"))
    status = done(orip(project, "status", "--json")).document
    assert status["counts"]["bundles"] == 2
    assert status["counts"]["photo points"] == 20
    assert [step["command"] for step in status["steps"]][2:] == ["orip solve MAIN", "orip solve THIRD"]
    assert all(step["state"] == "up to date" for step in status["steps"])
    said = orip(project, "solve")
    assert said.code == 2
    assert "the project has 2 bundles; name one of them: MAIN, THIRD" in said.err
    assert done(orip(project, "solve", "third", "--json")).document["bundle"] == "THIRD"
    done(orip(project, "bundle", "delete", "THIRD", "--with-referents", "--yes"))
    (project / "THIRD.MEA").unlink()
    done(orip(project, "run"))
    assert done(orip(project, "status", "--json")).document["counts"]["bundles"] == 1


def test_a_bundle_of_commands_beside_one_of_the_text(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    done(orip(folder, "init"))
    done(orip(folder, "bundle", "add", "SIDE", "measurement_precision=1px"))
    (folder / "SIDE.MEA").write_text(points_of("SIDE", folder))
    done(orip(folder, "run"))
    assert (folder / "SIDE_RESULT.OUT").is_file()
    assert (folder / "MAIN_RESULT.OUT").is_file()
    assert done(orip(folder, "status", "--json")).document["counts"]["bundles"] == 2


def test_a_project_without_bundles_says_what_to_do(tmp_path: Path) -> None:
    done(orip(tmp_path, "init", "NEW"))
    said = orip(tmp_path / "NEW", "solve")
    assert said.code == 2
    assert "the project has no bundle yet; 'orip bundle add NAME' makes one" in said.err
    assert done(orip(tmp_path / "NEW", "status", "--json")).document["counts"]["bundles"] == 0


def test_a_project_is_made_once_and_with_a_name_that_is_allowed(tmp_path: Path) -> None:
    done(orip(tmp_path, "init", "NEW"))
    before = contents(tmp_path / "NEW")
    said = orip(tmp_path, "init", "NEW")
    assert said.code == 2
    assert "has the file orip.toml already: name another folder" in said.err
    assert contents(tmp_path / "NEW") == before
    said = orip(tmp_path, "init", "A/B")
    assert said.code == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["NEW"]
