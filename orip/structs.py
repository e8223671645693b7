"""A copy of a frozen structure with other values in some of its fields."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # by which names and types are checked; msgspec's own takes anything
    from dataclasses import replace
else:
    from msgspec.structs import replace

__all__ = ["replace"]
