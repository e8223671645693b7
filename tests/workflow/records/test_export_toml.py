"""`orip export-toml` and `orip init`: from the stores into the text and back, without loss."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli.command_line import orip
from files.any_project import project_definitions
from hypothesis import given, settings
from workflow.commands import add_record, delete_record, edit_record, export_toml, initialise, rename_record
from workflow.small_projects import contents, film_project, first_project, replace_in

from orip.errors import InputError, UsageError
from orip.files.project.records import project_document, project_text
from orip.files.stores.contents.stores import CAMERAS
from orip.files.stores.digest import record_digest
from orip.files.stores.dump import dump
from orip.files.stores.transaction import reading
from orip.records.definition import ProjectDefinition
from orip.workflow.project.definitions import StoredDefinitions, read_definitions
from orip.workflow.project.folder import open_project
from orip.workflow.records.edits import RecordName

pytestmark = pytest.mark.usefixtures("initialised")


def stored(folder: Path) -> StoredDefinitions:
    project = open_project(folder)
    with reading(project.record_stores) as stores:
        return read_definitions(project, stores)


def records(folder: Path) -> list[object]:
    found = stored(folder)
    kinds = (found.cameras, found.temticks, found.templates, found.photos, found.bundles)
    return [[stored.record for stored in kind] for kind in kinds]


def reconciled(folder: Path) -> bool:
    """Tell whether every record of the stores is bound to the text, as it is there."""
    found = stored(folder)
    kinds = (found.cameras, found.temticks, found.templates, found.photos, found.bundles)
    return all(stored.text_digest == record_digest(stored.record) for kind in kinds for stored in kind)


def export_and_init(folder: Path) -> None:
    """Bring the stores into the text, and the text into the stores, which changes no record."""
    before = records(folder)
    assert export_toml(folder, Path("orip.toml"), force=True).changed
    outcome = initialise(folder)
    assert outcome.changes == ()
    assert records(folder) == before
    assert reconciled(folder)
    exported = contents(folder)
    assert not export_toml(folder, Path("orip.toml")).changed
    assert contents(folder) == exported


@given(project_definitions())
@settings(max_examples=8, deadline=None)
def test_any_stores_exported_and_applied_are_the_same(
    tmp_path_factory: pytest.TempPathFactory, definition: ProjectDefinition
) -> None:
    folder = tmp_path_factory.mktemp("project")
    text = project_text(project_document(definition))
    (folder / "orip.toml").write_text(text, encoding="utf-8")
    initialise(folder)
    if not any((definition.cameras, definition.temticks, definition.bundles)):
        with pytest.raises(InputError, match="no record stores yet"):
            export_toml(folder)
        return
    # a project file that says nothing of the records: all of them come from the stores
    heading = text.split("\n[[")[0]
    (folder / "orip.toml").write_text(heading, encoding="utf-8")
    stores = {name: list(dump(folder / name)) for name in contents(folder) if name != "orip.toml"}
    found = export_toml(folder, Path("orip.toml"), force=True)
    assert found.changed
    assert open_project(folder).definition == definition
    assert initialise(folder).changes == ()
    assert {name: list(dump(folder / name)) for name in stores} == stores
    shutil.rmtree(folder)


def test_records_edited_in_the_stores(project: Path) -> None:
    replace_in(project / "FIRST.MEA", "MAIN left", "MAIN west")
    edit_record(project, RecordName("camera", "C35"), ["c=35.1", "unknown=C"])
    rename_record(project, RecordName("photo", "left"), "west")
    add_record(project, RecordName("temtick", "GRID"), ["ticks.1={x=1.5,y=2}"])
    add_record(project, RecordName("template", "T"), ["temtick=GRID"])
    add_record(project, RecordName("model", "M"), ["left=west", "right=right", "row=1", "column=1"])
    export_and_init(project)


def test_a_record_deleted_in_the_store_leaves_the_text(project: Path) -> None:
    (project / "FIRST.MEA").unlink()
    delete_record(project, RecordName("photo", "left"), with_referents=True)
    warnings = export_toml(project).warnings
    assert [str(warning) for warning in warnings] == [
        "orip.toml:6: photo left is in the text, but not in the stores: it is not exported"
    ]
    export_and_init(project)
    assert '"left"' not in (project / "orip.toml").read_text()


@pytest.mark.parametrize(
    "form", ["distortion_isp={R0=10.0, A1=1e-4}", "distortion_curve=[[5,0.01],[9,0.02],[12,0.05],[15,0.1]]"]
)
def test_the_given_form_of_a_distortion_is_kept(project: Path, form: str) -> None:
    edit_record(project, RecordName("camera", "C35"), [form])
    export_and_init(project)
    assert form.partition("=")[0] in (project / "orip.toml").read_text()


def test_a_form_that_is_not_what_the_polynomial_is_goes(project: Path) -> None:
    edit_record(project, RecordName("camera", "C35"), ["distortion_isp={R0=10.0, A1=1e-4}"])
    lines = list(dump(project / "CAMERAS.CAM"))
    (project / "dump.txt").write_text("\n".join(lines).replace(", 0.0001, ", ", 0.0002, ", 1) + "\n")
    assert orip(project, "load", "CAMERAS.CAM", "dump.txt").code == 0
    (project / "dump.txt").unlink()
    (camera,) = stored(project).cameras
    assert camera.record.parameters[4] == 0.0002
    text = export_toml(project).text
    assert "distortion_isp" not in text
    assert "distortion = { A1 = -0.01, A3 = 0.0002 }" in text


def test_text_that_was_not_applied_is_warned_of(project: Path) -> None:
    replace_in(project / "orip.toml", "X0 = 1070.0", "X0 = 1.0")
    edit_record(project, RecordName("camera", "C35"), ["c=35.1"])
    replace_in(project / "orip.toml", "c = 35.0", "c = 35.2")
    text = (project / "orip.toml").read_text()
    start = text.index('[[photo]]\nname = "right"')
    (project / "orip.toml").write_text(text[:start] + text[text.index("[[bundle]]") :])
    found = export_toml(project)
    assert [str(warning) for warning in found.warnings] == [
        "orip.toml:6: photo left has changed in the text, which was not applied: the store's version is exported",
        "orip.toml: photo right was removed from the text, but still in the stores: it is exported",
        "orip.toml:2: camera C35 was changed both in the text and in the store: the store's version is exported",
    ]
    assert "c = 35.1" in found.text
    export_and_init(project)


def test_cameras_of_other_projects_are_left_out(project: Path) -> None:
    neighbour = first_project(project.parent / "second")
    heading = '"FIRST" }', '"SECOND", camera_file = "../first/CAMERAS.CAM", control_files = "FIRST" }'
    replace_in(neighbour / "orip.toml", *heading)
    replace_in(neighbour / "orip.toml", '"C35"', '"C36"')
    initialise(neighbour)
    edit_record(project, RecordName("camera", "C35"), ["c=35.1"])
    assert "C36" not in export_toml(project).text
    edit_record(project, RecordName("photo", "left"), ["camera=C36"])
    assert '"C36"' in export_toml(project).text
    with reading([project / "CAMERAS.CAM"]) as stores:
        origins = {stored.record.name: stored.origin for stored in CAMERAS.read(stores[project / "CAMERAS.CAM"])}
    assert origins == {"C35": "FIRST", "C36": "SECOND"}


def test_what_is_in_the_way_is_kept(project: Path) -> None:
    edit_record(project, RecordName("camera", "C35"), ["c=35.1"])
    before = contents(project)
    with pytest.raises(UsageError, match=r"orip\.toml already exists with another text; write over it with --force"):
        export_toml(project, Path("orip.toml"))
    assert contents(project) == before
    for number in (1, 2):
        old = (project / "orip.toml").read_bytes()
        found = export_toml(project, Path("orip.toml"), force=True)
        assert found.backup is not None
        assert found.backup.name == f"orip.toml.bak{number if number > 1 else ''}"
        assert found.backup.read_bytes() == old
        edit_record(project, RecordName("camera", "C35"), ["c=35.3"])
    assert "# principal distance, mm" in (project / "orip.toml").read_text()


def test_stores_that_no_text_can_say(project: Path) -> None:
    lines = "\n".join(dump(project / "FIRST.PHO")).replace('"C35"', '"C99"')
    (project / "dump.txt").write_text(lines + "\n")
    assert orip(project, "load", "FIRST.PHO", "dump.txt").code == 0
    with pytest.raises(InputError, match=r"the stores hold records that orip\.toml may not have: photo 'left' names"):
        export_toml(project)


# the command


def test_to_stdout_to_a_file_and_in_json(project: Path) -> None:
    text = (project / "orip.toml").read_text()
    said = orip(project, "export-toml")
    assert (said.code, said.out, said.err) == (0, text, "")
    said = orip(project, "export-toml", "--output", "other.toml", "--json")
    assert said.document["file"] == "other.toml"
    assert said.document["unchanged"] is False
    assert (project / "other.toml").read_text() == text
    said = orip(project, "export-toml", "-o", "orip.toml")
    assert "unchanged: orip.toml says what the stores hold" in said.err
    assert orip(project, "export-toml", "-o", "orip.toml", "--json").document["unchanged"] is True
    (project / "other.toml").write_text("mine")
    assert orip(project, "export-toml", "-o", "other.toml").code == 2
    said = orip(project, "export-toml", "-o", "other.toml", "--force")
    assert "kept     the old text as other.toml.bak" in said.err
    said = orip(project, "export-toml", "-o", "nowhere/other.toml")
    assert said.code == 1
    assert "nowhere/other.toml cannot be written: there is no such folder; the file is unchanged" in said.err


def test_before_init_there_is_nothing_to_export(tmp_path: Path) -> None:
    said = orip(film_project(tmp_path / "film"), "export-toml")
    assert said.code == 3
    assert "no record stores yet; run 'orip init' first" in said.err


def test_the_same_text_is_kept_once(tmp_path: Path) -> None:
    """As after a run that was killed between the copy and the new text."""
    folder = first_project(tmp_path / "first")
    assert orip(folder, "run", "--no-report").code == 0
    before = (folder / "orip.toml").read_bytes()
    (folder / "orip.toml.bak").write_bytes(before)
    assert orip(folder, "photo", "edit", "left", "X0=1071").code == 0
    assert orip(folder, "export-toml", "--output", "orip.toml", "--force").code == 0
    assert (folder / "orip.toml.bak").read_bytes() == before
    assert not (folder / "orip.toml.bak2").exists()
