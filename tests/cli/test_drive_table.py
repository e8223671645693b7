"""`orip drive table`: what it writes and says, and what it refuses."""

from __future__ import annotations

import pytest
from cli.command_line import orip
from support.driven_projects import add_models
from workflow.small_projects import contents, film_project, first_project, replace_in

from orip.workflow.drive.table import load_drive_table

MODEL = ("M1", "left", "right", 1, 1)


@pytest.fixture
def folder(tmp_path):
    return add_models(first_project(tmp_path / "first"), [MODEL])


def run(folder):
    said = orip(folder, "run")
    assert said.code == 0, said.err
    return folder


def table_in(folder):
    """Return the table that was written, with all cross checks."""
    return load_drive_table((folder / "MAIN.DRV").read_bytes()).block.table


def refused(folder, *texts):
    """Check that the command ends with 3, says so, and writes nothing."""
    before = contents(folder)
    said = orip(folder, "drive", "table")
    assert said.code == 3
    assert said.out == ""
    for text in texts:
        assert text in said.err
    assert contents(folder) == before


def test_it_writes_the_table_once(folder):
    said = orip(folder, "run")
    assert "wrote    MAIN.DRV: 1 camera, 2 photos, 1 model" in said.err
    (folder / "MAIN.DRV").unlink()
    said = orip(folder, "drive", "table")
    assert (said.code, said.out) == (0, "")
    assert "wrote    MAIN.DRV: 1 camera, 2 photos, 1 model" in said.err
    data = (folder / "MAIN.DRV").read_bytes()
    table = table_in(folder)
    assert (table.block, table.project, table.plate_unit, table.object_unit) == ("MAIN", "FIRST", "px", "m")
    assert [photo.name for photo in table.photos] == ["LEFT", "RIGHT"]
    again = orip(folder, "drive", "table", "main")
    assert "kept     MAIN.DRV" in again.err
    assert (folder / "MAIN.DRV").read_bytes() == data


def test_json(folder):
    run(folder)
    (folder / "MAIN.DRV").unlink()
    document = orip(folder, "drive", "table", "--json").document
    assert document["file"] == "MAIN.DRV"
    assert document["changed"] is True
    assert (document["cameras"], document["photos"], document["models"]) == (1, 2, 1)
    assert document["start"] == pytest.approx([1097.0, 2075.0, 103.7], abs=3.0)  # the middle of the control
    assert document["warnings"] == []


def test_before_the_adjustment(folder):
    refused(folder, "run 'orip init' first")
    assert orip(folder, "init").code == 0
    refused(folder, "bundle MAIN has not been adjusted yet; run 'orip solve' first")


def test_without_models(tmp_path):
    folder = run(first_project(tmp_path / "first"))
    refused(folder, "bundle MAIN has no models to drive in; define them as [[bundle.model]]")


def test_both_photos_on_one_stage(folder):
    for name in ("left", "right"):
        replace_in(folder / "orip.toml", f'name = "{name}"\ncamera', f'name = "{name}"\nstage = "UPPER"\ncamera')
    run(folder)
    refused(folder, "photos left and right of model M1 are both on the UPPER stage; set the stages")


def test_stages_that_are_set_stay(folder):
    replace_in(folder / "orip.toml", 'name = "left"\ncamera', 'name = "left"\nstage = "LOWER"\ncamera')
    run(folder)
    assert orip(folder, "drive", "table").code == 0
    table = table_in(folder)
    assert [photo.stage for photo in table.photos] == ["LOWER", "UPPER"]
    assert table.models[0].optics == "SWAPPED"


def test_names_that_are_not_ascii(folder):
    replace_in(folder / "orip.toml", 'name = "M1"', 'name = "Süd"')
    replace_in(
        folder / "orip.toml", 'name = "FIRST" }', 'name = "FÜRST", project_files = "FIRST", control_files = "FIRST" }'
    )
    run(folder)
    refused(folder, "model Süd: 'SÜD' has a letter that is not ASCII", "the project name 'FÜRST'")


def test_a_photo_that_was_not_adjusted_takes_its_models_out(folder):
    replace_in(folder / "orip.toml", "[[bundle]]", '[[photo]]\nname = "third"\ncamera = "C35"\n[[bundle]]')
    add_models(folder, [("M2", "right", "third", 1, 2)])
    run(folder)
    said = orip(folder, "drive", "table")
    assert said.code == 0
    assert "model M2: is not in the drive table: photo third is not in the solution" in said.err
    assert "1 model" in said.err


def test_no_model_is_left(folder):
    replace_in(folder / "orip.toml", "[[bundle]]", '[[photo]]\nname = "third"\ncamera = "C35"\n[[bundle]]')
    replace_in(folder / "orip.toml", 'right = "right"', 'right = "third"')
    run(folder)
    refused(folder, "no model of bundle MAIN has both its photos adjusted and with an interior orientation")


def test_a_new_orientation_of_the_film_needs_no_new_adjustment(tmp_path):
    """The photo is mounted anew 5 mm to the right: the table follows, the adjustment stays."""
    folder = run(add_models(film_project(tmp_path / "film"), [MODEL]))
    assert orip(folder, "drive", "table").code == 0
    before = table_in(folder)
    marks = {"1": (87.0, 88.0), "2": (123.0, 88.0), "3": (123.0, 112.0), "4": (87.0, 112.0)}
    lines = ["PHOTO left A", *(f"  {name} {x} {y}" for name, (x, y) in marks.items())]
    (folder / "LATER.MEA").write_text("\n".join(lines) + "\n")
    assert orip(folder, "measure").code == 0
    said = orip(folder, "drive", "table")
    assert said.code == 0
    after = table_in(folder)
    assert after.photos[0].affine[0] == pytest.approx(before.photos[0].affine[0] + 5.0, abs=1e-6)
    assert after.photos[0].centre == before.photos[0].centre
    assert after.photos[1] == before.photos[1]


def test_a_changed_camera_makes_the_adjustment_stale(folder):
    run(folder)
    replace_in(folder / "orip.toml", "c = 35.0", "c = 35.1")
    assert orip(folder, "init").code == 0
    said = orip(folder, "drive", "table")
    assert said.code == 0
    assert "bundle MAIN: was adjusted before the stores changed; run 'orip solve'" in said.err


def test_films_and_digital_frames_have_no_common_unit(folder):
    camera = '[[camera]]\nname = "FILM"\nc = 35.0\n[[photo]]\nname = "right"\ncamera = "FILM"'
    replace_in(folder / "orip.toml", '[[photo]]\nname = "right"\ncamera = "C35"', camera)
    replace_in(folder / "orip.toml", 'measurement_precision = "0.5px"', "measurement_precision = 0.003")
    lines, right = [], False
    for line in (folder / "FIRST.MEA").read_text().splitlines():
        right = line.endswith(" right") if line.startswith("POINTS") else right
        if right and not line.startswith("POINTS"):
            name, column, row = line.split()
            line = f"{name} {(float(column) - 3000) * 0.006:.4f} {-(float(row) - 2000) * 0.006:.4f}"  # noqa: PLW2901
        lines.append(line)
    (folder / "FIRST.MEA").write_text("\n".join(lines) + "\n")
    run(folder)
    refused(folder, "digital frames (left) are driven in pixels, films in millimetres")


def test_help_names_the_command(tmp_path):
    said = orip(tmp_path, "drive", "--help")
    assert said.code == 0
    assert "table" in said.out


def test_status_says_when_the_table_is_old(folder):
    run(folder)
    assert "up to date" in status_of_table(folder)
    (folder / "MAIN.DRV").write_text("ORIPDRIVE 1\n")
    assert "out of date" in status_of_table(folder)
    assert orip(folder, "drive", "table").code == 0
    assert "up to date" in status_of_table(folder)


def status_of_table(folder):
    said = orip(folder, "status", "--json").document
    return next(step["state"] for step in said["steps"] if step["command"] == "orip drive table")
