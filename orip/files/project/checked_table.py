"""A table of orip.toml as a class whose annotations say what each key may hold, and what is wrong with a given one.

Types are those of TOML: a whole number stands for a number, and nothing else is converted. Unknown keys are faults, and
so are numbers that are not finite.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    TypeAlias,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from orip.records.project.fields import without_none

Place: TypeAlias = tuple[str | int, ...]
"""Keys and indices that lead to a value from its table."""


class Example(NamedTuple):
    """How a value may be written, for messages."""

    text: str


class Limits(NamedTuple):
    """What a value may be beyond its type.

    Attributes
    ----------
    above, least, most : float or None
        Of a number: greater than, at least, at most.
    shortest, longest : int or None
        Characters of a text, or elements of a list.
    """

    above: float | None = None
    least: float | None = None
    most: float | None = None
    shortest: int | None = None
    longest: int | None = None


class ReadBy(NamedTuple):
    """What takes a value of the right type to what the table holds; it raises ValueError, with a sentence."""

    read: Callable[[Any], Any]


class ValueFault(NamedTuple):
    """What is wrong with a value.

    Attributes
    ----------
    place : tuple of str or int
    found : object
        As it was given; for a key that is missing, the table.
    allowed : str
        A sentence; `UNKNOWN` or `MISSING`.
    """

    place: Place
    found: Any
    allowed: str


UNKNOWN, MISSING = "no such key", "no value"
"""In place of what is allowed: of a key that does not exist, and of one that has to be there."""

Check: TypeAlias = Callable[[Any, Place, list[ValueFault]], Any]
"""Returns a value as its table holds it, and adds what is wrong with it to a list."""

_REQUIRED: Any = object()
"""In place of the default of a key that has none."""


class Key(NamedTuple):
    """What a key may hold; the default of one that has to be there does not count."""

    annotation: Any
    check: Check
    default: Any
    is_required: bool
    example: str | None


class CheckedTable:
    """A table whose values have been checked; its attributes are those that a subclass annotates.

    Parameters
    ----------
    given : mapping or None
        Values by key; keys that are missing have their defaults.
    """

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        values = given or {}
        kind: type = type(self)
        self.__dict__.update(_defaults(kind))
        self.__dict__.update(values)
        self.given = frozenset(values)


Table = TypeVar("Table", bound=CheckedTable)


def keys_of(table: type) -> Mapping[str, Key]:
    """Return the keys that a class of `CheckedTable` may have, in their order."""
    return _keys(table)


def checked_table(table: type[Table], raw: Any) -> tuple[Table | None, list[ValueFault]]:
    """Return a table as it was given, None if it has faults, and these.

    Parameters
    ----------
    table : type of CheckedTable
    raw : object
        As the TOML reader gives it.
    """
    faults: list[ValueFault] = []
    found = _of_table(table)(raw, (), faults)
    return (None if faults else found), faults


@cache
def _keys(table: type) -> Mapping[str, Key]:
    hints = get_type_hints(table, include_extras=True)
    return {key: _key(hint, getattr(table, key, _REQUIRED)) for key, hint in hints.items()}


@cache
def _defaults(table: type) -> Mapping[str, Any]:
    return {name: key.default for name, key in keys_of(table).items() if not key.is_required}


def _key(annotation: Any, default: Any) -> Key:
    examples = [item.text for item in get_args(annotation) if isinstance(item, Example)]
    return Key(annotation, _check(annotation), default, default is _REQUIRED, next(iter(examples), None))


def _of_table(table: type) -> Check:
    return _check_of_table(table)


@cache
def _check_of_table(table: type) -> Check:
    keys = keys_of(table)
    required = [name for name, key in keys.items() if key.is_required]

    def check(raw: Any, place: Place, faults: list[ValueFault]) -> Any:
        if not isinstance(raw, dict):
            faults.append(ValueFault(place, raw, "a table in braces is required"))
            return None
        values = {name: keys[name].check(value, (*place, name), faults) for name, value in raw.items() if name in keys}
        faults += [ValueFault((*place, name), raw, MISSING) for name in required if name not in raw]
        faults += [ValueFault((*place, name), value, UNKNOWN) for name, value in raw.items() if name not in keys]
        return table(values)

    return check


def _check(annotation: Any) -> Check:
    """Return the check of an annotation: of the type, then of its limits, then what reads the value."""
    kind, *further = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
    kind = without_none(kind)
    limits = next((item for item in further if isinstance(item, Limits)), Limits())
    check = _of_kind(kind, limits)
    for item in further:
        if isinstance(item, ReadBy):
            check = _read_by(item.read, check)
    return check


def _of_kind(kind: Any, limits: Limits) -> Check:
    if get_origin(kind) is Annotated:
        return _check(kind)
    if get_origin(kind) in (list, tuple):
        return _list(get_origin(kind), _check(get_args(kind)[0]), limits)
    if isinstance(kind, type) and issubclass(kind, CheckedTable):
        return _of_table(kind)
    if get_origin(kind) is Literal:
        return _word(get_args(kind))
    if kind is str:
        return _text(limits)
    if kind in (int, float):
        return _number(kind, limits)
    assert kind is Any, f"no key has a {kind}"
    return lambda value, _place, _faults: value


def _read_by(read: Callable[[Any], Any], before: Check) -> Check:
    def check(value: Any, place: Place, faults: list[ValueFault]) -> Any:
        count = len(faults)
        value = before(value, place, faults)
        try:
            return read(value) if len(faults) == count else value
        except ValueError as fault:
            faults.append(ValueFault(place, value, str(fault)))
        return value

    return check


def _list(made: Callable[[list[Any]], Any], check_item: Check, limits: Limits) -> Check:
    def check(value: Any, place: Place, faults: list[ValueFault]) -> Any:
        if not isinstance(value, list):
            faults.append(ValueFault(place, value, "a list in brackets is required"))
            return value
        if limits.longest is not None and len(value) > limits.longest:
            faults.append(ValueFault(place, value, f"a list of {limits.longest} elements is required"))
            return value
        count = len(faults)
        items = [check_item(item, (*place, index), faults) for index, item in enumerate(value)]
        if len(faults) == count and limits.shortest is not None and len(value) < limits.shortest:
            faults.append(ValueFault(place, value, f"a list of {limits.shortest} elements is required"))
        return made(items)

    return check


def _word(words: Sequence[Any]) -> Check:
    quoted = [repr(word) for word in words]
    allowed = f"{', '.join(quoted[:-1])} or {quoted[-1]}" if len(quoted) > 1 else quoted[0]

    def check(value: Any, place: Place, faults: list[ValueFault]) -> Any:
        if not isinstance(value, str) or value not in words:
            faults.append(ValueFault(place, value, f"{allowed} is required"))
        return value

    return check


def _text(limits: Limits) -> Check:
    def check(value: Any, place: Place, faults: list[ValueFault]) -> Any:
        if not isinstance(value, str):
            faults.append(ValueFault(place, value, "a text in quotes is required"))
        elif limits.shortest is not None and len(value) < limits.shortest:
            faults.append(ValueFault(place, value, "a text that is not empty is required"))
        elif limits.longest is not None and len(value) > limits.longest:
            faults.append(ValueFault(place, value, f"a text of at most {limits.longest} characters is required"))
        return value

    return check


def _number(kind: type[float], limits: Limits) -> Check:
    def check(value: Any, place: Place, faults: list[ValueFault]) -> Any:
        number = _as(kind, value)
        if number is None:
            faults.append(ValueFault(place, value, f"a {'whole ' if kind is int else ''}number is required"))
            return value
        if kind is float and not math.isfinite(number):
            faults.append(ValueFault(place, value, "a finite number is required"))
        elif limits.above is not None and not number > limits.above:
            faults.append(ValueFault(place, value, f"a number above {limits.above:g} is required"))
        elif limits.least is not None and not number >= limits.least:
            faults.append(ValueFault(place, value, f"a number of at least {limits.least:g} is required"))
        elif limits.most is not None and not number <= limits.most:
            faults.append(ValueFault(place, value, f"a number of at most {limits.most:g} is required"))
        return number

    return check


def _as(kind: type[float], value: Any) -> float | None:
    """Return a number as one of a kind; None for anything else, and for what is too large for it."""
    if isinstance(value, bool) or not isinstance(value, (int, kind)):
        return None
    try:
        return kind(value)
    except OverflowError:
        return None
