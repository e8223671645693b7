"""`orip observations`: listing, edits, what to measure again, and measuring it again."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli.command_line import Said, orip
from interior.template_project import BLUNDER, film_with_blunder, plate_coordinates
from workflow.small_projects import contents, film_project, first_project, two_bundles


@pytest.fixture(scope="module")
def adjusted_film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project on a template, with a blunder in point P1, adjusted."""
    folder = film_with_blunder(tmp_path_factory.mktemp("adjusted") / "film")
    assert orip(folder, "run").code == 0
    return folder


@pytest.fixture
def film(tmp_path: Path, adjusted_film: Path) -> Path:
    return Path(shutil.copytree(adjusted_film, tmp_path / "film"))


def observe(folder: Path, *words: str) -> Said:
    return orip(folder, "observations", *words)


def refused(folder: Path, code: int, sentence: str, *words: str) -> None:
    """Check that a command is refused with a sentence, in words and in JSON, and that it changes nothing."""
    before = contents(folder)
    said = observe(folder, *words)
    assert said.code == code
    assert sentence in said.err
    assert said.out == ""
    document = observe(folder, *words, "--json").document
    assert document["exit_code"] == code
    assert any(sentence in fault["message"] for fault in document["errors"])
    assert contents(folder) == before


def wrong_photo(folder: Path) -> str:
    """Return the photo that the adjustment holds to have the blunder."""
    (point,) = observe(folder, "list", "--json").document["observations"]
    assert point["point"] == "P1"
    return str(point["photo"])


def other_than(photo: str) -> str:
    return "right" if photo == "left" else "left"


# list


def test_list_shows_down_weighted_points_with_the_columns_of_the_manual(film: Path) -> None:
    said = observe(film, "list")
    assert said.code == 0
    heading, _, _, row = said.out.splitlines()
    assert heading.split("  ")[1] == "Point"
    for column in ("Photo", "X-template Y-template", "WX", "WY", "X_residual Y_residual", "SD X", "SD Y",
                   "X WF", "Y WF"):  # fmt: skip
        assert column in heading
    assert row.split()[:2] == ["P1", wrong_photo(film)]
    assert row.split()[-1] == "down-weighted"
    assert said.err == ""


def test_list_in_json_agrees_with_the_residuals_of_the_adjustment(film: Path) -> None:
    document = observe(film, "list", "--json").document
    assert (document["command"], document["bundle"], document["partners"]) == ("observations list", "MAIN", [])
    (point,) = document["observations"]
    wrong = point["photo"]
    rows = [
        row for row in orip(film, "results", "residuals", "P1", "--json").document["residuals"] if row["photo"] == wrong
    ]
    assert point["residual"] == [row["residual"] for row in rows]
    assert point["weight_factor"] == [row["weight_factor"] for row in rows]
    assert point["error"] == [row["a_priori"] for row in rows]
    assert min(point["weight_factor"]) < 1.0
    assert point["rays"] == 2
    # sd of the adjusted observation, by residuals.csv
    lines = [line.split(",") for line in (film / "residuals.csv").read_text().splitlines()]
    column = lines[0].index("adjusted_sd")
    mine = [float(line[column]) for line in lines if line[1:3] == [wrong, "P1"]]
    assert point["sd"] == pytest.approx(mine, rel=1e-12)


def test_list_of_one_photo_one_point_or_all(film: Path) -> None:
    def rows(*words: str) -> list[tuple[str, str]]:
        found = observe(film, "list", "--json", *words).document["observations"]
        return [(observation["photo"], observation["point"]) for observation in found]

    assert len(rows("--all")) == 10
    assert rows("--all", "--point", "P1") == [("left", "P1"), ("right", "P1")]
    assert rows("--all", "--photo", "LEFT", "--point", "2") == [("left", "2")]
    sound = other_than(wrong_photo(film))
    assert rows("--photo", sound) == []
    said = observe(film, "list", "--photo", sound)
    assert "none" in said.out
    assert "--all shows all that is measured" in said.err


def test_list_before_the_first_adjustment(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    refused(folder, 3, "no record stores yet", "list")
    assert orip(folder, "init").code == 0
    refused(folder, 3, "no photo observations yet; run 'orip measure' first", "list")
    assert orip(folder, "measure").code == 0
    refused(folder, 3, "has not been adjusted", "list")
    found = observe(folder, "list", "--all", "--json").document
    assert found["run"] is None
    assert found["observations"][0]["residual"] == [None, None]
    assert "-" in observe(folder, "list", "--all", "--partners").out


def test_list_after_an_edit_says_that_the_adjustment_is_older(film: Path) -> None:
    observe(film, "disregard", "point", "right", "P1")
    said = observe(film, "list", "--all")
    assert "warning: MAIN.EXO: has changed since the last adjustment" in said.err
    assert sum(line.endswith("disregarded") for line in said.out.splitlines()) == 1
    assert observe(film, "list", "--json").document["warnings"][0]["code"] == "out-of-date"


def test_partners_and_where_they_show_the_point(film: Path) -> None:
    document = observe(film, "list", "--partners", "--json").document
    (partner,) = document["partners"]
    sound = other_than(partner["photo"])
    assert (partner["partner"], partner["model"], partner["place"]) == (sound, None, "measured")
    assert partner["log_xy"] == pytest.approx(plate_coordinates(film, sound, "P1"), abs=1e-9)
    assert "Partner" in observe(film, "list", "--partners").out


def test_names_that_the_bundle_does_not_have(film: Path) -> None:
    refused(film, 2, "bundle MAIN has no photo rihgt; did you mean right", "list", "--photo", "rihgt")
    refused(film, 2, "bundle MAIN has no point P11; did you mean P1", "list", "--point", "P11")
    refused(film, 2, "there is no bundle 'X'", "list", "--bundle", "X")


# edits


@pytest.mark.parametrize(
    ("verb", "what", "owner", "name"),
    [("disregard", "mark", "right", "2"), ("include", "tick", "T1", "3"), ("kill", "point", "left", "1")],
)
def test_edit_tells_and_is_repeatable(film: Path, verb: str, what: str, owner: str, name: str) -> None:
    if verb == "include":
        observe(film, "disregard", what, owner, name)
    bundle = "MAIN " if what == "point" else ""
    line = f"{verb.upper()} {what.upper()} {bundle}{owner} {name}"
    sure = ["--yes"] if verb == "kill" else []
    before = contents(film)
    trial = observe(film, verb, what, owner, name, "--dry-run")
    assert trial.code == 0
    assert f"would add {line}" in trial.err
    assert contents(film) == before
    document = observe(film, verb, what, owner, name, "--json", *sure).document
    assert document["added"] == [line]
    assert document["unchanged"] is False
    assert (film / "EDITS.MEA").read_text().splitlines()[-1] == line
    after = contents(film)
    again = observe(film, verb, what, owner, name)
    assert again.code == 0
    assert "unchanged" in again.err
    assert observe(film, verb, what, owner, name, "--json").document["unchanged"] is True
    assert contents(film) == after
    # a replay has nothing to do
    assert "unchanged" in orip(film, "measure").err


def test_edit_reaches_the_adjustment(film: Path) -> None:
    assert "orip solve" in observe(film, "disregard", "point", "*", "P1").err
    assert orip(film, "solve").code == 0
    assert observe(film, "list", "--json").document["observations"] == []
    rows = orip(film, "results", "residuals", "P1", "--json").document["residuals"]
    assert all(row["weight_factor"] is None for row in rows)


def test_kill_names_the_points_that_are_left_with_a_single_ray(film: Path) -> None:
    said = observe(film, "kill", "point", "left", "1", "P1", "--yes")
    assert "point 1 is left with a single ray, in photo right: kill it there too" in said.err
    document = observe(film, "kill", "point", "*", "3", "--yes", "--json").document
    assert document["left_alone"] == [{"bundle": "MAIN", "point": "3", "photos": []}]
    assert "point 4 is left with no ray" in observe(film, "kill", "point", "*", "4", "--yes").err


def test_kill_all_of_a_photo_has_to_be_meant(film: Path) -> None:
    refused(film, 2, "Kill all points of left? Say so with --yes", "kill", "point", "left", "*")
    refused(film, 2, "Kill point 1, P1 of left? Say so with --yes", "kill", "point", "left", "1", "P1")
    refused(film, 2, "Kill all ticks of every template? Say so with --yes", "kill", "tick", "*", "*")
    assert "would add KILL POINT MAIN left *" in observe(film, "kill", "point", "left", "*", "--dry-run").err
    assert observe(film, "kill", "point", "left", "*", "--yes").code == 0
    assert len(observe(film, "list", "--all", "--json").document["observations"]) == 5


def test_kill_all_on_a_terminal_is_asked_for(film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    answers = iter([False, True])

    def confirm(question: str, abort: bool, err: bool) -> None:
        import typer

        assert question == "Kill all points of left?"
        if not next(answers):
            raise typer.Abort

    monkeypatch.setattr("orip.cli.conversion.typer.confirm", confirm)
    before = contents(film)
    assert observe(film, "kill", "point", "left", "*").code == 130
    assert contents(film) == before
    assert observe(film, "kill", "point", "left", "*").code == 0


def test_all_ticks_killed_and_measured_again(film: Path) -> None:
    orip(film, "drive", "table")
    lines = (film / "FIRST.MEA").read_text().splitlines()
    ticks = lines[lines.index(next(line for line in lines if line.startswith("TEMPLATE"))) :][:5]
    said = observe(film, "kill", "tick", "T1", "*", "--yes")
    assert said.code == 0
    assert "added    KILL TICK T1 *" in said.err
    assert "template T1 is no longer oriented: all its marks are killed" in said.err
    assert "TEMPLATE ORIENTATIONS" in (film / "INTERIOR_RESULT.OUT").read_text()
    # points are kept in template coordinates: the adjustment needs no ticks
    assert orip(film, "solve").code == 0
    (film / "again.txt").write_text("\n".join(ticks) + "\n")
    assert observe(film, "remeasure", "again.txt").code == 0
    assert "no longer oriented" not in orip(film, "measure").err


def test_all_marks_of_a_photo_killed(film: Path) -> None:
    said = observe(film, "kill", "mark", "left", "*", "--yes")
    assert said.code == 0
    assert "photo left is no longer oriented: all its marks are killed" in said.err
    said = orip(film, "solve")
    assert said.code == 3
    assert "photo left has photo points but no interior orientation; measure its fiducial marks" in said.err


def test_a_misnamed_point_gets_its_right_name(film: Path) -> None:
    text = (film / "FIRST.MEA").read_text()
    right = text.index("POINTS MAIN right")
    assert orip(film, "solve").code == 0
    expected = orip(film, "results", "points", "P1", "--json").document
    (film / "FIRST.MEA").write_text(text[:right] + text[right:].replace("P1 ", "Q1 "))
    assert orip(film, "measure").code == 0
    before = contents(film)
    trial = observe(film, "rename", "point", "right", "Q1", "P1", "--dry-run")
    assert "would add RENAME POINT MAIN right Q1 P1" in trial.err
    assert contents(film) == before
    assert observe(film, "rename", "point", "right", "Q1", "P1", "--json").document["added"] == [
        "RENAME POINT MAIN right Q1 P1"
    ]
    assert "unchanged" in orip(film, "measure").err
    assert orip(film, "solve").code == 0
    found = orip(film, "results", "points", "P1", "--json").document
    assert {**found, "run": ""} == {**expected, "run": ""}
    refused(film, 3, "point Q1 of bundle MAIN is not measured in photo right", "rename", "point", "right", "Q1", "P1")
    refused(film, 3, "1 is measured there, too; kill one of them", "rename", "point", "right", "P1", "1")
    refused(film, 3, "one point is renamed at a time", "rename", "point", "right", "P1", "*")


def test_edits_that_are_refused(film: Path) -> None:
    refused(film, 3, "photo lfet is not defined; did you mean left?", "kill", "point", "lfet", "1")
    refused(film, 3, "point 9 of bundle MAIN is not measured in photo left", "disregard", "point", "left", "9")
    refused(film, 2, "a mark belongs to no bundle", "disregard", "mark", "left", "1", "--bundle", "MAIN")
    refused(film, 3, "photo left has 2 usable marks", "disregard", "mark", "left", "1", "2")
    assert observe(film, "disregard", "line", "left", "1").code == 2
    assert observe(film, "disregard", "point", "left").code == 2


def test_bundle_has_to_be_named_where_there_are_several(tmp_path: Path) -> None:
    folder = two_bundles(tmp_path / "two")
    assert orip(folder, "init").code == orip(folder, "measure").code == 0
    refused(folder, 2, "the project has 2 bundles; name one of them", "disregard", "point", "left", "1")
    said = observe(folder, "disregard", "point", "left", "1", "--bundle", "again")
    assert "added    DISREGARD POINT AGAIN left 1" in said.err
    listed = observe(folder, "list", "--all", "--bundle", "MAIN", "--json").document["observations"]
    assert not any(observation["disregarded"] for observation in listed)


def test_project_without_stores(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    refused(folder, 3, "no record stores yet", "kill", "point", "left", "1")
    refused(folder, 3, "no record stores yet", "todo")


# todo and remeasure


def test_todo_on_stdout_and_in_a_file(film: Path) -> None:
    said = observe(film, "todo")
    assert said.code == 0
    title, head, *rest = said.out.splitlines()
    assert title == "! Project FIRST"
    assert head.startswith("! To measure again, bundle MAIN, after adjustment ")
    assert rest[-2] == f"POINTS MAIN {wrong_photo(film)}"
    assert rest[-1].startswith("  P1  ! down-weighted, residual ")
    assert observe(film, "todo").out == said.out
    assert observe(film, "todo", "--output", "again.txt").out == ""
    assert (film / "again.txt").read_text() == said.out
    refused(film, 2, "again.txt already exists", "todo", "--output", "again.txt")
    assert observe(film, "todo", "--output", "again.txt", "--force").code == 0
    document = observe(film, "todo", "--json").document
    assert [(point["photo"], point["point"], point["why"]) for point in document["points"]] == [
        (wrong_photo(film), "P1", "down-weighted")
    ]
    assert document["file"] is None


def test_todo_under_a_name_that_would_be_replayed_warns(film: Path) -> None:
    said = observe(film, "todo", "--output", "AGAIN.MEA")
    assert "warning: AGAIN.MEA: its name matches measurement_files" in said.err
    assert orip(film, "measure").code == 3


def test_nothing_to_measure_again(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    assert orip(folder, "run").code == 0
    assert observe(folder, "todo").out.splitlines()[1].startswith("! Nothing to measure again, bundle MAIN")


def test_point_measured_again_fits(film: Path) -> None:
    x, y = plate_coordinates(film, "left", "P1")
    # the film lies turned by 0.7 degrees
    x, y = x + BLUNDER * 0.0122, y - BLUNDER * 0.99993
    (film / "again.txt").write_text(f"POINTS MAIN left\n P1 {x} {y}\n")
    trial = observe(film, "remeasure", "again.txt", "--dry-run")
    assert "would add 3 lines to EDITS.MEA" in trial.err
    assert not (film / "EDITS.MEA").exists()
    assert observe(film, "remeasure", "again.txt").code == 0
    assert orip(film, "solve").code == 0
    assert observe(film, "list", "--json").document["observations"] == []
    document = observe(film, "remeasure", "again.txt", "--json").document
    assert document["unchanged"] is True


def test_file_that_cannot_be_measured_again_from(film: Path) -> None:
    (film / "empty.txt").write_text("! nothing\n")
    (film / "wrong.txt").write_text("POINTS MAIN lift\n P1 1 2\n")
    refused(film, 3, "there are no measurements in this file", "remeasure", "empty.txt")
    refused(film, 3, "photo lift is not defined", "remeasure", "wrong.txt")
    refused(film, 3, "there is no such file", "remeasure", "missing.txt")
    observe(film, "disregard", "point", "left", "1")
    refused(film, 3, "this is EDITS.MEA itself", "remeasure", "EDITS.MEA")


def test_a_point_gets_other_coordinates_by_a_correction_that_replays(film: Path) -> None:
    """The solution is that of a measurement file in which the coordinates have been changed by hand."""
    text = (film / "FIRST.MEA").read_text()
    right = text.index("POINTS MAIN right")
    line = next(line for line in text[right:].splitlines() if line.split()[:1] == ["P1"])
    name, x, y, *rest = line.split()
    by_hand = f"  {name} {float(x) + 0.01:.4f} {float(y) - 0.02:.4f} {' '.join(rest)}"
    (film / "FIRST.MEA").write_text(text[:right] + text[right:].replace(line, by_hand))
    assert orip(film, "measure").code == 0
    assert orip(film, "solve").code == 0
    expected = orip(film, "results", "points", "--json").document
    (film / "FIRST.MEA").write_text(text)
    assert orip(film, "measure").code == 0
    words = [f"x={float(x) + 0.01:.4f}", f"y={float(y) - 0.02:.4f}"]
    before = contents(film)
    assert "would add" in observe(film, "edit", "point", "right", "P1", *words, "--dry-run").err
    assert contents(film) == before
    added = observe(film, "edit", "point", "right", "P1", *words, "--json").document["added"]
    assert added[:2] == ["KILL POINT MAIN right P1", "POINTS MAIN right"]
    assert "unchanged" in orip(film, "measure").err
    assert orip(film, "solve").code == 0
    found = orip(film, "results", "points", "--json").document["points"]
    for name, point in expected["points"].items():
        for axis in "XYZ":
            assert found[name][axis]["value"] == pytest.approx(point[axis]["value"], abs=1e-9)


def test_a_disregarded_point_stays_so_when_it_is_corrected(film: Path) -> None:
    assert observe(film, "disregard", "point", "right", "P1").code == 0
    assert observe(film, "edit", "point", "right", "P1", "x=1.5", "y=-2.5").code == 0
    edits = (film / "EDITS.MEA").read_text().splitlines()
    assert edits[-1].split() == ["P1", "1.5000", "-2.5000", "-"]
    assert observe(film, "include", "point", "right", "P1").code == 0


@pytest.mark.parametrize(
    ("code", "words", "given"),
    [
        (2, "give x=... and y=... together", ["P1", "x=1"]),
        (2, "corrects nothing", ["P1", "z=1"]),
        (2, "is no coordinate", ["P1", "x=a", "y=1"]),
        (2, "one point in one photo", ["*", "x=1", "y=1"]),
        (3, "is not measured in photo right", ["NONE", "x=1", "y=1"]),
        (3, "1 is measured there, too", ["P1", "x=1", "y=1", "name=1"]),
    ],
)
def test_corrections_that_are_refused(film: Path, code: int, words: str, given: list[str]) -> None:
    refused(film, code, words, "edit", "point", "right", *given)
