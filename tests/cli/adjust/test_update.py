"""`orip update`: values of the last adjustment become preliminary values."""

from __future__ import annotations

import json
import shutil
import stat
from collections.abc import Iterable
from pathlib import Path

import pytest
from cli.command_line import Said, orip
from workflow.small_projects import REPOSITORY, contents, first_project, replace_in, two_bundles

from orip.files.stores.contents import solutions
from orip.files.stores.contents.stores import CAMERAS, PHOTOS
from orip.files.stores.transaction import reading, writing
from orip.files.text.atomic import replace_in_pieces

KINDS = ("cameras", "photos", "points")
ZURICH = REPOSITORY / "sample_projects" / "zurich_city_hall"
DCS260 = REPOSITORY / "sample_projects" / "dcs260_calibration"

pytestmark = pytest.mark.usefixtures("adjusted")


def sample(source: Path, folder: Path) -> Path:
    shutil.copytree(source, folder)
    assert orip(folder, "run").code == 0
    return folder


def refused(said: Said, code: int, sentence: str) -> None:
    assert said.code == code
    assert sentence in said.err
    assert said.out == ""


def orientation(folder: Path, name: str) -> tuple[float | None, ...]:
    with reading([folder / "FIRST.PHO"]) as stores:
        records = PHOTOS.read(stores[folder / "FIRST.PHO"])
    return next(record.record.orientation for record in records if record.record.name == name)


def set_status(folder: Path, status: str) -> None:
    path = folder / "FIRST.EXT"
    dump = orip(folder, "dump", "FIRST.EXT").out
    assert dump.count('"converged"') == 1
    (folder / "dump.txt").write_text(dump.replace('"converged"', f'"{status}"'))
    assert orip(folder, "load", "FIRST.EXT", "dump.txt").code == 0
    (folder / "dump.txt").unlink()
    with reading([path]) as stores:
        assert solutions.read(stores[path], "MAIN").status == status  # type: ignore[union-attr]


def test_photos_take_their_adjusted_values(project: Path) -> None:
    said = orip(project, "update", "photos")
    assert said.code == 0
    assert said.out == ""
    assert "update   FIRST.PHO: 2 of 2 photos have new values" in said.err
    result = orip(project, "results", "photos", "--json").document["photos"]
    for name in ("left", "right"):
        assert orientation(project, name) == tuple(element["value"] for element in result[name].values())


def test_points_go_into_the_text_with_their_deviations(project: Path) -> None:
    said = orip(project, "update", "points")
    assert "update   MAIN.PRE: 5 of 5 points have new values" in said.err
    lines = (project / "MAIN.PRE").read_text().splitlines()
    assert lines[0] == "! Preliminary coordinates, m: name X Y Z [sX sY sZ]; project FIRST"
    result = orip(project, "results", "points", "--json").document["points"]
    for line in lines[1:]:
        name, *numbers = line.split()
        estimates = [result[name][axis] for axis in "XYZ"]
        assert list(map(float, numbers)) == [estimate[what] for what in ("value", "sd") for estimate in estimates]


@pytest.mark.parametrize("what", KINDS)
def test_a_second_time_changes_nothing_and_says_so(project: Path, what: str) -> None:
    orip(project, "update", what)
    before = contents(project)
    said = orip(project, "update", what, "--json")
    assert said.code == 0
    assert said.document["unchanged"] is True
    assert said.document["changes"] == said.document["changed"] == []
    assert "update   unchanged: " in said.err
    assert contents(project) == before


def test_json(project: Path) -> None:
    document = orip(project, "update", "photos", "LEFT", "--json").document
    assert (document["command"], document["what"], document["bundle"]) == ("update", "photos", "MAIN")
    assert document["file"] == "FIRST.PHO"
    assert document["run"] == orip(project, "results", "photos", "--json").document["run"]
    assert document["changed"] == ["left"]
    first = document["changes"][0]
    assert (first["name"], first["parameter"], first["old"]) == ("left", "X0", 1070.0)
    assert document["kept"] == document["warnings"] == []


def test_named_ones_alone(project: Path) -> None:
    before = orientation(project, "right")
    assert orip(project, "update", "photos", "left").code == 0
    assert orientation(project, "right") == before
    assert orip(project, "update", "points", "P1", "1").code == 0
    assert [line.split()[0] for line in (project / "MAIN.PRE").read_text().splitlines()[1:]] == ["1", "P1"]


def test_verbose_shows_each_value(project: Path) -> None:
    assert "photo left: X0 1070 -> 10" in orip(project, "-v", "update", "photos").err
    assert "photo left: X0" not in orip(project, "update", "photos").err


def test_points_that_the_adjustment_does_not_have_and_leading_comments_stay(project: Path) -> None:
    (project / "MAIN.PRE").write_text("# by hand\n\n! metres\nfar 1 2 3 ! a guess\nP1 1100 2050 100\n")
    assert orip(project, "run").code == 0
    said = orip(project, "update", "points")
    assert "kept     1 points of MAIN.PRE that the adjustment of MAIN does not have" in said.err
    lines = (project / "MAIN.PRE").read_text().splitlines()
    assert lines[:3] == ["# by hand", "", "! metres"]
    assert lines[3].split() == ["far", "1.0", "2.0", "3.0"]
    assert lines[4].split()[0] == "P1"
    assert orip(project, "update", "points", "--json").document["others"] == 1


def test_constants_stay(project: Path) -> None:
    replace_in(project / "FIRST.PNT", "0.02 0.02 0.03", "0 0 0")
    replace_in(project / "orip.toml", 'name = "right"', 'name = "right"\nconstant = ["X0", "OMEGA"]')
    assert orip(project, "run").code == 0
    assert orip(project, "update", "photos").code == 0
    after = orientation(project, "right")
    assert (after[0], after[3]) == (1130.0, 0.0)
    assert after[1] != 2075.0
    said = orip(project, "update", "points")
    assert "constant in the adjustment of MAIN, and left as they are: 4 points" in said.err
    assert [line.split()[0] for line in (project / "MAIN.PRE").read_text().splitlines()[1:]] == ["P1"]
    said = orip(project, "update", "cameras")
    assert said.code == 0
    assert "update   unchanged: the adjustment of MAIN has no unknown of these cameras" in said.err


def test_undetermined_points_keep_their_place_and_are_named(project: Path) -> None:
    replace_in(project / "FIRST.MEA", "POINTS MAIN left\n", "POINTS MAIN left\n  lone 3000.0 2000.0\n")
    (project / "MAIN.PRE").write_text("lone 1071 2075 100\n")
    assert orip(project, "run").code == 0
    said = orip(project, "update", "points")
    assert "kept     point lone XYZ: nothing determines it" in said.err
    assert ["lone", "1071.0", "2075.0", "100.0"] in [
        line.split() for line in (project / "MAIN.PRE").read_text().splitlines()
    ]


def test_a_camera_survives_the_next_run_and_the_adjustment_stays(tmp_path: Path) -> None:
    folder = sample(DCS260, tmp_path / "dcs")
    before = (folder / "result.json").read_bytes()
    (tmp_path / "before.json").write_bytes(before)
    said = orip(folder, "update", "cameras")
    assert "camera DCS: C 8 -> 10." in said.err
    with reading([folder / "CAMERAS.CAM"]) as stores:
        (updated,) = CAMERAS.read(stores[folder / "CAMERAS.CAM"])
    assert updated.record.parameters[0] != 8.0
    for what in ("photos", "points"):
        assert orip(folder, "update", what).code == 0
    said = orip(folder, "run")
    assert "init     unchanged" in said.err
    with reading([folder / "CAMERAS.CAM"]) as stores:
        assert CAMERAS.read(stores[folder / "CAMERAS.CAM"]) == (updated,)
    # standard deviations are those of the normal equations before the last correction, 1e-4 of them long
    assert orip(folder, "compare", "../before.json", ".", "--relative=1e-5").code == 0


def test_zurich_from_its_own_results_takes_two_iterations_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # what Zurich's wrong control points are taken for is not what is compared, and needs many adjustments
    monkeypatch.setattr("orip.solving.solve.explain_misfit", lambda *_: [])
    folder = sample(ZURICH, tmp_path / "zurich")
    shutil.copy(folder / "result.json", tmp_path / "before.json")
    assert len(orip(folder, "solve", "--json").document["iterations"]) > 10
    for what in KINDS:
        assert orip(folder, "update", what).code == 0
    assert len(orip(folder, "run", "--json").document["iterations"]) <= 2
    # standard deviations are those of the normal equations before the last correction, 1e-4 of them long
    assert orip(folder, "compare", "../before.json", ".", "--relative=1e-5").code == 0
    # the iterations end when corrections are below 1e-4 of a standard deviation
    assert orip(folder, "compare", "../before.json", ".", "--sigma", "0.0001").code == 0


def test_a_text_that_changes_the_same_record_is_a_conflict(project: Path) -> None:
    orip(project, "update", "photos", "left")
    updated = orientation(project, "left")
    replace_in(project / "orip.toml", "X0 = 1070.0", "X0 = 1071.0")
    refused(orip(project, "run"), 3, "photo left was changed both in the text and in the store: X0 is 1071.0 in the")
    assert orip(project, "init", "--prefer", "store").code == 0
    assert orientation(project, "left") == updated
    replace_in(project / "orip.toml", "X0 = 1071.0", "X0 = 1072.0")
    assert orip(project, "init", "--prefer", "text").code == 0
    assert orientation(project, "left")[0] == 1072.0


def test_an_adjusted_lever_arm_is_to_be_written_into_the_text(project: Path) -> None:
    (project / "FIRST.STA").write_text(
        "left 1068.79 2074.17 332.92 0.02 0.02 0.03\nright 1132 2077.31 330.17 0.02 0.02 0.03\n"
    )
    text = (project / "orip.toml").read_text()
    antenna = '\n[[antenna]]\nname = "GNSS"\nunknown = ["LZ"]\n'
    (project / "orip.toml").write_text(text + antenna)
    assert orip(project, "run").code == 0
    said, document = orip(project, "update", "cameras"), orip(project, "update", "cameras", "--json").document
    height = json.loads((project / "result.json").read_text())["antennas"]["GNSS"]["LZ"]["value"]
    written = f"lever_arm = [0, 0, {height:.6g}]"
    assert f"kept     antenna GNSS lever_arm: orip.toml alone has it: write {written} in [[antenna]] there" in said.err
    assert [(row["name"], row["parameter"]) for row in document["antennas"]] == [("GNSS", "lever_arm")]
    (project / "orip.toml").write_text(text + antenna + "lever_arm_error = [0.1, 0.1, 0.1]\n")
    assert orip(project, "run").code == 0
    assert "lever_arm" not in orip(project, "update", "cameras").err  # it stays as measured
    (project / "orip.toml").write_text(text + antenna + written.replace("0, 0,", "0.0, 0.0,") + "\n")
    assert orip(project, "run").code == 0
    assert "lever_arm" not in orip(project, "update", "cameras").err


@pytest.mark.parametrize("what", KINDS)
@pytest.mark.parametrize(("status", "ended"), [("not_converged", "did not converge"), ("stopped", "was stopped")])
def test_an_adjustment_that_did_not_end_well_is_refused(project: Path, what: str, status: str, ended: str) -> None:
    set_status(project, status)
    before = contents(project)
    refused(orip(project, "update", what), 4, f"the last adjustment of MAIN {ended}")
    assert contents(project) == before
    assert orip(project, "update", what, "--force").code == 0


def test_unknown_names(project: Path) -> None:
    before = contents(project)
    refused(orip(project, "update", "photos", "st1"), 2, "the solution has no photo st1; it has left, right")
    refused(orip(project, "update", "points", "p1"), 2, "the solution has no point p1; it has 1, 2, 3, 4, P1")
    refused(orip(project, "update", "cameras", "X", "Y", "c35"), 2, "the solution has no camera X, Y; it has C35")
    refused(orip(project, "update", "sausages"), 2, "is not one of")
    assert contents(project) == before


def test_nothing_adjusted_yet(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "p")
    before = contents(folder)
    for what in KINDS:
        refused(orip(folder, "update", what), 3, "the project has no record stores yet; run 'orip init' first")
    assert contents(folder) == before
    orip(folder, "init")
    orip(folder, "measure")
    for what in KINDS:
        refused(orip(folder, "update", what), 3, "bundle MAIN has not been adjusted yet; run 'orip solve' first")


def test_a_photo_that_is_no_longer_defined(project: Path) -> None:
    replace_in(project / "orip.toml", 'name = "right"', 'name = "other"')
    replace_in(project / "FIRST.MEA", "right", "other")
    assert orip(project, "init").code == 0
    before = contents(project)
    refused(orip(project, "update", "photos"), 3, "no longer defined: photos RIGHT of the last adjustment; run 'orip")
    assert contents(project) == before
    assert orip(project, "update", "photos", "left").code == 0


def test_control_and_measurements_that_are_newer_are_named(project: Path) -> None:
    replace_in(project / "FIRST.PNT", "1012.40", "1012.41")
    replace_in(project / "FIRST.MEA", "1436.4", "1436.5")
    orip(project, "measure")
    said = orip(project, "update", "photos")
    assert said.code == 0
    for name in ("FIRST.PNT", "MAIN.EXO"):
        assert f"warning: {name}: has changed since the last adjustment" in said.err
    assert "warning" not in orip(first_project(project.parent / "other"), "run").err


def test_several_bundles(tmp_path: Path) -> None:
    folder = two_bundles(tmp_path / "p")
    orip(folder, "run")
    refused(orip(folder, "update", "points"), 2, "the project has 2 bundles; name one of them")
    assert orip(folder, "update", "points", "--bundle", "again").code == 0
    assert (folder / "AGAIN.PRE").is_file()
    assert not (folder / "MAIN.PRE").exists()


def test_a_faulty_text_is_not_overwritten(project: Path) -> None:
    (project / "MAIN.PRE").write_text("P1 1 2\n")
    before = contents(project)
    refused(orip(project, "update", "points"), 3, "MAIN.PRE:1")
    assert contents(project) == before


def test_a_text_that_cannot_be_written(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, pieces: Iterable[str]) -> None:
        if path.suffix == ".PRE":
            raise OSError(28, "No space left on device")
        replace_in_pieces(path, pieces)

    monkeypatch.setattr("orip.workflow.project.outputs.replace_in_pieces", full)
    sentence = "MAIN.PRE cannot be written: No space left on device; the file is unchanged"
    refused(orip(project, "update", "points"), 1, sentence)


def test_permissions_of_the_text_stay(project: Path) -> None:
    (project / "MAIN.PRE").write_text("P1 1100 2050 100\n")
    (project / "MAIN.PRE").chmod(0o640)
    assert orip(project, "update", "points").code == 0
    assert stat.S_IMODE((project / "MAIN.PRE").stat().st_mode) == 0o640


@pytest.mark.parametrize("what", KINDS)
def test_locked_by_another_run(project: Path, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = contents(project)
    with writing([project / "FIRST.EXT"]):
        monkeypatch.setitem(writing.__wrapped__.__kwdefaults__, "timeout", 0.01)  # type: ignore[attr-defined]
        refused(orip(project, "update", what), 6, "locked by another run of orip")
    assert contents(project) == before


@pytest.mark.parametrize("what", KINDS)
def test_the_last_update_is_undone_once(project: Path, what: str) -> None:
    replace_in(project / "orip.toml", 'name = "C35"', 'name = "C35"\nunknown = ["C"]')
    (project / "MAIN.PRE").write_bytes(b"! mine\r\nfar 1 2 3\r\nP1 1100 2050 100\r\n")
    assert orip(project, "run").code == 0
    before = values_of(project)
    preview = orip(project, "update", what, "--dry-run", "--json").document
    assert (preview["dry_run"], preview["unchanged"]) == (True, False)
    assert values_of(project) == before
    done = orip(project, "update", what, "--json").document
    assert done["changes"] == preview["changes"]
    after = values_of(project)
    assert after != before
    assert orip(project, "update", "--undo", "--dry-run").code == 0
    assert values_of(project) == after
    said = orip(project, "update", "--undo")
    assert said.code == 0
    assert f"has the {what} of before the last update" in said.err
    assert values_of(project) == before
    refused(orip(project, "update", "--undo"), 3, "there is no update to undo")


def values_of(folder: Path) -> list[object]:
    """Return all that an update may change: the records of cameras and photos, and the text of the points."""
    paths = [folder / "CAMERAS.CAM", folder / "FIRST.PHO"]
    with reading(paths) as stores:
        return [CAMERAS.read(stores[paths[0]]), PHOTOS.read(stores[paths[1]]), (folder / "MAIN.PRE").read_bytes()]


def test_points_of_a_file_that_was_not_there_go_again(project: Path) -> None:
    assert not (project / "MAIN.PRE").exists()
    assert orip(project, "update", "points").code == 0
    assert orip(project, "update", "--undo").code == 0
    assert not (project / "MAIN.PRE").exists()


def test_what_was_changed_since_is_not_undone(project: Path) -> None:
    assert orip(project, "update", "photos").code == 0
    assert orip(project, "photo", "edit", "left", "X0=1071").code == 0
    assert orip(project, "photo", "rename", "right", "RIGHT2").code == 0
    before = contents(project)
    said = orip(project, "update", "--undo")
    refused(said, 3, "photo left has been changed since the update")
    assert "photo right has been changed since the update, or is no longer defined" in said.err
    assert contents(project) == before


def test_points_edited_since_are_not_undone(project: Path) -> None:
    assert orip(project, "update", "points").code == 0
    with (project / "MAIN.PRE").open("a") as text:
        text.write("Q1 1 2 3\n")
    refused(orip(project, "update", "--undo"), 3, "MAIN.PRE: it has been changed since the update")


@pytest.mark.parametrize(
    "text",
    ["", "{}", "[]", '{"schema": "orip.before_update/1", "what": "photos"}', '{"schema": "orip.before_update/2"}'],
)
def test_a_damaged_record_of_the_update_is_refused(project: Path, text: str) -> None:
    (project / "before_update.json").write_text(text)
    refused(orip(project, "update", "--undo"), 3, "before_update.json: this is not what 'orip update' wrote")


def test_undo_takes_no_kind_and_an_update_needs_one(project: Path) -> None:
    refused(orip(project, "update", "photos", "--undo"), 2, "leave out 'photos'")
    refused(orip(project, "update"), 2, "say what to update")
