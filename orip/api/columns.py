"""The arrays of one table that a caller hands over: shapes, types and numbers, and all that is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orip.arrays import BoolArray, FloatArray
from orip.errors import Complaint
from orip.files.text.decimal_numbers import LARGEST_NUMBER, parse_number
from orip.files.text.shown import printable, shown_token
from orip.records.names import name_fault

_MOST_OF_A_COLUMN = 20
"""Complaints of one array that are given one by one."""

Element = TypeVar("Element", bound=np.generic)


class Columns:
    """Takes the arrays of one table and keeps what is wrong with them.

    Parameters
    ----------
    table : str
        What it is called in messages, such as "photo_points".
    """

    def __init__(self, table: str) -> None:
        self.table = table
        self.complaints: list[Complaint] = []
        self.count: int | None = None
        """Rows, as the first array of names has them; None: it cannot be told."""
        self._first = ""

    def names(self, column: str, given: ArrayLike, *, may_be_one: bool = False) -> list[str] | None:
        """Return names, one a row; None, and complaints kept, where they are not fit for use.

        Parameters
        ----------
        column : str
        given : (n,) of str
        may_be_one : bool
            A single text stands for all rows.
        """
        found = [given] * (self.count or 0) if may_be_one and isinstance(given, str) else self._listed(column, given)
        if found is None or not self._has_length(column, len(found)):
            return None
        faults = [(row, fault) for row, name in enumerate(found) if (fault := _fault_of(name)) is not None]
        self.complain_of(column, faults)
        return None if faults else [str(name) for name in found]

    def numbers(
        self, column: str, given: ArrayLike, width: int | None = None, *, unknown: bool = False
    ) -> FloatArray | None:
        """Return numbers, a row for each name; None, and complaints kept, where they are not fit for use.

        Parameters
        ----------
        column : str
        given : array (n,) or (n, width)
        width : int or None
            None: one number a row.
        unknown : bool
            NaN stands for what is not known, and one number or row for all of them. Numbers are finite otherwise.
        """
        found = self.array(column, given, width, may_be_one=unknown)
        if found is None:
            return None
        fit = np.abs(np.where(np.isnan(found), 0.0, found) if unknown else found) <= LARGEST_NUMBER
        wrong = [tuple(map(int, index)) for index in np.argwhere(~fit)]
        self.complain_of(column, [(index if width else index[0], _fault_of_number(found[index])) for index in wrong])
        return None if wrong else found

    def array(
        self, column: str, given: ArrayLike, width: int | None = None, *, may_be_one: bool = False
    ) -> FloatArray | None:
        """Return an array (n,) or (n, width) of any numbers; None, and a complaint kept, where it is none.

        Parameters
        ----------
        may_be_one : bool
            Anything that NumPy can broadcast to the shape will do.
        """
        return self._shaped(column, given, np.float64, width, may_be_one=may_be_one)

    def flags(self, column: str, given: ArrayLike, width: int) -> BoolArray | None:
        """Return an array (n, width) of bool; None, and a complaint kept, where it is none."""
        return self._shaped(column, given, np.bool_, width, may_be_one=False)

    def complain(self, message: str, column: str = "", row: object = None) -> None:
        """Keep a complaint about the table, about an array, or about an element of it."""
        index = "" if row is None else f"[{', '.join(map(str, row)) if isinstance(row, tuple) else row}]"
        self.complaints.append(Complaint(printable(message), f"{self.table}{'.' if column else ''}{column}{index}"))

    def _listed(self, column: str, given: ArrayLike) -> list[Any] | None:
        if self._masks(column, given):
            return None
        found = np.asarray(given, dtype=object)
        if found.ndim != 1:
            self.complain(f"has the shape {found.shape}; a list of names is needed", column)
            return None
        return list(found)

    def _shaped(
        self, column: str, given: ArrayLike, dtype: type[Element], width: int | None, *, may_be_one: bool
    ) -> NDArray[Element] | None:
        if self._masks(column, given):
            return None
        wanted = "(n,)" if width is None else f"(n, {width})"
        try:
            found = np.asarray(given)
        except ValueError:  # rows of different lengths
            self.complain(f"is not an array; its shape is {wanted}", column)
            return None
        kinds = "b" if dtype is np.bool_ else "iuf"
        if found.dtype.kind not in kinds and found.size:
            what = "True and False" if dtype is np.bool_ else "numbers"
            self.complain(f"is an array of {found.dtype}; {what} are needed", column)
            return None
        if self.count is None:
            return None
        shape = (self.count,) if width is None else (self.count, width)
        if may_be_one and _can_be_broadcast(found.shape, shape):
            return np.broadcast_to(found.astype(dtype), shape)
        if found.shape != shape and found.size + self.count:
            as_many = f" as {self._first} has {self.count} rows" if self._first else ""
            self.complain(f"has the shape {found.shape}; {shape} is needed{as_many}", column)
            return None
        return found.astype(dtype).reshape(shape)

    def _masks(self, column: str, given: ArrayLike) -> bool:
        """Return whether elements are masked; they are complained of, as NumPy would take what is under the mask."""
        masked = np.argwhere(np.ma.getmaskarray(given)) if isinstance(given, np.ma.MaskedArray) else ()
        places = [tuple(map(int, index)) for index in masked]
        message = "is masked; leave out the row, or write a value"
        self.complain_of(column, [(place if len(place) > 1 else place[0], message) for place in places])
        return bool(places)

    def _has_length(self, column: str, length: int) -> bool:
        if self.count is None:
            self.count, self._first = length, f"{self.table}.{column}"
        if length != self.count:
            self.complain(f"has {length} rows; {self.count} are needed as {self._first} has them", column)
        return length == self.count

    def complain_of(self, column: str, faults: Sequence[tuple[object, str]]) -> None:
        """Keep complaints about rows or elements, (index, message), the first of them one by one."""
        for row, fault in faults[:_MOST_OF_A_COLUMN]:
            self.complain(fault, column, row)
        if (more := len(faults) - _MOST_OF_A_COLUMN) > 0:
            self.complain(f"and {more} more of this kind", column)


def _fault_of_number(number: float) -> str:
    """Say what a measurement file would say of a number that is not fit."""
    try:
        parse_number(repr(float(number)))
    except ValueError as fault:
        return str(fault)
    return ""


def _fault_of(name: object) -> str | None:
    if not isinstance(name, str):
        return f"{shown_token(repr(name))} is not text; a name is text"
    fault = name_fault(name)
    return None if fault is None else f"{fault}; choose another name"


def _can_be_broadcast(given: tuple[int, ...], wanted: tuple[int, ...]) -> bool:
    try:
        return np.broadcast_shapes(given, wanted) == wanted
    except ValueError:
        return False
