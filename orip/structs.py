"""Frozen structures: copies with other values in some fields, and what follows from one, worked out once."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Concatenate, ParamSpec, TypeVar
from weakref import ref

if TYPE_CHECKING:  # by which names and types are checked; msgspec's own takes anything
    from dataclasses import replace
else:
    from msgspec.structs import replace

__all__ = ["remembered", "replace"]

StructT = TypeVar("StructT")
FoundT = TypeVar("FoundT")
OthersP = ParamSpec("OthersP")


def remembered(
    function: Callable[Concatenate[StructT, OthersP], FoundT],
) -> Callable[Concatenate[StructT, OthersP], FoundT]:
    """Return a function that remembers what it found for a frozen structure, as long as that is there.

    The structure has ``weakref=True``; other arguments are compared as keys. What is found is not changed by those who
    ask.
    """
    known: dict[object, tuple[ref[StructT], FoundT]] = {}

    @wraps(function)
    def with_memory(of: StructT, /, *others: OthersP.args, **named: OthersP.kwargs) -> FoundT:
        key = id(of), others, tuple(sorted(named.items()))
        earlier = known.get(key)
        if earlier is not None and earlier[0]() is of:
            return earlier[1]
        found = function(of, *others, **named)
        known[key] = ref(of, lambda _: known.pop(key, None)), found
        return found

    return with_memory
