"""Users' mistakes: one clear sentence each, the right exit code, no traceback, nothing half-written."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from cli.command_line import Said, orip
from support.long_cases import in_turn
from workflow.small_projects import contents, film_project, replace_in

from orip.files.stores.transaction import writing

COMMANDS = ("status", "init", "measure", "solve", "run")


def refused(said: Said, code: int, *sentences: str) -> None:
    """Check an exit code, and that every sentence is an error of its own."""
    assert said.code == code
    errors = [line for line in said.err.splitlines() if line.startswith("error: ")]
    assert len(errors) == len(sentences), said.err
    for error, sentence in zip(errors, sentences, strict=True):
        assert sentence in error
    assert said.out == ""


@pytest.mark.parametrize("command", COMMANDS)
def test_no_folder_and_no_project(tmp_path: Path, command: str) -> None:
    refused(orip(tmp_path / "nowhere", command), 2, "does not exist; name a project's folder with -C DIR")
    (tmp_path / "file").touch()
    refused(orip(tmp_path / "file", command), 2, "is a file, not a folder")
    refused(orip(tmp_path, command), 3, "there is no orip.toml in")
    assert set(contents(tmp_path)) == {"file"}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("frobnicate",), "No such command 'frobnicate'; see 'orip --help'"),
        (("solv",), "No such command 'solv'. Did you mean 'solve'? see 'orip --help'"),
        (("solve", "--bogus"), "No such option: --bogus"),
        (("--threads", "0", "status"), "Invalid value for '--threads'"),
        (("--color", "purple", "status"), "'purple' is not one of 'auto', 'always', 'never'"),
        (("init", "--prefer", "both"), "'both' is not one of 'text', 'store'; see 'orip init --help'"),
        (("results",), "Missing argument 'WHAT'"),
        (
            ("results", "sausages"),
            "'sausages' is not one of 'cameras', 'photos', 'points', 'theodolites', 'figures'",
        ),
        (("solve", "NIX"), "there is no bundle 'NIX'; the project's bundles are: MAIN"),
        (("dump", "orip.toml"), "is not a record store: stores end in .CAM"),
    ],
)
def test_wrong_usage_is_2_also_as_json(project: Path, words: tuple[str, ...], sentence: str) -> None:
    said = orip(project, *words)
    refused(said, 2, sentence)
    said = orip(project, "--json", *words)
    assert said.code == said.document["exit_code"] == 2
    assert sentence in said.document["errors"][0]["message"]


def test_no_project_is_called_by_a_sign_alone(tmp_path: Path) -> None:
    said = orip(tmp_path, "new", "-")
    assert said.code == 3
    assert "'-' has neither letter nor digit, so it cannot be used in file names" in said.err
    assert not list(tmp_path.iterdir())


def test_a_group_without_a_command_shows_its_help(project: Path) -> None:
    said = orip(project, "control")
    assert said.code == 2
    assert said.err.startswith("Usage: orip control [OPTIONS] COMMAND")
    assert "\n  points " in said.err
    said = orip(project, "--json", "control")
    assert said.document["errors"][0]["message"] == "a command is missing; see 'orip control --help'"


def test_commands_out_of_order_say_which_comes_first(project: Path) -> None:
    before = contents(project)
    refused(orip(project, "measure"), 3, "no record stores yet; run 'orip init' first")
    refused(orip(project, "solve"), 3, "no record stores yet; run 'orip init' first")
    refused(orip(project, "results", "points"), 3, "bundle MAIN has not been adjusted yet; run 'orip solve' first")
    refused(orip(project, "dump", "FIRST.CAM"), 3, "there is no such store; 'orip init' and 'orip measure' make")
    assert contents(project) == before
    orip(project, "init")
    refused(orip(project, "solve"), 3, "has no photo observations yet; run 'orip measure' first")


def test_unknown_names_of_results(project: Path) -> None:
    orip(project, "run")
    refused(orip(project, "results", "points", "999"), 2, "there is no point '999'; there are: ")
    refused(
        orip(project, "results", "points", "p1"), 2, "no point 'p1'; did you mean 'P1'?"
    )  # names of points are compared exactly
    refused(orip(project, "results", "residuals", "x"), 2, "no residual belongs to x")


def test_all_texts_are_checked_at_once_before_any_store_is_made(project: Path) -> None:
    replace_in(project / "FIRST.PNT", "1012.40", "1012,40")
    replace_in(project / "FIRST.MEA", "1436.4", "1436.4.1")
    replace_in(project / "FIRST.MEA", "MAIN right", "OTHER rihgt")
    (project / "MAIN.PRE").write_text("P1 1 2\n")
    before = contents(project)
    for command in ("run", "init"):
        refused(
            orip(project, command), 3,
            "FIRST.MEA:2:7: ", "FIRST.PNT:1:5: ", "MAIN.PRE:1", "FIRST.MEA:7: photo rihgt",
            "FIRST.MEA:7: bundle OTHER",
        )  # fmt: skip
    rows = orip(project, "run", "--json").document["errors"]
    assert {(row["file"], row["line"]) for row in rows} == {
        ("FIRST.MEA", 2), ("FIRST.PNT", 1), ("MAIN.PRE", 1), ("FIRST.MEA", 7)
    }  # fmt: skip
    assert contents(project) == before


def test_a_wrong_project_file_does_not_hide_the_other_faults(project: Path) -> None:
    replace_in(project / "orip.toml", "[[bundle]]", "[[bundel]]")
    replace_in(project / "FIRST.PNT", "1012.40", "east")
    replace_in(project / "FIRST.MEA", "1436.4", "left")
    said = orip(project, "run")
    assert said.code == 3
    for place in ("error: orip.toml:", "error: FIRST.PNT:1:", "error: FIRST.MEA:2:"):
        assert place in said.err
    assert "did you mean 'bundle'" in said.err
    for command in ("camera list", "compare MAIN MAIN"):
        assert orip(project, *command.split()).err.splitlines()[:3] == said.err.splitlines()[:3]
    assert set(contents(project)) == {"orip.toml", "FIRST.PNT", "FIRST.MEA"}


def test_marks_that_cannot_orient_a_photo_are_found_before_any_store_is_made(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    log = (folder / "FIRST.MEA").read_text().splitlines()
    (folder / "FIRST.MEA").write_text("\n".join([log[0], *log[3:]]) + "\n")  # two marks for an affine transformation
    before = contents(folder)
    said = orip(folder, "run")
    assert said.code == 3
    assert "photo left" in said.err
    assert contents(folder) == before


def test_names_in_other_letters(project: Path) -> None:
    (project / "FIRST.PNT").rename(project / "first.pnt")
    refused(orip(project, "run"), 3, "first.pnt: this file is not read: the project's file is called FIRST.PNT")


def test_names_with_the_ending_that_windows_hides(project: Path) -> None:
    for name, words in (
        ("FIRST.PNT", "the project's file is called FIRST.PNT; rename it"),
        ("FIRST.MEA", "measurement files are called *.MEA; rename it"),
    ):
        (project / name).rename(project / f"{name}.txt")
        refused(orip(project, "run"), 3, f"{name}.txt: this file is not read: {words}")
        (project / f"{name}.txt").rename(project / name)
    (project / "first.mea.txt").write_text("notes on the measurements\n")
    assert orip(project, "run").code == 0, "a text beside measurement files that are read may be called anything"


def test_control_that_is_a_workbook(project: Path) -> None:
    (project / "FIRST.PNT").rename(project / "points.xlsx")
    (project / "points.xlsx").write_bytes(b"PK\x03\x04\0\0")
    said = orip(project, "run", "--no-report")
    assert "warning: points.xlsx: this file is not read: workbooks are no texts, and the project has no" in said.err
    assert "save its control as FIRST.PNT (name X Y Z and their errors" in said.err
    (project / "points.xlsx").rename(project / "FIRST.PNT")
    refused(orip(project, "run"), 3, "FIRST.PNT: this is no text, but a workbook (.xlsx, .ods)")


def test_names_that_a_spreadsheet_took_for_numbers(project: Path) -> None:
    text = (project / "FIRST.PNT").read_text()
    (project / "FIRST.PNT").write_text("".join(f"{line.replace(' ', '.0 ', 1)}\n" for line in text.splitlines()))
    said = orip(project, "run", "--no-report")
    assert "control points 1.0, 2.0, 3.0 and 1 more are not measured in any photo, but 1, 2, 3 and 1 more" in said.err
    assert "the names differ by the ending .0 alone" in said.err
    (project / "FIRST.PNT").write_text("".join('"{}" {}\n'.format(*line.split(" ", 1)) for line in text.splitlines()))
    assert "the names differ by quotation marks alone" in orip(project, "run", "--no-report").err


def test_a_measurement_file_in_other_letters_is_not_left_out_silently(project: Path) -> None:
    (project / "more.mea").write_text("POINTS MAIN left\n  9  100.0  100.0\n")
    refused(orip(project, "run"), 3, "more.mea: this file is not read: measurement files are called *.MEA")


def test_a_link_to_nowhere(project: Path) -> None:
    (project / "FIRST.PNT").unlink()
    (project / "FIRST.PNT").symlink_to("gone.pnt")
    refused(orip(project, "run"), 3, "FIRST.PNT: this link points to gone.pnt, which does not exist")


def test_folders_in_place_of_files(project: Path) -> None:
    for name in ("FIRST.PNT", "FIRST.MEA", "orip.toml"):
        text = (project / name).read_bytes()
        (project / name).unlink()
        (project / name).mkdir()
        refused(orip(project, "run"), 3, f"{name}: this is a folder, not a file")
        (project / name).rmdir()
        (project / name).write_bytes(text)
    (project / "FIRST.PHO").mkdir()
    refused(orip(project, "run"), 3, "FIRST.PHO: this is a folder, not a file; a record store is one file")


def test_an_output_that_cannot_be_written_is_made_up_for(project: Path) -> None:
    (project / "result.json").mkdir()
    refused(
        orip(project, "run"),
        1,
        "result.json cannot be written: this is a folder, not a file; the results are safe in the",
    )
    assert "missing or older than the last adjustment: result.json" in orip(project, "status").out
    (project / "result.json").rmdir()
    assert orip(project, "init").code == 0
    assert "everything is up to date" in orip(project, "status").out
    assert not [name for name in contents(project) if name.startswith(".orip")]


def test_nothing_measured(project: Path) -> None:
    (project / "FIRST.MEA").write_text("")
    said = orip(project, "run")
    assert "warning: FIRST.MEA: nothing is measured in this file; write a line POINTS bundle photo" in said.err
    refused(said, 3, "bundle MAIN has no photo points; measure some")
    (project / "FIRST.MEA").unlink()
    assert "nothing is measured yet: no file is called *.MEA" in orip(project, "measure").err
    replace_in(project / "orip.toml", '"FIRST" }', '"FIRST", measurement_files = ["A.MEA"] }')
    refused(orip(project, "run"), 3, "measurement file 'A.MEA' does not exist")


@pytest.mark.parametrize(
    ("crs", "words"),
    [("EPSG:4326", "is not a projected system"), ("UTM 32N", "not known to PROJ"), ("EPSG:5513", "must grow to the")],
)
def test_a_system_that_is_none_is_said_with_its_place_before_a_store_is_made(
    project: Path, crs: str, words: str
) -> None:
    text = project / "orip.toml"
    text.write_text(text.read_text().replace('name = "FIRST"', f'name = "FIRST", crs = "{crs}"', 1))
    said = orip(project, "init")
    assert said.code == 3
    assert f"error: orip.toml:1: crs {crs}" in said.err.replace('"', ""), said.err
    assert words in said.err
    assert not list(project.glob("*.CAM"))


def test_a_copy_of_the_measurements_is_named(project: Path) -> None:
    (project / "FIRST (1).MEA").write_bytes((project / "FIRST.MEA").read_bytes())
    said = orip(project, "run", "--no-report").err
    assert "warning: FIRST.MEA is the same as FIRST (1).MEA: all of it is measured twice; remove one" in said


@pytest.mark.parametrize("text", ["", "! to be surveyed\n"])
def test_a_control_file_without_points_is_named_first(project: Path, text: str) -> None:
    (project / "FIRST.PNT").write_text(text)
    warnings = [line for line in orip(project, "run", "--no-report").err.splitlines() if line.startswith("warning")]
    assert warnings[0].startswith("warning: FIRST.PNT: there is no control point in this file; write each as a line")


def test_text_that_is_no_utf8(project: Path) -> None:
    (project / "FIRST.MEA").write_bytes("POINTS MAIN left\n".encode("utf-16"))
    refused(orip(project, "run"), 3, "FIRST.MEA:1: the file is UTF-16; save it as UTF-8")


@pytest.mark.parametrize("damage", [b"garbage", b"SQLite format 3\0 and then nothing of the kind" * 100])
def test_damaged_stores(project: Path, damage: bytes) -> None:
    orip(project, "run")
    (project / "FIRST.EXT").write_bytes(damage)
    before = contents(project)
    for command in (*COMMANDS, "results points", "dump FIRST.EXT"):
        said = orip(project, *command.split())
        assert said.code == 3
        assert f"error: {project}/FIRST.EXT: " in said.err
    assert contents(project) == before


def test_a_store_of_another_program(project: Path) -> None:
    connection = sqlite3.connect(project / "CAMERAS.CAM")
    connection.execute("CREATE TABLE mine (a)")
    connection.close()
    refused(orip(project, "run"), 3, "CAMERAS.CAM: this SQLite file belongs to another program")


@pytest.mark.parametrize(
    ("name", "lose"),
    in_turn(
        ["CAMERAS.CAM", "FIRST.PHO", "FIRST.EXT", "MAIN.EXO", "FIRST.TEM"],
        [Path.unlink, lambda path: path.write_bytes(b"")],
    ),
)
def test_a_lost_or_emptied_store_is_noticed_and_rebuilt(
    adjusted: Path, name: str, lose: Callable[[Path], object]
) -> None:
    after = {name: orip(adjusted, "dump", name).out for name in ("CAMERAS.CAM", "FIRST.PHO", "FIRST.EXT", "MAIN.EXO")}
    lose(adjusted / name)
    assert "next     nothing" not in orip(adjusted, "status").out
    said = orip(adjusted, "solve")
    assert said.code in (0, 3)
    assert "internal" not in said.err
    assert orip(adjusted, "run", "--no-report").code == 0
    assert after == {name: orip(adjusted, "dump", name).out for name in after}


def test_text_and_store_changed_both(project: Path) -> None:
    orip(project, "run")
    dumped = orip(project, "dump", "CAMERAS.CAM").out
    (project / "dump.txt").write_text(dumped.replace("35.0", "35.7"))
    orip(project, "load", "CAMERAS.CAM", "dump.txt")
    assert orip(project, "run").code == 0
    assert "35.7" in orip(project, "dump", "CAMERAS.CAM").out, "the text has not changed: it undoes nothing"
    replace_in(project / "orip.toml", "c = 35.0", "c = 35.2")
    before = contents(project)
    for command in ("init", "run"):
        refused(
            orip(project, command),
            3,
            "orip.toml:2: camera C35 was changed both in the text and in the store: C is 35.2",
        )
    assert contents(project) == before
    assert "changed both in orip.toml and in the stores" in orip(project, "status").out
    assert orip(project, "run", "--prefer", "store").code == 0
    assert "35.7" in orip(project, "dump", "CAMERAS.CAM").out
    replace_in(project / "orip.toml", "c = 35.2", "c = 35.3")
    assert orip(project, "init", "--prefer", "text").code == 0
    assert "35.3" in orip(project, "dump", "CAMERAS.CAM").out


@pytest.mark.parametrize("command", ["init", "measure", "solve", "run", "load MAIN.EXO dump.txt"])
def test_locked_by_another_run(project: Path, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    orip(project, "run")
    (project / "dump.txt").write_text(orip(project, "dump", "MAIN.EXO").out)
    replace_in(project / "FIRST.MEA", "1436.4", "1436.5")
    before = contents(project)
    with writing([project / "FIRST.EXT", project / "MAIN.EXO"]):
        # orip waits ten seconds for the other run; the test does not
        monkeypatch.setitem(writing.__wrapped__.__kwdefaults__, "timeout", 0.01)
        monkeypatch.setattr("orip.files.stores.dump.load.__kwdefaults__", {"source": "dump", "timeout": 0.01})
        refused(orip(project, *command.split()), 6, "locked by another run of orip; wait for it, or end it, and repeat")
        assert orip(project, "--json", *command.split()).document["exit_code"] == 6
        assert orip(project, "status").code == 0
        assert orip(project, "results", "points").code == 0
    assert contents(project) == before


def test_a_faulty_dump_changes_nothing(project: Path) -> None:
    orip(project, "run")
    (project / "dump.txt").write_text(orip(project, "dump", "MAIN.EXO").out.replace("1436.4", '"east"'))
    before = contents(project)
    said = orip(project, "load", "MAIN.EXO", "dump.txt")
    assert said.code == 3
    assert "error: dump.txt:" in said.err
    refused(orip(project, "load", "MAIN.EXO", "nix.txt"), 3, "nix.txt: there is no such file")
    assert contents(project) == before


def test_an_internal_error_is_a_sentence_and_a_document(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_folder: Path) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("orip.workflow.status.project_status", fail)
    said = orip(project, "status", "--json")
    assert said.code == said.document["exit_code"] == 1
    assert "this is a fault of orip, please report it" in said.err


def test_control_that_nothing_uses_is_named(project: Path) -> None:
    (project / "FIRST.LEN").write_text("D1 1 Z9 XYZ 100.0 0.02\nD2 Y8 Z9 XYZ 100.0 0.02\n")
    (project / "FIRST.ELE").write_text("MIDDLE PHOTO X0 1100.0 0.1\nC36 CAMERA C 36.0 0.1\n")
    (project / "FIRST.DIR").write_text("S1 2 Z9 40.0 0.003\n")
    (project / "FIRST.CON").write_text(
        "LAKE HEIGHT 1 5\nLAKE HEIGHT 2 5\nLAKE HEIGHT Z9 5\nWALL PLANE 1 5\nD DIRECTION 1 0.1 Z9 0 0 1\n"
    )
    said = orip(project, "run")
    assert said.code == 0
    for words in (
        "distance D1 is not used: Z9 is neither measured nor given coordinates; correct the name",
        "distance D2 is not used: Y8 and Z9 are neither measured",
        "element PHOTO MIDDLE X0 is not used: the bundle has no photo MIDDLE; correct the name",
        "element CAMERA C36 C is not used: the bundle has no camera C36",
        "direction S1 2 Z9 is not used: Z9 is neither measured",
        "given direction D is not used: Z9 is neither measured",
        "point Z9 of figure LAKE is not used: Z9 is neither measured",
        "plane WALL is left out: 1 point of it in this bundle, and it says nothing of fewer than 4",
    ):
        assert f"warning: {words}" in said.err


def test_a_text_with_a_fault_in_each_line_tells_the_cause_once(project: Path) -> None:
    with (project / "FIRST.PNT").open("a") as control:
        control.writelines(f"U{number} 1,{number} 2.0 3.0 0 0 0\n" for number in range(3000))
    (project / "FIRST.ELE").write_text("nonsense\n")
    said = orip(project, "run")
    assert said.code == 3
    errors = [line for line in said.err.splitlines() if line.startswith("error: ")]
    (of_points,) = [error for error in errors if "FIRST.PNT:" in error]
    assert "has a decimal comma; write a decimal point" in of_points
    assert "(3000 times, then in line " in of_points
    assert any("FIRST.ELE:1" in error for error in errors), "no text hides the faults of another"
    assert said.err.splitlines()[-1] == "3001 errors; nothing was written"


def test_the_same_fault_in_each_line_is_told_once_with_its_number(project: Path) -> None:
    with (project / "FIRST.PNT").open("a") as control:
        first = len((project / "FIRST.PNT").read_text().splitlines()) + 1
        control.writelines(f"U{number} 1,0 2.0 3.0 0 0 0\n" for number in range(3000))
    said = orip(project, "run")
    assert said.code == 3
    (error,) = (line for line in said.err.splitlines() if line.startswith("error: "))
    assert error.startswith(f"error: FIRST.PNT:{first}:4")
    assert error.endswith(f" (3000 times, then in line {first + 1}, {first + 2}, {first + 3} ...)")
    assert said.err.splitlines()[-1] == "3000 errors; nothing was written"


def test_a_log_of_another_form_is_not_read_to_its_end(project: Path) -> None:
    with (project / "FIRST.MEA").open("a") as log:
        log.writelines(f"P{number},1,2\n" for number in range(100_000))
    said = orip(project, "run")
    assert said.code == 3
    assert "(2000 times, then in line " in said.err
    assert "after 2000 errors the rest of this file is not read" in said.err


def test_control_of_a_whole_country_is_counted_and_not_listed(project: Path) -> None:
    with (project / "FIRST.PNT").open("a") as control:
        control.writelines(f"U{number} 1010.0 2010.0 100.0 0.1 0.1 0.1\n" for number in range(3000))
    said = orip(project, "run")
    assert said.code == 0
    assert len(said.err.splitlines()) < 100
    assert "warning: 2950 more control observations are not used either" in said.err
    assert (project / "BUNDLE_ERROR.OUT").stat().st_size < 20_000
