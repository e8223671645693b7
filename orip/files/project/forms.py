"""What a value of orip.toml may be: each form reads a value as `tomllib` gives it, and notes what is wrong with it.

Nothing is converted except whole numbers to numbers: a text that looks like a number is a mistake worth showing.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

from msgspec import Struct

Place = tuple[str | int, ...]
"""Keys and indices that lead to a value."""


class WrongValue(Struct, frozen=True):
    """A value that is not allowed where it stands."""

    place: Place
    found: Any
    allowed: str


class UnknownKey(Struct, frozen=True):
    """A key that its table does not have; the last of the place."""

    place: Place


class MissingKey(Struct, frozen=True):
    """A key that its table should have; the last of the place."""

    place: Place


Finding = WrongValue | UnknownKey | MissingKey


LARGEST_WHOLE = 10**15 - 1
"""Stores hold more, but other programs take whole numbers of JSON for decimals."""


class Form(Struct, frozen=True):
    """The form of a value."""

    @abstractmethod
    def read(self, value: Any, place: Place, findings: list[Finding]) -> Any:
        """Return the value; what is wrong with it is added to `findings`, and then the result has no meaning."""


class Number(Form, frozen=True):
    """A number; limits as those of `orip.records.fields.Field`."""

    is_whole: bool = False
    above: float | None = None
    least: float | None = None
    most: float | None = None

    def read(self, value: Any, place: Place, findings: list[Finding]) -> Any:
        """Return an int if it has to be whole, else a float."""
        number = _number(value, is_whole=self.is_whole)
        fault = ("a whole number" if self.is_whole else "a number") if number is None else self._fault(number)
        if fault is not None:
            findings.append(WrongValue(place, value, f"{fault} is required"))
        return number

    def _fault(self, number: float) -> str | None:
        if isinstance(number, float) and not math.isfinite(number):
            return "a finite number"
        if isinstance(number, int) and abs(number) > LARGEST_WHOLE:
            return f"a whole number of at most {len(str(LARGEST_WHOLE))} digits"
        if self.most is not None and number > self.most:
            return f"a number of at most {self.most:g}"
        if self.least is not None and number < self.least:
            return f"a number of at least {self.least:g}"
        if self.above is not None and number <= self.above:
            return f"a number above {self.above:g}"
        return None


def _number(value: Any, *, is_whole: bool) -> float | None:
    """Return a number as int or float; None for anything else, and for what is too large for a float."""
    if isinstance(value, bool) or not isinstance(value, int | (int if is_whole else float)):
        return None
    try:
        return value if is_whole else float(value)
    except OverflowError:
        return None


class Text(Form, frozen=True):
    """A text of some length."""

    shortest: int = 0
    longest: int | None = None
    is_one_line: bool = False

    def read(self, value: Any, place: Place, findings: list[Finding]) -> Any:
        """Return the text."""
        fault = self.fault(value) if isinstance(value, str) else "a text in quotes is required"
        if fault is not None:
            findings.append(WrongValue(place, value, fault))
        return value

    def fault(self, text: str) -> str | None:
        """Return what is required of a text; None if it is so."""
        if len(text) < self.shortest:
            return "a text that is not empty is required"
        if self.longest is not None and len(text) > self.longest:
            return f"a text of at most {self.longest} characters is required"
        if self.is_one_line and not text.isprintable():
            return "only a text on one line is allowed"
        return None


class Choice(Form, frozen=True):
    """One of several texts."""

    allowed: tuple[str, ...]

    def read(self, value: Any, place: Place, findings: list[Finding]) -> Any:
        """Return the text."""
        if not isinstance(value, str) or value not in self.allowed:
            *others, last = map(repr, self.allowed)
            listed = f"{', '.join(others)} or {last}" if others else last
            findings.append(WrongValue(place, value, f"{listed} is required"))
        return value


class OwnForm(Form, frozen=True):
    """A value that a function reads, which raises ValueError with what is allowed."""

    function: Callable[[Any], Any]

    def read(self, value: Any, place: Place, findings: list[Finding]) -> Any:
        """Return what the function makes of the value."""
        try:
            return self.function(value)
        except ValueError as error:
            findings.append(WrongValue(place, value, str(error)))
            return None


class ListOf(Form, frozen=True):
    """A list of values of a form, of a certain length or of any."""

    item: Form
    length: int | None = None

    def read(self, value: Any, place: Place, findings: list[Finding]) -> Any:
        """Return the list."""
        if not isinstance(value, list):
            findings.append(WrongValue(place, value, "a list in brackets is required"))
            return value
        if self.length is not None and len(value) > self.length:
            findings.append(WrongValue(place, value, f"a list of {self.length} elements is required"))
            return value
        known = len(findings)
        items = [self.item.read(item, (*place, index), findings) for index, item in enumerate(value)]
        if self.length is not None and len(value) < self.length and len(findings) == known:
            findings.append(WrongValue(place, value, f"a list of {self.length} elements is required"))
        return items


class Key(Struct, frozen=True):
    """A key of a table: the form of its value, how it may be written, and whether it must be there."""

    form: Form
    example: str = ""
    is_required: bool = False


class Table(Form, frozen=True):
    """A table with certain keys and no others."""

    keys: Mapping[str, Key]

    def read(self, value: Any, place: Place, findings: list[Finding]) -> Any:
        """Return the values of the keys that the table has."""
        if not isinstance(value, dict):
            findings.append(WrongValue(place, value, "a table in braces is required"))
            return value
        values = {}
        for name, key in self.keys.items():
            if name in value:
                values[name] = key.form.read(value[name], (*place, name), findings)
            elif key.is_required:
                findings.append(MissingKey((*place, name)))
        if len(values) < len(value):
            findings += [UnknownKey((*place, name)) for name in value if name not in self.keys]
        return values

    def around(self, place: Place) -> Table:
        """Return the innermost table on the way that keys and indices lead."""
        form: Form = self
        table = self
        for part in place:
            if isinstance(form, ListOf):
                form = form.item
            elif isinstance(form, Table):
                form = form.keys[str(part)].form
            table = form if isinstance(form, Table) else table
        return table
