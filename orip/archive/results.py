"""The tables of an archive (Parquet) and its overview page, made from what is kept of its projects."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from markupsafe import Markup
from msgspec import Struct

from orip.archive.run_files import SHARDS, ArchivePlan, ResultsFolder, read_rows
from orip.archive.tables import SCHEMA, TABLES, Cell, ColumnType, Row
from orip.errors import InputError
from orip.files.text.atomic import replace_bytes, replace_text, reporting_failure
from orip.files.text.own_files import make_folder
from orip.files.text.regular_file import open_regular, regular_bytes
from orip.files.text.shown import printable, shown_token
from orip.progress import stage

if TYPE_CHECKING:
    from jinja2 import Template


# Each table is a folder, divided into shards by the digest of the project's name (Hive's form, ``shard=a``). Equal rows
# give equal files; a table is replaced shard by shard.

_TYPES: Mapping[ColumnType, str] = {"text": "string", "number": "float64", "count": "int64", "yes_no": "bool"}
"""Names of Arrow's types. Arrow itself, an extra, is imported where a table is written or read."""


def write_shard(results: ResultsFolder, shard: str, rows: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Write the rows of a shard, of all tables; a table without rows has a file without rows.

    Raises
    ------
    OripError
        If the folder or the disk refuses.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    for table, columns in TABLES.items():
        schema = pa.schema(
            [(name, pa.type_for_alias(_TYPES[kind])) for name, kind in columns.items()], {"schema": SCHEMA}
        )
        buffer = io.BytesIO()
        pq.write_table(
            pa.Table.from_pylist(list(rows.get(table, ())), schema=schema),
            buffer,
            compression="zstd",
            write_page_checksum=True,
        )
        path = results.table(table, shard)
        with reporting_failure(path, "remove the cause; 'orip archive report' writes the tables again"):
            make_folder(path.parent, results.folder)
            if not path.is_file() or regular_bytes(path) != buffer.getvalue():
                replace_bytes(path, buffer.getvalue())


def read_shard(results: ResultsFolder, table: str, shard: str) -> list[Row]:
    """Return the rows of a table in a shard; none where there is no file.

    Raises
    ------
    InputError
        If the file cannot be read, or has another schema.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = results.table(table, shard)
    if not path.exists():
        return []
    try:
        with open_regular(path) as stream, pq.ParquetFile(stream, page_checksum_verification=True) as file:
            schema = (file.schema_arrow.metadata or {}).get(b"schema", b"").decode(errors="replace")
            rows: list[Row] = file.read().to_pylist()
    except (OSError, pa.ArrowException) as error:
        message = f"cannot be read: {printable(str(error))}; 'orip archive report' writes it again"
        raise InputError.single(message, str(path)) from error
    if schema != SCHEMA:
        message = f"has the schema {shown_token(schema) or 'of another program'}; this version reads {SCHEMA}"
        raise InputError.single(message, str(path))
    return rows


def read_table(results: ResultsFolder, table: str) -> Iterator[Row]:
    """Yield the rows of a table, shard by shard."""
    for shard in SHARDS:
        yield from read_shard(results, table, shard)


_NUMBERS = ("sigma0", "redundancy", "photos", "points", "check_rms_xy", "check_rms_z", "check_max")


class OverviewInput(Struct, frozen=True):
    """What the overview shows.

    Parameters
    ----------
    base, method, orip : str
        The top of the archive, how it was adjusted, and by which version.
    planned : int
        Projects of the archive, finished or not.
    projects : sequence of Row
        Rows of the table `projects`.
    failed : mapping by (project, bundle)
        The gates that it failed.
    links : mapping by project
        Its folder, as a link from the page.
    """

    base: str
    method: str
    orip: str
    planned: int
    projects: Sequence[Row]
    failed: Mapping[tuple[str, str], Sequence[str]]
    links: Mapping[str, str]


def archive_page(given: OverviewInput) -> str:
    """Return the overview as one HTML page that loads nothing."""
    rows = [_shown(given, row) for row in sorted(given.projects, key=lambda row: (row["project"], row["bundle"]))]
    states = Counter(str(row["state"]) for row in rows)
    gates = Counter(gate for row in rows for gate in given.failed.get((str(row["project"]), str(row["bundle"])), ()))
    text = json.dumps({"rows": rows, "gates": gates.most_common()}, separators=(",", ":"), allow_nan=False)
    # the characters that could end the element, as JSON writes them
    data = Markup(text.replace("<", "\\u003c").replace("&", "\\u0026").replace(">", "\\u003e"))
    finished = len({row["project"] for row in rows})
    return f"{_template().render(given=given, data=data, states=states.most_common(), finished=finished)}\n"


def _shown(given: OverviewInput, row: Row) -> dict[str, Cell | Sequence[str]]:
    """Return what the page has to know of a row of `projects`."""
    name, bundle = str(row["project"]), str(row["bundle"])
    adjusted = row["state"] == "adjusted"
    report = row.get("report")
    return {
        "project": name,
        "bundle": bundle,
        "state": str(row.get("status") or row["state"]).replace("_", " "),
        "text": row.get("verdict") if adjusted and row.get("verdict") else row["message"],
        "link": f"{given.links[name]}/{report or ''}",
        "failed": list(given.failed.get((name, bundle), ())),
        **{number: row.get(number) for number in _NUMBERS},
    }


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("orip.archive", "page")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    script = f"\n{loader.get_source(environment, 'archive.js')[0]}\n"
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    environment.globals["script"] = Markup(script)
    environment.globals["style"] = Markup(loader.get_source(environment, "archive.css")[0])
    environment.globals["policy"] = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; "
        "base-uri 'none'; form-action 'none'"
    )
    return environment.get_template("archive.html")


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
