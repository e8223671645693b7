"""JSON as a tree of values that know where they stand."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from msgspec import Struct

from orip.exchange.sources.text import Faults
from orip.files.text.decimal_numbers import LARGEST_NUMBER
from orip.files.text.lines import foreign_bytes, read_bytes
from orip.files.text.shown import json_fault, shown_token

MOST_VALUES = 50_000_000
"""Each takes some thirty times its bytes in memory."""


class JsonText(Struct, frozen=True):
    """A text of JSON and what is wrong with it."""

    data: bytes
    faults: Faults

    def complain(self, message: str, place: tuple[str | int, ...]) -> None:
        """Keep a complaint about the value at a place, with the line in which its keys are found."""
        shown = "/".join(shown_token(str(key)) for key in place)
        self.faults.complain(f"{shown}: {message}" if shown else message, self._line(place))

    def _line(self, place: tuple[str | int, ...]) -> int:
        position = 0
        for key in place:
            if isinstance(key, str):
                found = self.data.find(json.dumps(key, ensure_ascii=False).encode(errors="replace"), position)
                position = position if found < 0 else found
        return self.data.count(b"\n", 0, position) + 1


class JsonValue(Struct, frozen=True):
    """A value of a JSON text and its place: the keys and indices that lead to it."""

    value: Any
    source: JsonText
    place: tuple[str | int, ...] = ()

    def complain(self, message: str) -> None:
        """Keep a complaint about this value."""
        self.source.complain(message, self.place)

    def get(self, key: str) -> JsonValue | None:
        """Return the value of a key of an object; None if there is none, or if it is null."""
        found = self.value.get(key) if isinstance(self.value, dict) else None
        return None if found is None else JsonValue(found, self.source, (*self.place, key))

    def required(self, key: str) -> JsonValue | None:
        """Return the value of a key; None, and a complaint kept, if it is missing."""
        found = self.get(key)
        if found is None:
            self.complain(f"there is no '{key}' here; export the file again")
        return found

    def entries(self) -> Iterator[tuple[str, JsonValue]]:
        """Iterate over the keys of an object with their values; a complaint is kept of anything else."""
        if not isinstance(self.value, dict):
            self.complain("an object {...} should be here; export the file again")
            return
        for key, value in self.value.items():
            yield key, JsonValue(value, self.source, (*self.place, key))

    def items(self) -> Iterator[JsonValue]:
        """Iterate over the elements of an array; a complaint is kept of anything else."""
        if not isinstance(self.value, list):
            self.complain("an array [...] should be here; export the file again")
            return
        for index, value in enumerate(self.value):
            yield JsonValue(value, self.source, (*self.place, index))

    def number(self, key: str, missing: float | None = None) -> float | None:
        """Return the number of a key; `missing` where there is none, and a complaint kept if that is None."""
        found = self.get(key) if missing is not None else self.required(key)
        if found is None:
            return missing
        if _is_number(found.value):
            return float(found.value)
        found.complain(f"'{shown_token(str(found.value))}' is not a finite number; correct it")
        return None

    def numbers(self, key: str, count: int) -> tuple[float, ...] | None:
        """Return an array of that many numbers of a key; None, and a complaint kept, if there is none."""
        found = self.required(key)
        if found is None:
            return None
        if isinstance(found.value, list) and len(found.value) == count and all(map(_is_number, found.value)):
            return tuple(map(float, found.value))
        found.complain(f"{count} finite numbers should be here; correct them")
        return None

    def text(self, key: str) -> str | None:
        """Return the text of a key; None, and a complaint kept, if there is none."""
        found = self.required(key)
        if found is None or isinstance(found.value, str):
            return None if found is None else found.value
        found.complain("a text should be here; correct it")
        return None


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= LARGEST_NUMBER  # neither NaN nor infinite; whole numbers may have any size


_SURROGATE = re.compile(rb"\\u[dD][89a-fA-F]")


def _half_of_pair(data: bytes, value: Any) -> int | None:
    """Return where a text begins to have half a surrogate pair: files and stores could not hold it; None: nowhere."""
    first = _SURROGATE.search(data)
    if first is None:
        return None
    try:
        json.dumps(value, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        return first.start()
    return None


def read_json(path: Path, faults: Faults) -> JsonValue | None:
    """Return the value of a JSON file; None, and a complaint kept, if it is no such file."""
    data, complaints = read_bytes(path, faults.shown)
    faults.complaints += complaints
    if data is None:
        return None
    data = foreign_bytes(data)
    if data.count(b",") + data.count(b"[") + data.count(b"{") > MOST_VALUES:
        faults.complain(f"there are more than {MOST_VALUES} values, which are not read; divide the project")
        return None
    try:
        value = json.loads(data)
        half = _half_of_pair(data, value)
        if half is None:
            return JsonValue(value, JsonText(data, faults))
        message = "a text has half a character (a \\u of D800 to DFFF alone), which no name can have; correct it"
        faults.complain(message, data.count(b"\n", 0, half) + 1)
    except json.JSONDecodeError as fault:
        faults.complain(f"{json_fault(fault)}; export the file again", fault.lineno, fault.colno)
    except UnicodeDecodeError as fault:
        faults.complain("this is not JSON (not UTF-8); save it as UTF-8", data.count(b"\n", 0, fault.start) + 1)
    except (RecursionError, ValueError):
        faults.complain("this is not JSON of a known kind (nested too deeply, or a number too long)", 1)
    return None
