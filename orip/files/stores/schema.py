"""The kinds of stores, and the tables of each."""

from __future__ import annotations

from pathlib import Path

from orip.errors import UsageError
from orip.files.stores import provenance
from orip.files.stores.checksum import CHECKSUM
from orip.files.stores.contents import cameras, exterior, observations, photos, solution_tables, templates, temticks
from orip.files.stores.table import StoreTable

APPLICATION_ID = int.from_bytes(b"ORIP", "big")
SCHEMA_VERSION = 16
"""15: no solution was not determined; 14: checksums were of BLAKE2; 13: all rows of a long list were one; 12: there
were no rigs; 11: long lists were rows; 10: photos had three correlations; 8: cameras had no projection; 7: they had
no A9; 6: there were no times of exposures; 5: there were no antennas; 4: a photo had each point once, and there were
no variance components; 3: there were no checksums and no zero directions; 2: no groups of observations, no
alternatives of a blunder; 1: no correlations of coordinates. A store of an older version is refused.
"""
DUMP_VERSION = 11
"""Of the tables that a dump has; checksums are not among them."""

TABLES_OF_KIND: dict[str, tuple[StoreTable, ...]] = {
    "CAM": (*provenance.TABLES, *cameras.TABLES),
    "TIK": (*provenance.TABLES, *temticks.TABLES),
    "PHO": (*provenance.TABLES, *photos.TABLES),
    "TEM": (*provenance.TABLES, *templates.TABLES),
    "EXT": (*provenance.TABLES, *exterior.TABLES, *solution_tables.TABLES),
    "EXO": (*provenance.TABLES, *observations.TABLES),
}
"""Tables by kind of store, parents before their lists."""


def summed_tables(kind: str) -> tuple[StoreTable, ...]:
    """Return the tables that have checksums: all but that of the checksums."""
    return tuple(table for table in TABLES_OF_KIND[kind] if table is not CHECKSUM)


def kind_of(path: Path) -> str:
    """Return the kind of store that a file's extension tells; case does not count.

    Raises
    ------
    UsageError
        If no store has that extension.
    """
    kind = path.suffix.removeprefix(".").upper()
    if kind not in TABLES_OF_KIND:
        known = ", ".join(f".{name}" for name in TABLES_OF_KIND)
        message = f"'{path}' is not a record store: stores end in {known}"
        raise UsageError(message)
    return kind
