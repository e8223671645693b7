"""TOML as orip writes it: a table below its header, tables inside a table in braces, long lists one item a line."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_WIDEST = 100
"""A list that takes more columns than that is written one item a line."""


def toml_value(value: Any) -> str:
    """Return a value on one line; numbers with as few digits as give the same one back."""
    if isinstance(value, str):
        # JSON's escapes are TOML's; one character more may not stand as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_assignments(value)) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return str(value)  # numbers, dates and times


def toml_table(header: str, table: Mapping[str, Any]) -> str:
    """Return a table with its header (brackets included) and a line for each key."""
    return "\n".join([header, *(toml_assignment(key, value) for key, value in table.items())]) + "\n"


def toml_assignment(key: str, value: Any) -> str:
    """Return a key and its value, a long list on several lines."""
    return f"{toml_key(key)} = {_broken(value)}"


def toml_key(key: str) -> str:
    """Return a key, quoted where it has to be."""
    return key if _BARE_KEY.fullmatch(key) else toml_value(key)


def _assignments(table: Mapping[str, Any]) -> Iterator[str]:
    return (f"{toml_key(key)} = {toml_value(value)}" for key, value in table.items())


def _broken(value: Any) -> str:
    """Return a value; a list of tables, or one that is too wide, on several lines."""
    text = toml_value(value)
    if not isinstance(value, list) or (len(text) <= _WIDEST and not any(isinstance(item, dict) for item in value)):
        return text
    return "[\n" + "".join(f"    {toml_value(item)},\n" for item in value) + "]"
