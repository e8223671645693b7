"""Reports of the sample projects, and the reader that takes a page apart."""

from __future__ import annotations

import json
import shutil
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from msgspec import Struct, field
from workflow.commands import report
from workflow.quiet import run_quietly
from workflow.small_projects import REPOSITORY

from orip.records.results.solution import Solution

SAMPLES = ("zurich_city_hall", "dcs260_calibration", "small_frame_block")
TEXTS = (".toml", ".MEA", ".PNT", ".PRE", ".LEN")


class Sample(Struct, frozen=True):
    """A sample project that was adjusted: its solution, its result.json, and its page."""

    solution: Solution
    result: dict[str, Any]
    page: str


@cache
def sample(name: str) -> Sample:
    """Return a sample project, adjusted once for all tests."""
    with TemporaryDirectory() as folder:
        project = sample_project(name, Path(folder) / name)
        (outcome,) = run_quietly(project)
        report(project, None, None)
        result = json.loads((project / "result.json").read_text(encoding="utf-8"))
        return Sample(outcome.solution, result, (project / "report.html").read_text(encoding="utf-8"))


def sample_project(name: str, folder: Path) -> Path:
    """Copy the texts of a sample project."""
    folder.mkdir()
    for path in (REPOSITORY / "sample_projects" / name).iterdir():
        if path.suffix in TEXTS:
            shutil.copy(path, folder)
    return folder


class PageTable(Struct):
    """A table of the page: which records of result.json it shows, the figure of each column, and the cells."""

    records: str
    keys: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)
    foot: list[list[str]] = field(default_factory=list)


class Page(HTMLParser):
    """What a page says, and everything that it would load."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: list[PageTable] = []
        self.matrices: dict[str, list[list[str]]] = {}
        self.figures: dict[str, str] = {}
        self.loaded: list[str] = []
        self.data = ""
        self.words: list[str] = []
        self._cell: list[str] | None = None
        self._rows: list[list[str]] = []
        self._element = ""
        self.feed(text)

    def table(self, records: str) -> PageTable:
        """Return the table that shows some records of result.json."""
        (found,) = (table for table in self.tables if table.records == records)
        return found

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        self._element = attributes.get("id") or tag
        self.loaded += [
            value or "" for name, value in attrs if name in {"src", "href", "srcset", "action", "poster", "xlink:href"}
        ]
        if tag == "data":
            self.figures[attributes["data-figure"] or ""] = attributes["value"] or ""
        elif tag == "table":
            self.tables.append(PageTable(attributes.get("data-records") or ""))
            self._rows = self.tables[-1].rows
            if "data-camera" in attributes:
                self._rows = self.matrices[attributes["data-camera"] or ""] = []
        elif tag == "tfoot":
            self._rows = self.tables[-1].foot
        elif tag == "tr":
            self._rows.append([])
        elif tag in {"th", "td"}:
            self._cell = []
            if attributes.get("scope") == "col":
                self.tables[-1].keys.append(attributes.get("data-key") or "")

    def handle_endtag(self, tag: str) -> None:
        if tag in {"th", "td"} and self._cell is not None:
            self._rows[-1].append("".join(self._cell).strip())
            self._cell = None
        elif tag == "thead":
            self._rows.clear()

    def handle_data(self, data: str) -> None:
        if self._element == "block-data":
            self.data += data
        elif self._element not in {"plotly-packed", "script", "style"}:
            self.words.append(data)
        if self._cell is not None:
            self._cell.append(data)
