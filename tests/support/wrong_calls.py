"""Calls of compiled functions with arguments that are wrong: what a sound call was given, one argument exchanged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest

GUARD = 64
"""Bytes before and behind each array that nobody may write."""
_MARK = 0xA5

HUGE = (2**31 - 1, -(2**31), 2**62, -(2**62))
NO_NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308)
NEVER_NUMBERS = ("1", None, 1j, [1.0], 2**2000)


class Wrong(NamedTuple):
    """A call with one wrong argument; `refused`: whether it has to end in an exception, None where it may."""

    what: str
    arguments: list[Any]
    refused: bool | None


def recorded(module: ModuleType, run: Callable[[], object], monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Return the arguments that each function of a module was called with first while something was run."""
    calls: dict[str, list[Any]] = {}
    for name in functions_of(module):
        function = getattr(module, name)

        def record(*arguments: Any, name: str = name, function: Callable[..., Any] = function) -> Any:
            calls.setdefault(name, [_copy(argument) for argument in arguments])
            return function(*arguments)

        monkeypatch.setattr(module, name, record)
    run()
    monkeypatch.undo()
    return calls


def functions_of(module: ModuleType) -> list[str]:
    """Return the names of all functions of a module."""
    return [name for name in dir(module) if not name.startswith("_") and callable(getattr(module, name))]


def call(function: Callable[..., object], arguments: Sequence[Any]) -> BaseException | None:
    """Call with arrays that have guards around them; return the exception.

    Raises
    ------
    AssertionError
        If anything was written beside an array.
    """
    made = {id(argument): _guarded(argument) for argument in arguments}
    guarded = [made[id(argument)] for argument in arguments]
    fault: BaseException | None = None
    with np.errstate(all="ignore"):
        try:
            function(*(argument for argument, _ in guarded))
        except (TypeError, ValueError, BufferError, OverflowError, MemoryError) as error:
            fault = error
    for _, memory in guarded:
        assert memory is None or ((memory[:GUARD] == _MARK).all() and (memory[-GUARD:] == _MARK).all())
    return fault


def wrong_calls(arguments: Sequence[Any], written: frozenset[int], first: int = 0) -> Iterator[Wrong]:
    """Yield calls each of which has one wrong argument, from the first one on, or a wrong number of them."""
    yield Wrong("no arguments", [], True)
    yield Wrong("one too few", list(arguments[:-1]), True)
    yield Wrong("one too many", [*arguments, 1.0], True)
    for place, argument in enumerate(arguments[first:], first):
        variants = _arrays(argument, place in written) if isinstance(argument, np.ndarray) else _numbers(argument)
        for what, variant, refused in variants:
            yield Wrong(f"argument {place}: {what}", [*arguments[:place], variant, *arguments[place + 1 :]], refused)


def overlapping(arguments: Sequence[Any], written: frozenset[int]) -> Iterator[Wrong]:
    """Yield calls in which an array that is written is another argument, too."""
    for place in sorted(written):
        for other, argument in enumerate(arguments):
            same = isinstance(argument, np.ndarray) and argument.dtype == arguments[place].dtype
            if same and other != place and argument.size and argument.size == arguments[place].size:
                yield Wrong(
                    f"arguments {place} and {other} are one",
                    [*arguments[:other], arguments[place], *arguments[other + 1 :]],
                    True,
                )


def written_by(function: Callable[..., object], arguments: Sequence[Any]) -> frozenset[int]:
    """Return the arguments that a function wants to write: those that it refuses if they are only to be read."""
    found = set()
    for place, argument in enumerate(arguments):
        if isinstance(argument, np.ndarray):
            frozen = argument.copy()
            frozen.flags.writeable = False
            given = [_copy(argument) for argument in arguments]
            given[place] = frozen
            try:
                function(*given)
            except (ValueError, BufferError):
                found.add(place)
    return frozenset(found)


def _arrays(array: np.ndarray, is_written: bool) -> Iterator[tuple[str, Any, bool | None]]:
    kinds = [kind for kind in (np.float32, np.complex128, np.int16, np.int32, np.int64, object) if kind != array.dtype]
    for kind in kinds:
        yield f"as {np.dtype(kind).name}", np.zeros(array.shape, kind), True
    for other in (None, array.tolist(), "text", 1.0):
        yield f"as {type(other).__name__}", other, True
    if array.dtype.itemsize > 1:
        yield "in the other byte order", array.astype(array.dtype.newbyteorder()), True
        yield "not aligned", _unaligned(array), True if array.size else None
    if array.size > 1:
        yield "every second element", _spread(array, 2), True
        yield "backwards", _spread(array, -1), True
    yield "as a slice of Fortran's order", np.asfortranarray(np.zeros((3, 5), array.dtype)), True
    yield "empty", array[:0], None if array.size else False
    yield "one too few", array.ravel()[:-1], None
    yield "one too many", np.append(array, np.zeros(1, array.dtype)), None
    if is_written:
        frozen = array.copy()
        frozen.flags.writeable = False
        yield "not to be written", frozen, True
    yield from _contents(array)


def _contents(array: np.ndarray) -> Iterator[tuple[str, Any, bool | None]]:
    if array.size == 0:
        return
    if array.dtype.kind == "f":
        for number in NO_NUMBERS:
            yield f"all {number}", np.full_like(array, number), None
            yield f"the first {number}", _with(array, 0, number), None
    elif array.dtype.itemsize > 1:
        limits = np.iinfo(array.dtype)
        for place in {0, array.size // 2, array.size - 1}:
            for number in (*HUGE, -1, array.size, 10**6):
                if limits.min <= number <= limits.max:
                    yield f"element {place} is {number}", _with(array, place, number), None
        yield "backwards in order", np.ascontiguousarray(array.ravel()[::-1]).reshape(array.shape), None


def _numbers(number: Any) -> Iterator[tuple[str, Any, bool | None]]:
    for other in NEVER_NUMBERS:
        yield f"as {type(other).__name__}", other, True
    yield "no number", np.nan, True
    for other in (np.inf, -np.inf, -1.0, 0.5, 0.0, 1e300, -1e300, 2**62, -(2**62), 2**70):
        yield f"{other:g}", other, None


def _with(array: np.ndarray, place: int, number: float) -> np.ndarray:
    changed = array.copy()
    changed.reshape(-1)[place] = number
    return changed


def _spread(array: np.ndarray, step: int) -> np.ndarray:
    flat = np.zeros(array.size * abs(step), array.dtype)
    flat[:: abs(step)] = array.ravel()
    return flat[::step]


def _unaligned(array: np.ndarray) -> np.ndarray:
    memory = np.zeros(array.nbytes + 1, np.uint8)
    found = memory[1:].view(array.dtype)
    found[:] = array.ravel()
    return found


def _copy(argument: Any) -> Any:
    return argument.copy() if isinstance(argument, np.ndarray) else argument


def _guarded(argument: Any) -> tuple[Any, np.ndarray | None]:
    """Return a copy of an array with guards around it; what is no plain array stays as it is."""
    is_plain = isinstance(argument, np.ndarray) and argument.flags.c_contiguous and argument.flags.aligned
    if not is_plain or argument.dtype == object or not argument.flags.writeable:
        return argument, None
    memory = np.full(argument.nbytes + 2 * GUARD, _MARK, np.uint8)
    inside = memory[GUARD : GUARD + argument.nbytes].view(argument.dtype).reshape(argument.shape)
    inside[...] = argument
    return inside, memory
