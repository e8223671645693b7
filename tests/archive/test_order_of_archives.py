"""In which order the projects of an archive are adjusted."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from workflow.small_projects import first_project

from orip.archive.run import ArchiveProject, find_projects, in_order
from orip.errors import UsageError


def order(*projects: ArchiveProject) -> dict[str, tuple[str, ...]]:
    return {project.name: waits for project, waits in in_order(projects)}


def test_projects_wait_for_the_one_in_whose_folder_the_cameras_are() -> None:
    found = order(
        ArchiveProject("a", "/x/a", ("/x/c/CAMERAS.CAM",)),
        ArchiveProject("b", "/x/b", ("/x/b/CAMERAS.CAM",)),
        ArchiveProject("c", "/x/c", ("/x/c/CAMERAS.CAM",)),
    )
    assert found == {"a": ("c",), "b": (), "c": ()}
    assert list(found).index("c") < list(found).index("a")


def test_where_nobody_has_the_store_all_wait_for_the_first() -> None:
    projects = [ArchiveProject(name, f"/x/{name}", ("/shared/CAMERAS.CAM",)) for name in "cab"]
    assert order(*projects) == {"a": (), "b": ("a",), "c": ("a",)}


def test_projects_that_would_wait_for_each_other_are_taken_by_name() -> None:
    found = order(
        ArchiveProject("b", "/x/b", ("/x/a/CAMERAS.CAM", "/x/b/TEMTICKS.TIK")),
        ArchiveProject("a", "/x/a", ("/x/a/CAMERAS.CAM", "/x/b/TEMTICKS.TIK")),
    )
    assert found == {"a": (), "b": ("a",)}
    ring = [
        ArchiveProject(name, f"/x/{name}", (f"/x/{name}/C.CAM", f"/x/{other}/C.CAM"))
        for name, other in zip("abc", "bca", strict=True)
    ]
    assert [project.name for project, _ in in_order(ring)] == ["a", "c", "b"]


def test_projects_are_found_below_folders_but_not_among_results(tmp_path: Path) -> None:
    for name in ("one", "deep/er/two", ".hidden/three", "results/four"):
        (tmp_path / name).mkdir(parents=True)
        first_project(tmp_path / name)
    text = (tmp_path / "one" / "orip.toml").read_text().replace("[project]", '[project]\ncamera_file = "../C.CAM"')
    (tmp_path / "one" / "orip.toml").write_text(text)
    (tmp_path / "deep" / "orip.toml").write_text("not = [toml")
    base, found = find_projects([tmp_path], tmp_path / "results")
    assert base == tmp_path
    assert [project.name for project in found] == ["deep", "deep/er/two", "one"]
    assert found[0].stores == ()
    assert "camera_file" not in text or found[2].stores[0] == str(tmp_path / "C.CAM")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
@pytest.mark.timeout(20)
def test_nothing_waits_for_a_pipe_with_the_name_of_a_project(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "orip.toml")
    _, found = find_projects([tmp_path], tmp_path / "results")
    assert [project.stores for project in found] == [()]


def test_several_folders_are_named_from_what_they_share(tmp_path: Path) -> None:
    for name in ("a/one", "b/one"):
        (tmp_path / name).mkdir(parents=True)
        first_project(tmp_path / name)
    base, found = find_projects([tmp_path / "a", tmp_path / "b"], tmp_path / "results")
    assert (base, [project.name for project in found]) == (tmp_path, ["a/one", "b/one"])


def test_a_folder_without_projects_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no folder there has an orip\.toml"):
        find_projects([tmp_path], tmp_path / "results")
    with pytest.raises(UsageError, match=r"there is no folder .*missing"):
        find_projects([tmp_path, tmp_path / "missing"], tmp_path / "results")
