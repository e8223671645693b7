"""A copied bundle has the photo points of its source, with settings, cameras and control of its own."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import first_project, replace_in

from orip.workflow.project.state import read_project


@pytest.fixture(scope="module")
def copied_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = first_project(tmp_path_factory.mktemp("copied") / "first")
    assert orip(folder, "run", "--no-report").code == 0
    assert orip(folder, "bundle", "copy", "MAIN", "B2").code == 0
    said = orip(folder, "run", "--no-report")
    assert said.code == 0, said.told
    return folder


@pytest.fixture
def copied(copied_once: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(copied_once, tmp_path / "first"))


def result(folder: Path, bundle: str) -> dict:
    return json.loads((folder / f"{bundle}_result.json").read_text(encoding="utf-8"))


def test_a_copy_is_adjusted_from_the_same_points_and_compared(copied: Path) -> None:
    assert len((copied / "B2_residuals.csv").read_text().splitlines()) > 10
    equal = orip(copied, "compare", "MAIN", "B2")
    assert equal.code == 0, equal.told
    assert orip(copied, "bundle", "edit", "B2", "measurement_precision=1px").code == 0
    assert orip(copied, "run", "--no-report").code == 0
    differ = orip(copied, "compare", "MAIN", "B2", "--json")
    assert differ.code == 5
    assert {"MAIN_result.json", "B2_result.json"} == {differ.document["a"], differ.document["b"]}
    # twice the a-priori error: residuals are about half as many of them, beside control
    assert result(copied, "B2")["sigma0"] == pytest.approx(result(copied, "MAIN")["sigma0"] / 2.0, rel=0.2)
    other = orip(copied, "compare", "MAIN", "B3")
    assert other.code != 0
    assert "no such file, folder or bundle" in other.err


def test_what_is_measured_later_for_the_source_is_in_the_copy_too(copied: Path) -> None:
    log = (copied / "FIRST.MEA").read_text()
    lines = log.splitlines()
    last = next(row for row in range(len(lines) - 1, -1, -1) if lines[row].strip())
    (copied / "FIRST.MEA").write_text("\n".join([*lines[:last], ""]))
    said = orip(copied, "measure", "--json")
    counts = [step["state"] for step in orip(copied, "status", "--json").document["steps"]]
    assert said.code == 0
    assert counts.count("out of date") == 2, "both bundles are to be adjusted again"


def test_a_copy_has_a_camera_and_control_of_its_own(copied: Path) -> None:
    toml = (copied / "orip.toml").read_text()
    camera = toml.split("[[camera]]")[1].split("name = ")[1].split('"')[1]
    assert orip(copied, "camera", "copy", camera, "OTHER", "distortion.A3=1e-5").code == 0
    control = (copied / "FIRST.PNT").read_text().splitlines()
    (copied / "MOVED.PNT").write_text("\n".join(f"{line} ! moved" for line in control) + "\n")
    said = orip(copied, "bundle", "edit", "B2", f'cameras=[["{camera}", "OTHER"]]', "control_files=MOVED")
    assert said.code == 0, said.told
    assert orip(copied, "run", "--no-report").code in (0, 4)
    of_copy, of_main = result(copied, "B2"), result(copied, "MAIN")
    assert list(of_copy["cameras"]) == ["OTHER"]
    assert list(of_main["cameras"]) == [camera]
    assert "MOVED.PNT" in of_copy["inputs"]
    assert "FIRST.PNT" not in of_copy["inputs"]
    assert "FIRST.PNT" in of_main["inputs"]
    assert orip(copied, "camera", "rename", "OTHER", "NEW").code == 0
    assert '"NEW"' in orip(copied, "bundle", "show", "B2").out


def test_a_copy_may_have_measurements_and_edits_of_its_own(copied: Path) -> None:
    (copied / "OWN.MEA").write_text(
        "POINTS B2 left\n  NEW 1000 1200\nDISREGARD POINT B2 left 1\nKILL POINT MAIN right 2\n"
    )
    assert orip(copied, "measure").code == 0
    found = read_project(copied, "observations").measured.observations
    points = {
        key: {(photo, point): off for photo, point, off in zip(one.photos, one.points, one.disregarded, strict=True)}
        for key, one in found.items()
    }
    of_main, of_copy = points["MAIN"], points["B2"]
    assert set(of_copy) - set(of_main) == {("left", "NEW")}
    assert not set(of_main) - set(of_copy), "what is killed for the source is killed in the copy"
    assert ("right", "2") not in of_main
    assert [place for place, off in of_copy.items() if off] == [("left", "1")]
    assert not any(of_main.values())
    # measured on top of what the stores hold, with the points of the source as they are there
    (copied / "MORE.MEA").write_text("POINTS MAIN right\n  NEW 1500 1200\n")
    assert orip(copied, "measure", "MORE.MEA").code == 0
    again = read_project(copied, "observations").measured.observations
    assert all("NEW" in one.points for one in again.values())
    assert len(again["B2"].points) == len(again["MAIN"].points) + 1


def test_what_cannot_be_is_said(copied: Path) -> None:
    def refused(*words: str) -> str:
        said = orip(copied, *words)
        assert said.code != 0
        return said.err

    assert "no photo points of its own" in refused("bundle", "edit", "B2", "points_of=B2")
    assert "B7" in refused("bundle", "edit", "B2", "points_of=B7")
    assert "base name" in refused("bundle", "edit", "B2", "control_files=a/b")
    assert "NONE" in refused("bundle", "edit", "B2", 'cameras=[["NONE", "NONE"]]')
    assert "referred to by bundle B2" in refused("bundle", "delete", "MAIN", "--yes")
    assert orip(copied, "bundle", "delete", "B2", "--yes").code == 0
    assert orip(copied, "status", "--json").document["steps"][-1]["command"] == "orip solve"


def test_the_settings_are_read_from_the_text_and_written_to_it(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    toml = (folder / "orip.toml").read_text()
    bundle = toml[toml.index("[[bundle]]") :]
    other = bundle.replace('"MAIN"', '"B2"\npoints_of = "MAIN"\ncontrol_files = "FIRST"')
    replace_in(folder / "orip.toml", bundle, f"{bundle}\n{other}")
    assert orip(folder, "run", "--no-report").code == 0
    assert orip(folder, "compare", "MAIN", "B2").code == 0
    assert orip(folder, "bundle", "copy", "B2", "B3").code == 0
    text = orip(folder, "export-toml").out
    assert text.count('points_of = "MAIN"') == 2, "a copy of a copy has the points of the first one"
