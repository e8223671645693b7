"""A new project is there as a whole or not at all, and `orip new` ends what a killed run has begun."""

from __future__ import annotations

from pathlib import Path

import pytest
from workflow.killed_here import Killed, killed_at

from orip.errors import UsageError
from orip.files.project.starting_texts import Start
from orip.workflow.sample_projects import make_started_project

DRONE = Start("MINE")


def texts_in(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()} if folder.exists() else {}


def test_a_folder_that_is_new_appears_as_a_whole(tmp_path: Path) -> None:
    with killed_at(None) as steps:
        make_started_project(DRONE, tmp_path / "whole")
    whole = texts_in(tmp_path / "whole")
    assert {"orip.toml", ".gitignore"} < set(whole)
    for step in range(1, steps() + 1):
        folder = tmp_path / str(step)
        with pytest.raises(Killed), killed_at(step):
            make_started_project(DRONE, folder)
        assert texts_in(folder) in ({}, whole)


def test_texts_of_a_killed_run_do_not_keep_the_next_one_from_ending(tmp_path: Path) -> None:
    make_started_project(DRONE, tmp_path / "whole")
    whole = texts_in(tmp_path / "whole")
    folder = tmp_path / "begun"
    folder.mkdir()
    *first, last = whole.keys() - {"orip.toml", ".gitignore"}
    for name in first:
        (folder / name).write_text(whole[name])
    make_started_project(DRONE, folder)
    assert texts_in(folder) == whole
    (folder / "orip.toml").unlink()
    (folder / last).write_text("of the user's own\n")
    with pytest.raises(UsageError, match=rf"has the file {last} already"):
        make_started_project(DRONE, folder)
    assert (folder / last).read_text() == "of the user's own\n"


def test_no_folder_is_made_where_a_link_leads_to(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "gone")
    with pytest.raises(UsageError, match="is not a folder"):
        make_started_project(DRONE, tmp_path / "link")
    assert not (tmp_path / "gone").exists()


def test_a_link_to_the_same_text_is_not_taken_for_what_a_killed_run_has_left(tmp_path: Path) -> None:
    make_started_project(DRONE, tmp_path / "whole")
    name = next(name for name in texts_in(tmp_path / "whole") if name.endswith(".PNT"))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / name).symlink_to(tmp_path / "whole" / name)
    with pytest.raises(UsageError, match=f"has the file {name} already"):
        make_started_project(DRONE, tmp_path / "other")
    assert (tmp_path / "other" / name).is_symlink()
