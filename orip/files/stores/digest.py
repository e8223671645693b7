"""The digest of a record, and what a store records about itself: its kind, its run, the texts it was made from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from typing import Any

from msgspec import Struct
from msgspec.structs import asdict, astuple

from orip.files.stores.checksum import CHECKSUM
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable, position, text


def record_digest(record: object) -> str:
    """Return the SHA-256 (hex) of a frozen record.

    Equal records have equal digests, also after a round trip through a store: numbers count by value (1 and 1.0 are
    the same, 0.0 and -0.0 too), names by their letters and case. Neither the name of the class nor the order of its
    fields counts.

    Raises
    ------
    TypeError
        If the record holds something other than records, tuples, arrays, text, numbers, bool and None.
    """
    canonical = json.dumps(_canonical(record), separators=(",", ":"), sort_keys=True)
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()


def same_record(one: Any, other: Any) -> bool:
    """Tell whether two records have equal digests; large arrays and lists of names are compared as they are.

    Raises
    ------
    TypeError
        As `record_digest`.
    """
    if type(one) is not type(other):
        return record_digest(one) == record_digest(other)
    if hasattr(one, "dtype") and one.dtype.kind in "biuf" and other.dtype.kind in "biuf":
        from numpy import array_equal  # most records have no arrays

        return array_equal(one, other, equal_nan=True)
    if isinstance(one, Struct):
        return all(map(same_record, astuple(one), astuple(other)))
    return bool(one == other) or record_digest(one) == record_digest(other)


def _canonical(value: Any) -> Any:
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, int | float):
        return _number(value)
    if isinstance(value, Sequence) and not isinstance(value, bytes):  # also names that are kept by their numbers
        return [_canonical(item) for item in value]
    if hasattr(value, "tolist"):  # an array, or a number of one
        return _canonical(value.tolist())
    if isinstance(value, Struct):
        return {name: _canonical(own) for name, own in asdict(value).items()}
    message = f"a {type(value).__name__} has no canonical form; records hold records, tuples, text and numbers"
    raise TypeError(message)


def _number(value: float) -> float | int:
    """Return the number as float, negative zero as zero; whole numbers that no float can hold stay as they are."""
    try:
        return float(value) + 0.0 if float(value) == value or value != value else value
    except OverflowError:
        return value


META = StoreTable("meta", (text("key"), text("value")), key=("key",))
TEXT_INPUT = StoreTable(
    "text_input",
    (text("command"), position(), text("file"), text("sha256")),
    key=("command", "position"),
    unique=(("command", "file"),),
    by_owner=True,
)
TABLES = (META, TEXT_INPUT, CHECKSUM)


def read_meta(store: Store) -> dict[str, str]:
    """Return the keys and values of the table `meta`; empty for an absent store."""
    return dict(store.rows(META))


def run_of(store: Store) -> str | None:
    """Return the id of the run that wrote the store last, None if the store is absent or has none."""
    return read_meta(store).get("run")


def set_run(store: Store, run: str | None) -> None:
    """Record the id of the run that writes the store; None: it is not known."""
    meta = {**read_meta(store), "run": run}
    store.delete(META)
    store.insert(META, ((key, value) for key, value in meta.items() if value is not None))


def read_inputs(store: Store, command: str) -> tuple[tuple[str, str], ...]:
    """Return (file, SHA-256) of the text files that `command` read when it last made this store, in their order."""
    return tuple((file, sha256) for _command, _position, file, sha256 in store.rows(TEXT_INPUT, command))


def write_inputs(store: Store, command: str, inputs: Iterable[tuple[str, str]]) -> None:
    """Replace what `read_inputs` returns for `command`; other commands' inputs stay."""
    store.delete(TEXT_INPUT, command)
    store.insert(TEXT_INPUT, ((command, number, *item) for number, item in enumerate(inputs)))
