"""What is wrong with a foreign file, gathered while it is read."""

from __future__ import annotations

import math

from msgspec import Struct, field

from orip.errors import Complaint
from orip.files.text.decimal_numbers import parse_number
from orip.files.text.shown import printable, shown_token

MOST_COMPLAINTS = 200
"""More are not kept of a file: it is probably of another kind."""

LARGEST_COUNT = 1 << 53
"""Whole numbers above are not held exactly by programs that read them as decimals."""


class Faults(Struct):
    """Complaints about one file, and words of it read as numbers.

    Parameters
    ----------
    shown : str
        The file as the user would name it.
    """

    shown: str
    complaints: list[Complaint] = field(default_factory=list)

    def complain(self, message: str, line: int | None = None, column: int | None = None) -> None:
        """Keep a complaint, unless there are `MOST_COMPLAINTS`."""
        if len(self.complaints) < MOST_COMPLAINTS:
            self.complaints.append(Complaint(printable(message), self.shown, line, column))

    def decimal(self, word: str, what: str, line: int | None) -> float:
        """Return a word as a number; NaN, and a complaint kept, if it is not one."""
        try:
            return parse_number(word)
        except ValueError as fault:
            self.complain(f"{what}: {fault}", line)
            return math.nan

    def decimals(self, text: str, count: int, what: str, line: int | None) -> tuple[float, ...] | None:
        """Return numbers separated by blanks; None, and complaints kept, unless there are as many, all finite."""
        words = text.split(maxsplit=count)
        if len(words) != count or len(words[-1].split()) != 1:
            found = len(text.split()) if len(text) < 1 << 16 else "more"
            self.complain(f"{what}: {count} numbers should be here, {found} found; write {count}", line)
            return None
        values = tuple(self.decimal(word, what, line) for word in words)
        return None if any(map(math.isnan, values)) else values

    def whole(self, word: str, what: str, line: int | None, least: int = 0) -> int | None:
        """Return a word as a whole number; None, and a complaint kept, if it is not one or less than `least`."""
        text = word.strip()
        if (
            text.removeprefix("-").isascii()
            and text.removeprefix("-").isdigit()
            and len(text) < len(str(LARGEST_COUNT))
        ):
            number = int(text)
            if number >= least:
                return number
        self.complain(f"{what}: '{shown_token(word)}' is not a whole number from {least} on; correct it", line)
        return None
