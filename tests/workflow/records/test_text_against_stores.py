"""orip.toml against records that were changed in the stores: who wins, and that nothing is undone in silence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from workflow.commands import initialise, project_status
from workflow.quiet import run_quietly
from workflow.small_projects import contents, first_project, replace_in

from orip.errors import InputError
from orip.files.stores.contents.stores import CAMERAS, PHOTOS, read_bundles
from orip.files.stores.transaction import reading, writing
from orip.records.camera import Camera
from orip.records.photo import Photo
from orip.structs import replace

LENGTHENED = "c = 35.2"


pytestmark = pytest.mark.usefixtures("initialised")


def edit_camera(folder: Path, change: Callable[[Camera], Camera]) -> None:
    """Change all cameras in the store, as a command that edits records does: what the text was is remembered."""
    _edit(folder / "CAMERAS.CAM", CAMERAS, change)


def edit_photos(folder: Path, change: Callable[[Photo], Photo]) -> None:
    """Change all photos in the store."""
    _edit(folder / "FIRST.PHO", PHOTOS, change)


def _edit(path: Path, tables: Any, change: Callable[[Any], Any]) -> None:
    with writing([path]) as stores:
        tables.write(
            stores[path], [replace(stored, record=change(stored.record)) for stored in tables.read(stores[path])]
        )


def with_c(value: float) -> Callable[[Camera], Camera]:
    return lambda camera: replace(camera, parameters=(value, *camera.parameters[1:]))


def stored_c(folder: Path) -> dict[str, float]:
    with reading([folder / "CAMERAS.CAM"]) as stores:
        return {
            stored.record.name: stored.record.parameters[0] for stored in CAMERAS.read(stores[folder / "CAMERAS.CAM"])
        }


def actions(folder: Path, prefer: Any = None) -> set[tuple[str, str, str]]:
    return {(change.kind, change.name, change.action) for change in initialise(folder, prefer).changes}


def conflict(folder: Path) -> str:
    """Return the only conflict of `orip init`, which changes nothing."""
    before = contents(folder)
    with pytest.raises(InputError) as caught:
        initialise(folder)
    assert contents(folder) == before
    assert caught.value.exit_code == 3
    (complaint,) = caught.value.complaints
    return str(complaint)


def test_what_changed_in_the_store_alone_stays(project: Path) -> None:
    edit_camera(project, with_c(35.7))
    assert actions(project) == set()
    run_quietly(project)
    assert stored_c(project) == {"C35": 35.7}
    replace_in(project / "orip.toml", 'name = "FIRST"', 'name = "FIRST", user = "me"')  # the camera's text is the same
    run_quietly(project)
    assert stored_c(project) == {"C35": 35.7}


def test_what_changed_in_the_text_alone_is_applied(project: Path) -> None:
    replace_in(project / "orip.toml", "c = 35.0", LENGTHENED)
    assert actions(project) == {("camera", "C35", "changed")}
    assert stored_c(project) == {"C35": 35.2}
    assert actions(project) == set()


def test_changed_in_both_shows_both_values(project: Path) -> None:
    edit_camera(project, with_c(35.7))
    replace_in(project / "orip.toml", "c = 35.0", LENGTHENED)
    message = conflict(project)
    assert message.startswith("orip.toml:2: camera C35 was changed both in the text and in the store: ")
    assert "C is 35.2 in the text and 35.7 in the store; keep one of them with 'orip init --prefer text'" in message
    assert "changed both in orip.toml and in the stores: 1 of the records" in project_status(project).steps[0].text


@pytest.mark.parametrize(
    ("prefer", "value", "done"), [("text", 35.2, {("camera", "C35", "changed")}), ("store", 35.7, set())]
)
def test_prefer_decides_once_and_for_all(project: Path, prefer: str, value: float, done: set[Any]) -> None:
    edit_camera(project, with_c(35.7))
    replace_in(project / "orip.toml", "c = 35.0", LENGTHENED)
    assert actions(project, prefer) == done
    assert stored_c(project) == {"C35": value}
    assert actions(project) == set(), "the next 'orip run' does not ask again"
    replace_in(project / "orip.toml", LENGTHENED, "c = 36.0")
    if prefer == "text":
        assert actions(project) == {("camera", "C35", "changed")}
    else:
        assert "C is 36.0 in the text and 35.7 in the store" in conflict(project)


def test_changed_alike_in_both_is_no_conflict(project: Path) -> None:
    edit_camera(project, with_c(35.2))
    replace_in(project / "orip.toml", "c = 35.0", LENGTHENED)
    assert actions(project) == set()
    replace_in(project / "orip.toml", LENGTHENED, "c = 36.0")
    assert actions(project) == {("camera", "C35", "changed")}


def test_all_conflicts_are_told_at_once(project: Path) -> None:
    edit_camera(project, with_c(35.7))
    edit_photos(project, lambda photo: replace(photo, orientation=(1.0, *photo.orientation[1:])))
    for old, new in (("c = 35.0", LENGTHENED), ("X0 = 1070.0", "X0 = 2.0"), ("X0 = 1130.0", "X0 = 3.0")):
        replace_in(project / "orip.toml", old, new)
    replace_in(project / "FIRST.PNT", "1012.40", "east")
    with pytest.raises(InputError) as caught:
        initialise(project)
    told = "\n".join(map(str, caught.value.complaints))
    assert "X0 is 2.0 in the text and 1.0 in the store" in told
    assert "X0 is 3.0 in the text and 1.0 in the store" in told
    assert "FIRST.PNT:1:" in told
    assert len(caught.value.complaints) == 4


def remove_photo(folder: Path) -> None:
    """Take the photo 'right' out of all texts."""
    text = (folder / "orip.toml").read_text()
    start, end = text.index('[[photo]]\nname = "right"'), text.index("[[bundle]]")
    (folder / "orip.toml").write_text(text[:start] + text[end:])
    log = (folder / "FIRST.MEA").read_text()
    (folder / "FIRST.MEA").write_text(log[: log.index("POINTS MAIN right")])


def test_a_record_gone_from_the_text_goes(project: Path) -> None:
    remove_photo(project)
    assert actions(project) == {("photo", "right", "removed")}
    assert actions(project) == set()


def test_a_record_gone_from_the_text_but_edited_is_a_conflict(project: Path) -> None:
    edit_photos(project, lambda photo: replace(photo, constant=("X0",)))
    remove_photo(project)
    assert "photo right was removed from the text but was changed in the store" in conflict(project)
    assert actions(project, "store") == {("photo", "right", "detached")}
    assert actions(project) == set()


def test_prefer_text_removes_an_edited_record(project: Path) -> None:
    edit_photos(project, lambda photo: replace(photo, constant=("X0",)))
    remove_photo(project)
    assert actions(project, "text") == {("photo", "right", "removed")}


def test_a_record_that_is_in_the_store_alone_stays(project: Path) -> None:
    with writing([project / "FIRST.PHO"]) as stores:
        store = stores[project / "FIRST.PHO"]
        known = PHOTOS.read(store)
        PHOTOS.write(store, [*known, replace(known[0], record=replace(known[0].record, name="own"), text_digest=None)])
    assert actions(project) == set()
    with reading([project / "FIRST.PHO"]) as stores:
        assert [stored.record.name for stored in PHOTOS.read(stores[project / "FIRST.PHO"])] == ["left", "right", "own"]


def test_renamed_in_case_alone(project: Path) -> None:
    replace_in(project / "orip.toml", '"left"', '"LEFT"')
    assert actions(project) == {("photo", "LEFT", "changed")}
    run_quietly(project)
    with reading([project / "FIRST.PHO"]) as stores:
        assert [stored.record.name for stored in PHOTOS.read(stores[project / "FIRST.PHO"])] == ["LEFT", "right"]


def test_bundles_too(project: Path) -> None:
    replace_in(project / "orip.toml", '"0.5px"', "0.004")
    assert actions(project) == {("bundle", "MAIN", "changed")}
    with reading([project / "FIRST.EXT"]) as stores:
        (bundle,) = read_bundles(stores[project / "FIRST.EXT"])
    assert bundle.record.measurement_precision.value == 0.004


# cameras shared by two projects


@pytest.fixture
def neighbour(project: Path) -> Path:
    """Return a second project, which uses the cameras of the first."""
    folder = first_project(project.parent / "second")
    replace_in(
        folder / "orip.toml", '"FIRST" }', '"SECOND", camera_file = "../first/CAMERAS.CAM", control_files = "FIRST" }'
    )
    return folder


def test_the_same_camera_in_two_projects(project: Path, neighbour: Path) -> None:
    assert ("camera", "C35", "added") not in actions(neighbour)
    before = contents(project)
    for folder in (project, neighbour, project, neighbour):
        assert actions(folder) == set()
    assert contents(project) == before, "two projects that agree take nothing from each other"
    run_quietly(project)
    run_quietly(neighbour)


def test_another_project_does_not_change_a_camera_in_silence(project: Path, neighbour: Path) -> None:
    replace_in(neighbour / "orip.toml", "c = 35.0", LENGTHENED)
    assert "camera C35 comes from project FIRST: C is 35.2 in the text and 35.0 in the store" in conflict(neighbour)
    initialise(neighbour, "text")
    assert stored_c(project) == {"C35": 35.2}
    assert "camera C35 comes from project SECOND" in conflict(project)
    initialise(project, "store")
    assert stored_c(project) == {"C35": 35.2}
    assert actions(project) == set()


def test_a_camera_gone_from_one_text_stays_for_the_others(project: Path, neighbour: Path) -> None:
    replace_in(neighbour / "orip.toml", '[[camera]]\nname = "C35"', '[[camera]]\nname = "OTHER"')
    replace_in(neighbour / "orip.toml", 'camera = "C35"', 'camera = "OTHER"')
    assert ("camera", "OTHER", "added") in actions(neighbour)
    assert stored_c(project) == {"C35": 35.0, "OTHER": 35.0}
    replace_in(neighbour / "orip.toml", '"OTHER"', '"THIRD"')
    assert {("camera", "THIRD", "added"), ("camera", "OTHER", "detached")} <= actions(neighbour)
    assert stored_c(project) == {"C35": 35.0, "OTHER": 35.0, "THIRD": 35.0}
    assert actions(project) == set()
