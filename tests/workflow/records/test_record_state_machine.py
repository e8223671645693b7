"""Any sequence of record commands, some of them killed, against plain dictionaries."""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test
from workflow.commands import (
    add_record,
    copy_record,
    delete_record,
    edit_record,
    export_toml,
    initialise,
    list_records,
    rename_record,
)
from workflow.killed_here import Killed, killed_at
from workflow.plain_records import PlainRecords, Refusal, Table

from orip.errors import OripError
from orip.files.stores.dump import dump, load
from orip.files.stores.transaction import reading
from orip.workflow.project.definitions import read_definitions
from orip.workflow.project.folder import ProjectFolder, open_project
from orip.workflow.records.document import checked, stored_document
from orip.workflow.records.edits import RecordName

BEGUN = """
camera = [{ name = "A", c = 8.5 }, { name = "B", c = 9.0 }]
temtick = [{ name = "A" }, { name = "C1" }]
template = [{ name = "A", temtick = "a" }, { name = "Ä", temtick = "C1", photos = ["B"] }]
photo = [{ name = "A", camera = "a", X0 = 1.5 }, { name = "B", camera = "B" }, { name = "Ä", camera = "A" }]
[[bundle]]
name = "A"
model = [{ name = "A", left = "A", right = "B", row = 1, column = 1 }]
"""
EMPTY = 'project = { name = "Z" }\n'
KINDS = ("camera", "temtick", "template", "photo", "bundle", "model")


@cache
def _begun() -> dict[str, bytes]:
    folder = Path(tempfile.mkdtemp(prefix="orip-records-"))
    (folder / "orip.toml").write_text(EMPTY + BEGUN)
    initialise(folder)
    (folder / "orip.toml").write_text(EMPTY)
    found = {path.name: path.read_bytes() for path in folder.iterdir()}
    shutil.rmtree(folder)
    return found


def names(*given: str) -> Any:
    return st.sampled_from(given)


NAMES = names("A", "a", "B", "C1", "Ä", "ä")
SOME_NAME = st.none() | NAMES
KILL = st.none() | st.none() | st.integers(1, 150)


class RecordMachine(RuleBasedStateMachine):
    outcomes: ClassVar[Counter[str]] = Counter()

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="orip-records-"))
        self.model = PlainRecords()
        (self.folder / "orip.toml").write_text(EMPTY)

    @initialize(begun=st.booleans())
    def begin(self, begun: bool) -> None:
        """Begin with nothing, or with some records: what refers to others is else rarely made."""
        if begun:
            for name, content in _begun().items():
                (self.folder / name).write_bytes(content)
            self.model.kinds = self.stored()

    def teardown(self) -> None:
        shutil.rmtree(self.folder)

    def act(
        self, expected: Callable[[PlainRecords], None], command: Callable[..., Any], dry_run: bool, kill: int | None
    ) -> None:
        """Do the same to both; after a kill, the stores are as they were or as they should be."""
        wanted: PlainRecords | None = self.model.copy()
        try:
            expected(wanted)  # type: ignore[arg-type]
        except Refusal:
            wanted = None
        killed = False
        try:
            with killed_at(kill):
                outcome = command(dry_run=dry_run)
        except OripError:
            assert wanted is None, "refused for no reason"
            self.outcomes["refused"] += 1
            return
        except Killed:
            killed = True
        if killed:
            self.outcomes["killed"] += 1
            if wanted is not None and not dry_run and self.stored() == wanted.kinds:
                self.model = wanted
            return
        assert wanted is not None, "not refused"
        assert bool(outcome.changes) == (wanted.kinds != self.model.kinds)
        self.outcomes["changed" if outcome.changes else "unchanged"] += 1
        if not dry_run:
            self.model = wanted

    @rule(name=NAMES, c=st.sampled_from([8.5, 9.0, -1.0]), before=SOME_NAME, dry=st.booleans(), kill=KILL)
    def add_camera(self, name: str, c: float, before: str | None, dry: bool, kill: int | None) -> None:
        self.add("camera", {"name": name, "c": c}, [f"c={c}"], before, dry, kill)

    @rule(name=NAMES, before=SOME_NAME, kill=KILL)
    def add_temtick(self, name: str, before: str | None, kill: int | None) -> None:
        self.add("temtick", {"name": name}, [], before, False, kill)

    @rule(name=NAMES, temtick=NAMES, kill=KILL)
    def add_template(self, name: str, temtick: str, kill: int | None) -> None:
        table = {"name": name, "temtick": temtick, "photos": []}
        self.add("template", table, [f"temtick={temtick}"], None, False, kill)

    @rule(name=NAMES, camera=NAMES, template=SOME_NAME, before=SOME_NAME, dry=st.booleans(), kill=KILL)
    def add_photo(
        self, name: str, camera: str, template: str | None, before: str | None, dry: bool, kill: int | None
    ) -> None:
        table = {"name": name, "camera": camera, "template": template, "X0": None}
        self.add("photo", table, [f"camera={camera}", f"template={template or ''}"], before, dry, kill)

    @rule(name=NAMES, stop=st.sampled_from([3.0, 4.0]), kill=KILL)
    def add_bundle(self, name: str, stop: float, kill: int | None) -> None:
        def expected(model: PlainRecords) -> None:
            known = model.find("bundle", name)["models"] if model.has("bundle", name) else []
            model.add("bundle", {"name": name, "enp_stop": stop, "points_of": None, "models": known}, None)

        record = RecordName("bundle", name)
        self.act(
            expected,
            lambda dry_run: add_record(self.folder, record, [f"enp_stop={stop}"], dry_run=dry_run),
            False,
            kill,
        )

    @rule(bundle=NAMES, name=NAMES, left=NAMES, right=NAMES, row=st.integers(1, 2), column=st.integers(1, 2), kill=KILL)
    def add_model(self, bundle: str, name: str, left: str, right: str, row: int, column: int, kill: int | None) -> None:
        table = {"name": name, "left": left, "right": right, "row": row, "column": column}
        words = [f"{key}={value}" for key, value in table.items() if key != "name"]
        self.add("model", table, words, None, False, kill, bundle)

    def add(
        self,
        kind: Any,
        table: Table,
        words: list[str],
        before: str | None,
        dry: bool,
        kill: int | None,
        bundle: str = "",
    ) -> None:
        record = RecordName(kind, table["name"], bundle or None)
        self.act(
            lambda model: model.add(kind, table, before, bundle),
            lambda dry_run: add_record(self.folder, record, words, before, dry_run=dry_run),
            dry,
            kill,
        )

    @rule(name=NAMES, camera=SOME_NAME, template=SOME_NAME | st.just(""), x=st.none() | st.just(1.5), kill=KILL)
    def edit_photo(
        self, name: str, camera: str | None, template: str | None, x: float | None, kill: int | None
    ) -> None:
        values: Table = {"X0": x}
        values |= {} if camera is None else {"camera": camera}
        values |= {} if template is None else {"template": template or None}
        self.edit("photo", name, values, kill)

    @rule(name=NAMES, photos=st.lists(NAMES, max_size=3), kill=KILL)
    def edit_template(self, name: str, photos: list[str], kill: int | None) -> None:
        self.edit("template", name, {"photos": photos}, kill)

    @rule(name=NAMES, c=st.sampled_from([8.5, 9.0, 0.0]), kill=KILL)
    def edit_camera(self, name: str, c: float, kill: int | None) -> None:
        self.edit("camera", name, {"c": c}, kill)

    @rule(bundle=NAMES, name=NAMES, left=SOME_NAME, row=st.integers(1, 2), kill=KILL)
    def edit_model(self, bundle: str, name: str, left: str | None, row: int, kill: int | None) -> None:
        self.edit("model", name, {"row": row, **({} if left is None else {"left": left})}, kill, bundle)

    def edit(self, kind: Any, name: str, values: Table, kill: int | None, bundle: str = "") -> None:
        record = RecordName(kind, name, bundle or None)
        texts = {
            key: ",".join(value) if isinstance(value, list) else "" if value is None else value
            for key, value in values.items()
        }
        words = [f"{key}={text}" for key, text in texts.items()]
        self.act(
            lambda model: model.edit(kind, name, values, bundle),
            lambda dry_run: edit_record(self.folder, record, words, dry_run=dry_run),
            False,
            kill,
        )

    @rule(kind=names(*KINDS), name=NAMES, new=NAMES, bundle=NAMES, dry=st.booleans(), kill=KILL)
    def rename(self, kind: Any, name: str, new: str, bundle: str, dry: bool, kill: int | None) -> None:
        record, bundle = self.record(kind, name, bundle)
        self.act(
            lambda model: model.rename(kind, name, new, bundle),
            lambda dry_run: rename_record(self.folder, record, new, dry_run=dry_run),
            dry,
            kill,
        )

    @rule(kind=names(*KINDS), name=NAMES, new=NAMES, bundle=NAMES, row=st.integers(1, 3), kill=KILL)
    def duplicate(self, kind: Any, name: str, new: str, bundle: str, row: int, kill: int | None) -> None:
        record, bundle = self.record(kind, name, bundle)
        values = {"row": row} if kind == "model" else {}
        words = [f"{key}={value}" for key, value in values.items()]
        self.act(
            lambda model: model.duplicate(kind, name, new, values, bundle),
            lambda dry_run: copy_record(self.folder, record, new, words, dry_run=dry_run),
            False,
            kill,
        )

    @rule(kind=names(*KINDS), name=NAMES, bundle=NAMES, everything=st.booleans(), dry=st.booleans(), kill=KILL)
    def delete(self, kind: Any, name: str, bundle: str, everything: bool, dry: bool, kill: int | None) -> None:
        record, bundle = self.record(kind, name, bundle)
        self.act(
            lambda model: model.delete(kind, name, everything, bundle),
            lambda dry_run: delete_record(self.folder, record, with_referents=everything, dry_run=dry_run),
            dry,
            kill,
        )

    @staticmethod
    def record(kind: Any, name: str, bundle: str) -> tuple[RecordName, str]:
        bundle = bundle if kind == "model" else ""
        return RecordName(kind, name, bundle or None), bundle

    @rule()
    def reload(self) -> None:
        """Take all stores to text and back, and read the records in each of the ways there are."""
        self.outcomes["reloaded"] += 1
        project = open_project(self.folder)
        for path in filter(Path.is_file, project.record_stores):
            lines = list(dump(path))
            path.unlink()
            load(lines, path, source="dump")
        for kind in KINDS:
            rows = list_records(self.folder, kind).rows  # type: ignore[arg-type]
            assert [row.name for row in rows] == [table["name"] for _, table in self.model.everywhere(kind)]
        if any(self.model.kinds.values()):
            text = export_toml(self.folder).text
            (self.folder / "orip.toml").rename(self.folder / "kept.toml")
            (self.folder / "orip.toml").write_text(text)
            definition = open_project(self.folder).definition
            (self.folder / "kept.toml").replace(self.folder / "orip.toml")
            with reading(project.record_stores) as stores:
                stored = read_definitions(project, stores)
            assert definition == checked(stored_document(project, stored)).definition

    @invariant()
    def the_same(self) -> None:
        assert self.stored() == self.model.kinds
        assert {path.name for path in self.folder.iterdir() if "-journal" in path.name} == set()

    def stored(self) -> dict[str, list[Table]]:
        """Return what the stores hold, as the dictionaries have it."""
        project: ProjectFolder = open_project(self.folder)
        with reading(project.record_stores) as stores:
            found = read_definitions(project, stores)
        models = ("name", "left", "right", "row", "column")
        return {
            "camera": [{"name": e.record.name, "c": e.record.parameters[0]} for e in found.cameras],
            "temtick": [{"name": e.record.name} for e in found.temticks],
            "template": [
                {"name": e.record.name, "temtick": e.record.temtick, "photos": list(e.record.photos)}
                for e in found.templates
            ],
            "photo": [
                {
                    "name": e.record.name,
                    "camera": e.record.camera,
                    "template": e.record.template,
                    "X0": e.record.orientation[0],
                }
                for e in found.photos
            ],
            "bundle": [
                {
                    "name": e.record.name,
                    "enp_stop": e.record.enp_stop,
                    "points_of": e.record.points_of,
                    "models": [{key: getattr(model, key) for key in models} for model in e.record.models],
                }
                for e in found.bundles
            ],
        }


def run(examples: int, steps: int) -> Counter[str]:
    RecordMachine.outcomes.clear()
    machine_settings = settings(
        max_examples=examples, stateful_step_count=steps, deadline=None, suppress_health_check=list(HealthCheck)
    )
    run_state_machine_as_test(RecordMachine, settings=machine_settings)
    return RecordMachine.outcomes


def test_a_few_hundred_commands() -> None:
    assert run(examples=3, steps=40).total() > 30


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_ten_thousand_commands() -> None:
    outcomes = run(examples=300, steps=60)
    assert outcomes.total() >= 10_000
    assert all(outcomes[name] >= 100 for name in ("changed", "unchanged", "refused", "killed", "reloaded")), outcomes
