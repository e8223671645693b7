"""`orip drive table`: what it writes and says, and what it refuses."""

from __future__ import annotations

import pytest
from cli.command_line import orip
from link.served import served
from support.driven_projects import add_models
from workflow.small_projects import contents, film_project, first_project, replace_in

from orip.multimodel.link.station import bare_stages
from orip.multimodel.table_step import load_drive_table

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


def test_photos_without_models_are_driven_one_by_one(tmp_path):
    """The plate goes to where the point was measured in the photo, to a pixel (its a-priori error is half of one); the
    mark keeps its height, and the photo changes where the point leaves its frame."""
    folder = run(first_project(tmp_path / "first"))
    said = orip(folder, "drive", "table")
    assert said.code == 0
    assert [model.left for model in table_in(folder).models] == ["LEFT", "RIGHT"]
    x, y, z = (orip(folder, "results", "points", "--json").document["points"]["P1"][axis]["value"] for axis in "XYZ")
    xyz = [str(value) for value in (x, y, z)]
    with served(bare_stages()) as port:
        link = ("--link", f"tcp://127.0.0.1:{port}")
        assert orip(folder, "drive", "download", *link).code == 0
        driven = orip(folder, "drive", "goto", *xyz, *link, "--json").document
        assert (driven["model"], driven["condition"]) == ("LEFT", "IN")
        assert driven["upper"] == pytest.approx([3733.5, 1844.9], abs=1.0)
        assert orip(folder, "drive", "move", "2", "0", "0", *link).code == 0
        where = orip(folder, "drive", "where", *link, "--json").document
        assert where["ground"] == pytest.approx([x + 2.0, y, z], abs=2e-4)
        assert where["photos"]["right"]["photo"] == "LEFT-EMPTY"
        driven = orip(folder, "drive", "model", "right", *link, "--json").document
        assert driven["model"] == "RIGHT"
        orip(folder, "drive", "goto", *xyz, *link)
        assert orip(folder, "drive", "where", *link, "--json").document["upper"] == pytest.approx(
            [2285.9, 1787.6], abs=1.0
        )


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
    assert "model M2 is not in the drive table: photo third is not in the solution" in said.err
    assert "1 model" in said.err


def test_no_model_is_left(folder):
    replace_in(folder / "orip.toml", "[[bundle]]", '[[photo]]\nname = "third"\ncamera = "C35"\n[[bundle]]')
    replace_in(folder / "orip.toml", 'right = "right"', 'right = "third"')
    run(folder)
    refused(folder, "no model of bundle MAIN has both its photos adjusted and with an interior orientation")


def test_a_new_orientation_of_the_film_needs_no_new_adjustment(tmp_path):
    """The photo is mounted again 5 mm to the right: the table follows, the adjustment stays."""
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
    (folder / "MAIN.DRV").write_text("ORIPDRIVE 3\n")
    assert "out of date" in status_of_table(folder)
    assert orip(folder, "drive", "table").code == 0
    assert "up to date" in status_of_table(folder)


def status_of_table(folder):
    said = orip(folder, "status", "--json").document
    return next(step["state"] for step in said["steps"] if step["command"] == "orip drive table")
