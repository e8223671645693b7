"""The fields of one line, taken one after the other; every fault is kept and reading goes on."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import TypeVar

from orip.errors import Complaint
from orip.files.text.decimal_numbers import parse_number
from orip.files.text.lines import TextLine, field_name_fault
from orip.files.text.shown import printable, shown_token
from orip.records.observations.control import ErrorLimits

Word = TypeVar("Word", bound=str)


class FieldReader:
    """Reads fields of one line by index and gathers what is wrong with them.

    Parameters
    ----------
    line : TextLine
    shown : str
        The file as the user would name it.
    """

    def __init__(self, line: TextLine, shown: str) -> None:
        self._line = line
        self._shown = shown
        self.complaints: list[Complaint] = []

    @property
    def number(self) -> int:
        """Return the line's number in the file, counted from 1."""
        return self._line.number

    @property
    def count(self) -> int:
        """Return how many fields the line has."""
        return len(self._line.fields)

    def text(self, index: int) -> str:
        """Return a field as it is written."""
        return self._line.fields[index].text

    def shown_text(self, index: int) -> str:
        """Return a field as a message shows it."""
        return shown_token(self.text(index))

    def complain(self, message: str, index: int | None = None) -> None:
        """Keep a complaint about the line, or about the field of that index."""
        column = None if index is None else self._line.fields[index].column
        self.complaints.append(Complaint(printable(message), self._shown, self.number, column))

    def has_fields(self, allowed: Sequence[int], form: str) -> bool:
        """Check how many fields there are; complain with the form that the line should have."""
        if self.count in allowed:
            return True
        if self.count > max(allowed):
            extra = max(allowed)
            message = f"'{self.shown_text(extra)}' is one field too many; the line is: {form}"
            self.complain(message, extra)
        else:
            message = f"a field is missing, {self.count} found{self.part_by_blanks()}; the line is: {form}"
            self.complaints.append(Complaint(message, self._shown, self.number, self._line.end_column))
        return False

    def part_by_blanks(self) -> str:
        """Return what to do where fields seem to be separated by commas or semicolons; "" where they are not."""
        written = " ".join(field.text for field in self._line.fields)
        mark = next((mark for mark in ",;" if mark in written), None)
        return "" if mark is None else f"; separate fields by blanks or tabs, not by '{mark}'"

    def is_heading(self, numbers: Iterable[int]) -> bool:
        """Tell whether all fields that are to be numbers begin with a letter, and complain of a heading."""
        if not all(self.text(index)[0].isalpha() for index in numbers):
            return False
        self.complain("this line has no numbers; begin a heading with ! or remove it")
        return True

    def name(self, index: int) -> str:
        """Return a field that is a name."""
        text = self.text(index)
        fault = field_name_fault(text)
        if fault is not None:
            self.complain(fault, index)
        return text

    def decimal(self, index: int) -> float:
        """Return a field that is a number; NaN, and a complaint kept, if it is not one."""
        try:
            return parse_number(self.text(index))
        except ValueError as fault:
            self.complain(str(fault), index)
            return float("nan")

    def number_or_dash(self, index: int) -> float | None:
        """Return a field that is a number or ``-`` (not known: None)."""
        return None if self.text(index) == "-" else self.decimal(index)

    def error(self, index: int, limits: ErrorLimits) -> float:
        """Return a field that is an a-priori error: 0, or of a size within the limits."""
        value = self.decimal(index)
        fault = limits.fault(value)
        if fault is not None:
            self.complain(fault, index)
        return value

    def error_or_dash(self, index: int, limits: ErrorLimits) -> float | None:
        """Return a field that is an a-priori error or ``-`` (not known: None)."""
        return None if self.text(index) == "-" else self.error(index, limits)

    def word(self, index: int, allowed: Sequence[Word], meaning: str) -> Word | None:
        """Return the one of the allowed words that a field is, in any case; None, and a complaint kept, if none."""
        written = self.text(index).upper()
        by_upper = {word.upper(): word for word in allowed}
        if written in by_upper:
            return by_upper[written]
        near = difflib.get_close_matches(shown_token(written), list(by_upper), 1)
        remedy = f"did you mean {by_upper[near[0]]}? Allowed: " if near else "write one of "
        self.complain(f"'{self.shown_text(index)}' is not {meaning}; {remedy}{', '.join(allowed)}", index)
        return None
