"""What the reference has been written by hand about is what the program has: no key, column or code is missing."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

import pytest
from command_tree import commands
from documentation.pages import DOCS
from files.hand_built_solutions import awkward
from workflow.quiet import run_quietly
from workflow.small_projects import film_project

from orip.errors import INTERRUPTED, OripError
from orip.files.control.text import ELEMENT_KINDS
from orip.files.log.blocks import ACTIONS, BLOCK_KINDS
from orip.files.project import tables as project_tables
from orip.files.result.json_text import result_document
from orip.files.result.residuals import HEADER
from orip.records.control import DistanceCode
from orip.records.definition import RECORD_TYPES, ReportDetails
from orip.records.plan import PlanSettings
from orip.records.receivers import GnssSettings, ImuSettings

TABLES = {
    "[project]": project_tables.table_of(project_tables.ProjectTable),
    "[check]": project_tables.table_of(project_tables.CheckTable),
    "[report]": project_tables.table_of(ReportDetails),
    "[plan]": project_tables.table_of(PlanSettings),
    "[gnss]": project_tables.table_of(GnssSettings),
    "[imu]": project_tables.table_of(ImuSettings),
    "[[camera]]": project_tables.table_of(RECORD_TYPES["camera"]),
    "[[temtick]]": project_tables.table_of(RECORD_TYPES["temtick"]),
    "[[template]]": project_tables.table_of(RECORD_TYPES["template"]),
    "[[photo]]": project_tables.table_of(RECORD_TYPES["photo"]),
    "[[bundle]]": project_tables.table_of(RECORD_TYPES["bundle"]),
    "[[bundle.model]]": project_tables.table_of(RECORD_TYPES["model"]),
}


def reference(name: str) -> str:
    return (DOCS / "reference" / f"{name}.md").read_text(encoding="utf-8")


def first_cells(text: str) -> list[str]:
    """Return the names in code in the first column of all tables of a text."""
    cells = re.findall(r"^\| ([^|]*(?:\\\|[^|]*)*) \|", text, re.MULTILINE)
    return [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]


@pytest.mark.parametrize("heading", TABLES)
def test_keys_of_orip_toml(heading: str) -> None:
    section = reference("project-file").partition(f"## `{heading}`\n")[2].partition("\n## ")[0]
    assert first_cells(section) == project_tables.keys_of(TABLES[heading])


def test_words_of_control_files() -> None:
    text = reference("control-files")
    for group, kinds in ELEMENT_KINDS.items():
        assert f"| `{group}` | `{' '.join(kinds)}` |" in text
    assert set(get_args(DistanceCode)) <= set(first_cells(text))


def test_words_of_measurement_files() -> None:
    blocks = reference("measurement-files")
    assert all(f"`{word} " in blocks for word in (*BLOCK_KINDS, *ACTIONS))


def test_columns_of_residuals_csv() -> None:
    assert first_cells(reference("residuals-csv")) == HEADER.strip().split(",")


def test_keys_of_result_json() -> None:
    text = reference("result-json")
    document = result_document(awkward())
    assert set(first_cells(text)) == set(document)
    assert [key for key in inner_keys(document) if f"`{key}`" not in text and f" {key} " not in text] == []


def inner_keys(document: dict[str, Any]) -> set[str]:
    """Return the keys of what is listed in a result."""
    lists = [rows[0] for rows in document.values() if isinstance(rows, list) and rows]
    interior = [record for group in document["interior"].values() for record in group.values()]
    return {key for keys in (*lists, *interior) for key in keys}


def test_exit_codes() -> None:
    codes = {int(code) for code in re.findall(r"^\| (\d+) \|", reference("exit-codes"), re.MULTILINE)}
    assert codes == {0, OripError.exit_code, INTERRUPTED, *(error.exit_code for error in OripError.__subclasses__())}


def test_sections_of_listings(tmp_path: Path) -> None:
    folder = film_project(tmp_path)
    run_quietly(folder)
    text = reference("listings")
    for listing in folder.glob("*.OUT"):
        section = text.partition(f"## {listing.name}\n")[2].partition("\n## ")[0]
        headings = re.findall(r"^([A-Z][A-Z ,]+)\n=+$", listing.read_text(encoding="utf-8"), re.MULTILINE)
        assert headings
        assert [heading for heading in headings if f"| {heading} |" not in section] == [], listing.name


def test_every_command_has_its_place() -> None:
    described = re.findall(r"\{orip-commands\} (\S+)", "".join(map(Path.read_text, (DOCS / "reference").rglob("*.md"))))
    assert sorted(described) == sorted(name for name in commands() if " " not in name)
