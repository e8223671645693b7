"""What a store records about itself: its kind, the run that wrote it, the text files it was made from."""

from __future__ import annotations

from collections.abc import Iterable

from orip.files.stores.checksum import CHECKSUM
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable, position, text

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
