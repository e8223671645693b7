"""State in, change out: what a command reads, that it writes nothing, and what happens if another run was quicker."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from workflow.commands import edit_record, initialise, measure
from workflow.small_projects import contents, film_project

from orip.errors import LockedError
from orip.workflow.adjust.solve import ADJUSTED_FROM, solve
from orip.workflow.project.bundle_state import read_bundle
from orip.workflow.project.commit import Change, carry_out, commit
from orip.workflow.project.state import ProjectState, read_project
from orip.workflow.records import commands
from orip.workflow.records.commands import RecordsOutcome, read_records
from orip.workflow.records.edits import RecordName

CAMERA = RecordName("camera", "C35")


@pytest.fixture
def measured(tmp_path: Path) -> Path:
    folder = film_project(tmp_path / "film")
    initialise(folder)
    measure(folder)
    return folder


def test_nothing_is_written_until_the_commit(measured: Path) -> None:
    before = contents(measured)
    change = solve(read_bundle(measured, None, *ADJUSTED_FROM))
    assert change.outcome.solution.status == "converged"
    assert contents(measured) == before
    assert commit(change).changed
    assert set(contents(measured)) - set(before) >= {path.name for path in change.outcome.files}
    assert not commit(change).changed


def test_a_part_that_was_not_read_is_not_taken_for_empty(measured: Path) -> None:
    state = read_project(measured, "definitions")
    with pytest.raises(ValueError, match="without its marks"):
        _ = state.interior
    with pytest.raises(KeyError):
        state.solution("MAIN")


def test_texts_are_read_once(measured: Path) -> None:
    state = read_project(measured, "definitions")
    log = state.texts.log
    (measured / "FIRST.MEA").write_text("no measurement")
    assert state.texts.log is log
    assert state.read_again("definitions", "marks").texts.log is log


def test_a_change_of_an_older_state_is_refused_or_computed_again(measured: Path) -> None:
    state = read_records(measured)
    edit = partial(commands.edit_record, record=CAMERA, words=["c=35.5"])
    change = edit(state)
    edit_record(measured, CAMERA, ["unknown=C"])
    before = contents(measured)
    with pytest.raises(LockedError, match="another run has changed the record stores in the meantime"):
        commit(change)
    assert contents(measured) == before
    seen: list[ProjectState] = []

    def watched(now: ProjectState) -> Change[RecordsOutcome]:
        seen.append(now)
        return edit(now)

    assert carry_out(state, watched).changed
    assert len(seen) == 2
    camera = read_project(measured, "definitions").records.cameras["C35"]
    assert (camera.parameters[0], camera.unknown) == (35.5, ("C",))
