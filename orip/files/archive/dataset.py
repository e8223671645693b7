"""The tables of an archive's results as Parquet files, which pandas, Polars, DuckDB and others read.

Each table is a folder, divided into shards by the digest of the project's name (Hive's form, ``shard=a``). Equal rows
give equal files; a table is replaced shard by shard.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from orip.archive.tables import SCHEMA, TABLES, ColumnType, Row
from orip.errors import InputError
from orip.files.archive.layout import SHARDS, ResultsFolder
from orip.files.text.atomic import replace_bytes, reporting_failure
from orip.files.text.own_files import make_folder
from orip.files.text.regular_file import open_regular, regular_bytes
from orip.files.text.shown import printable, shown_token

_TYPES: Mapping[ColumnType, pa.DataType] = {
    "text": pa.string(),
    "number": pa.float64(),
    "count": pa.int64(),
    "yes_no": pa.bool_(),
}


def write_shard(results: ResultsFolder, shard: str, rows: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Write the rows of a shard, of all tables; a table without rows has a file without rows.

    Raises
    ------
    OripError
        If the folder or the disk refuses.
    """
    for table, columns in TABLES.items():
        schema = pa.schema([(name, _TYPES[kind]) for name, kind in columns.items()], {"schema": SCHEMA})
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


def read_shard(results: ResultsFolder, table: str, shard: str, columns: Sequence[str] | None = None) -> list[Row]:
    """Return the rows of a table in a shard; none where there is no file.

    Raises
    ------
    InputError
        If the file cannot be read, or has another schema.
    """
    path = results.table(table, shard)
    if not path.exists():
        return []
    try:
        with open_regular(path) as stream, pq.ParquetFile(stream, page_checksum_verification=True) as file:
            schema = (file.schema_arrow.metadata or {}).get(b"schema", b"").decode(errors="replace")
            rows: list[Row] = file.read(columns=None if columns is None else list(columns)).to_pylist()
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
