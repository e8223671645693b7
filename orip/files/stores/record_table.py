"""The tables of a kind of record, as they follow from the fields of its dataclass."""

from __future__ import annotations
