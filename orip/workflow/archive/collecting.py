"""The tables and the overview page of an archive, from what is kept of its projects."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

from msgspec import Struct

from orip.archive.tables import TABLES, Row
from orip.files.archive.dataset import write_shard
from orip.files.archive.finished import read_rows
from orip.files.archive.layout import SHARDS, ResultsFolder
from orip.files.archive.plan import ArchivePlan
from orip.files.text.atomic import replace_text, reporting_failure
from orip.progress import stage
from orip.report.archive.overview import OverviewInput, archive_page


class Collected(Struct, frozen=True):
    """The tables that were written: number of rows by table, their folder, and the overview page."""

    rows: Mapping[str, int]
    tables: Path
    overview: Path


def collect(results: ResultsFolder, plan: ArchivePlan) -> Collected:
    """Write tables and overview of the projects of a plan that are finished.

    Raises
    ------
    OripError
        If the folder or the disk refuses.
    """
    wanted = frozenset(plan.projects)
    counts: Counter[str] = Counter()
    projects: list[Row] = []
    failed: dict[tuple[str, str], list[str]] = {}
    with stage("tables", len(SHARDS)) as advance:
        for done, shard in enumerate(SHARDS, start=1):
            tables = _rows_of_shard(results, shard, wanted)
            write_shard(results, shard, tables)
            counts.update({table: len(rows) for table, rows in tables.items()})
            projects += tables["projects"]
            for row in tables["gates"]:
                if not row["passed"]:
                    failed.setdefault((row["project"], row["bundle"]), []).append(row["gate"])
            advance(done)
    links = {str(row["project"]): _link(results, plan, str(row["project"])) for row in projects}
    page = archive_page(OverviewInput(plan.base, plan.method, plan.orip, len(wanted), projects, failed, links))
    with reporting_failure(results.overview, "remove the cause; 'orip archive report' writes it again"):
        replace_text(results.overview, page)
    return Collected(counts, results.dataset, results.overview)


def _rows_of_shard(results: ResultsFolder, shard: str, wanted: frozenset[str]) -> dict[str, list[dict[str, Any]]]:
    tables: dict[str, list[dict[str, Any]]] = {table: [] for table in TABLES}
    for head, rows in read_rows(results, shard):
        if head.name in wanted:
            for table, found in rows.items():
                tables[table] += found
    return tables


def _link(results: ResultsFolder, plan: ArchivePlan, name: str) -> str:
    """Return the folder of a project as a link from the overview page."""
    folder = Path(plan.base) if Path(plan.base).name == name and name in plan.projects else Path(plan.base, name)
    if Path(plan.base, name).is_dir():
        folder = Path(plan.base, name)
    return quote(Path(os.path.relpath(folder, results.folder)).as_posix())
