"""Every document for programs has a schema, comes with the file of it, and is as that file says."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from cli.command_line import orip
from command_tree import commands, is_group
from command_tree import documents as documents_of_the_page
from link.served import loaded_station, served
from support.json_schemas import schema_faults, validator
from workflow.small_projects import REPOSITORY

from orip.schemas.catalogue import DOCUMENTS, SchemaName, identifier
from orip.schemas.generate import FOLDER, schema_text

WITHOUT_DOCUMENT = {"dump", "load", "online"}
"""Commands whose output is JSON lines or nothing; `online` prints a document at the end of a simulated session."""

ON_THE_SAMPLE = """
status; init; measure; check sigma0<=9; compare . .; report; results covariance 101 --output covariance.npz
update photos --dry-run; update points; update --undo --dry-run
results cameras; results photos; results points; results theodolites; results figures; results residuals
prelim relative; prelim bridge; prelim absolute
prelim show; prelim update; observations list; observations list --all; observations todo; observations todo --next
observations disregard point 101 1107 --dry-run; control points list; control distances list
control points edit CP1 aX=0.5 --dry-run; control distances disregard T1 --dry-run; drive table; export-toml
camera plot REFLEX35; camera list; photo show 101; bundle edit MAIN enp_stop=5 --dry-run
digitise points --dry-run; export csv tables; export --list; import --list; init --sample; init NEW new
init --sample dcs260_calibration grid; prelim; results photos NONE
""".replace("\n", ";").split(";")
"""Commands that are run one after the other in the sample with models; each prints its document, or why it failed."""


@pytest.fixture(scope="module")
def documents(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    folder = tmp_path_factory.mktemp("json") / "cliff"
    orip(folder.parent, "init", "--sample", "small_frame_block", "cliff")
    lines = [line.split() for line in ON_THE_SAMPLE if line.strip()]
    found = [orip(folder, "run", "--no-report", "--json").document]
    found += [orip(folder, *words, "--json").document for words in lines]
    (folder / "GPS.csv").write_text("photo,X,Y,Z\n101,0,0,0\n")
    found.append(orip(folder, "stations", "import", "GPS.csv", "--dry-run", "--json").document)
    found += _at_the_plate_processor(folder)
    return found


def _at_the_plate_processor(folder: Path) -> Iterator[dict[str, Any]]:
    with served(loaded_station()) as port:
        link = ["--link", f"tcp://127.0.0.1:{port}", "--json"]
        for words in ("goto 30 0 0", "where", "profile 30 0 0 30 0 1 1", "guide object", "forward"):
            yield orip(folder.parent, "drive", *words.split(), *link).document
        yield orip(folder, "drive", "download", *link).document


def test_documents_are_as_their_schemas_say(documents: list[dict[str, Any]]) -> None:
    assert [fault for document in documents for fault in schema_faults(document)] == []
    names = {document["schema"] for document in documents}
    assert all(name == identifier(name[5:].partition("/")[0]) for name in names)
    # these start a server, read stdin, change the folder or need a second bundle: the tests of the commands have them
    elsewhere: set[SchemaName] = {
        "detect", "digitise-ground", "drive-emulate", "drive-watch", "gnss", "gnss-network", "import", "imu",
        "imu-noise", "match", "online-demo", "online-reconsidered", "restitute-compute", "restitute-export",
        "restitute-show", "results", "screen",
        "archive-diff", "archive-report", "archive-run", "archive-simulate", "archive-status",
        "plan", "plan-clock", "plan-compare", "plan-export", "plan-flown", "plan-follow", "plan-forecast", "plan-place",
        "plan-show",
    }  # fmt: skip
    assert {identifier(name) for name in DOCUMENTS} - names == {identifier(name) for name in elsewhere}


def test_every_command_has_a_document_and_every_document_a_command() -> None:
    of_program = {words for words, command in commands().items() if not is_group(command)} | {"prelim"}
    with_document = {words for document in DOCUMENTS.values() for words in document.written_by}
    assert of_program - with_document == WITHOUT_DOCUMENT - with_document
    assert with_document - of_program == {"result.json", "any command that fails"}


def test_the_names_are_those_of_the_catalogue() -> None:
    assert set(get_args(SchemaName)) == set(DOCUMENTS)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_the_files_are_made_of_the_types(name: SchemaName) -> None:
    # after a change of a type: python -m orip.schemas.generate
    path = FOLDER / f"{name}.schema.json"
    assert path.read_text(encoding="utf-8") == schema_text(name)
    assert validator(name).schema["additionalProperties"] is False


def test_there_are_no_other_schema_files() -> None:
    assert sorted(path.name for path in FOLDER.iterdir()) == sorted(f"{name}.schema.json" for name in DOCUMENTS)


def test_the_page_lists_every_schema() -> None:
    page = (REPOSITORY / "docs" / "reference" / "json-schemas.md").read_text(encoding="utf-8")
    assert "```{orip-documents}\n```\n" in page
    rows = documents_of_the_page()
    assert [schema for schema, _, _ in rows] == [f"`{identifier(name)}`" for name in DOCUMENTS]
    assert all(written_by and content for _, written_by, content in rows)
    assert ("`orip.prelim/1`", "`prelim`, `prelim update`", "Preliminary values that were computed") in rows


def test_what_a_schema_does_not_name_is_refused(documents: list[dict[str, Any]]) -> None:
    (status,) = [document for document in documents if document["schema"] == "orip.status/1"]
    assert schema_faults({**status, "further": 1})
    assert schema_faults({key: value for key, value in status.items() if key != "next"})
    assert schema_faults({**status, "schema": "orip.status/2"})


def test_result_json_is_the_document_of_solve(documents: list[dict[str, Any]], tmp_path: Path) -> None:
    shutil.copytree(REPOSITORY / "sample_projects" / "dcs260_calibration", tmp_path / "grid")
    printed = orip(tmp_path / "grid", "run", "--no-report", "--json").document
    assert json.loads((tmp_path / "grid" / "result.json").read_text(encoding="utf-8")) == printed
