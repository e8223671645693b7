"""Long columns of names: the different ones once, and a number for each row.

A block has far more observations than photos and points. What is asked of the names of a million rows is asked of the
different names, and the answers are taken by their numbers.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, compress, count, repeat
from typing import Any, TypeVar, final, overload

import numpy as np
from numpy.typing import NDArray

from orip.arrays import BoolArray, IntArray, parts
from orip.records.names import places_of_names, record_key

T = TypeVar("T")

_FEW = 8
"""Different names up to which comparing is faster than looking up."""


@final
class CodedNames(Sequence[str]):
    """n names.

    Parameters
    ----------
    distinct : sequence of str, length m
        Without repetitions; some may not occur among the rows.
    codes : array (n,) of int
        Numbers of the rows' names among them; kept with as few bits as all names need.
    """

    __slots__ = ("_occurring", "codes", "distinct")

    def __init__(self, distinct: Sequence[str], codes: NDArray[np.integer[Any]]) -> None:
        self.distinct = tuple(distinct)
        self._occurring: tuple[str, ...] | None = None
        fewest = np.min_scalar_type(max(len(self.distinct) - 1, 0))
        self.codes: NDArray[np.unsignedinteger[Any]] = codes.astype(fewest, copy=False)

    def __len__(self) -> int:
        return len(self.codes)

    def __iter__(self) -> Iterator[str]:
        names = np.array(self.distinct, dtype=object)
        return chain.from_iterable(names[self.codes[part]].tolist() for part in parts(len(self)))

    @overload
    def __getitem__(self, at: int) -> str: ...

    @overload
    def __getitem__(self, at: slice | IntArray | BoolArray) -> CodedNames: ...

    def __getitem__(self, at: int | slice | IntArray | BoolArray) -> str | CodedNames:
        found = self.codes[at]
        return CodedNames(self.distinct, found) if isinstance(found, np.ndarray) else self.distinct[found]

    def __eq__(self, other: object) -> bool:
        if isinstance(other, CodedNames) and self.distinct == other.distinct:
            return np.array_equal(self.codes, other.codes)
        if isinstance(other, CodedNames | tuple | list):
            return len(self) == len(other) and all(map(str.__eq__, self, other))
        return NotImplemented

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __repr__(self) -> str:
        return f"CodedNames({tuple(self)!r})"

    def occurring(self) -> tuple[str, ...]:
        """Return the different names among the rows, in the order of their first ones; remembered."""
        if self._occurring is None:
            first = self.first_rows()
            there = np.flatnonzero(first < len(self))
            self._occurring = tuple(map(self.distinct.__getitem__, there[np.argsort(first[there])].tolist()))
        return self._occurring

    def first_rows(self) -> IntArray:
        """Return the first row (m,) of each different name; n for a name that no row has."""
        count = len(self)
        first = np.full(len(self.distinct), count)
        first[self.codes[::-1]] = np.arange(count - 1, -1, -1)  # the last one written stays
        return first

    def without_unused(self) -> CodedNames:
        """Return the same names without those that no row has; the others keep their order."""
        is_used = np.bincount(self.codes, minlength=len(self.distinct)) > 0
        if is_used.all():
            return self
        number = np.cumsum(is_used) - 1
        return CodedNames(tuple(compress(self.distinct, is_used.tolist())), number[self.codes])

    def numbers(self, number_of: Callable[[str], int]) -> IntArray:
        """Return the number (n,) that a function gives the name of each row."""
        return np.asarray(np.fromiter(map(number_of, self.distinct), np.int64, len(self.distinct))[self.codes])

    def places(self, place: Mapping[str, int]) -> IntArray:
        """Return the place (n,) of the name of each row; -1 where it has none."""
        places = np.fromiter(map(place.get, self.distinct, repeat(-1)), np.int64, len(self.distinct))
        return np.asarray(places[self.codes])

    def places_among(self, names: tuple[str, ...]) -> IntArray:
        """Return the place (n,) of the name of each row among other names, -1 where it is not there."""
        if self.distinct[: len(names)] == names:  # nearly always: the points of a block, and what measurements add
            places = self.codes.astype(np.int64)
            return places if len(names) == len(self.distinct) else np.where(places < len(names), places, -1)
        return self.places(places_of_names(names))

    def where(self, is_meant: Callable[[str], bool]) -> BoolArray:
        """Return for which rows (n,) a condition on the name holds."""
        meant = np.fromiter(map(is_meant, self.distinct), np.bool_, len(self.distinct))
        chosen = np.flatnonzero(meant).tolist()
        if len(chosen) > _FEW:
            return np.asarray(meant[self.codes])
        # of a kind or a component: comparing is many times faster than looking up
        found = np.zeros(len(self), dtype=bool)
        for number in chosen:
            found |= self.codes == number
        return found

    def values(self, value_of: Callable[[str], T]) -> list[T]:
        """Return for each row the value that a function gives its name."""
        known = list(map(value_of, self.distinct))
        return list(map(known.__getitem__, self.codes.tolist()))


def coded(names: Sequence[str]) -> CodedNames:
    """Return names as `CodedNames`, the different ones in the order in which they come first."""
    if isinstance(names, CodedNames):
        return names
    number: defaultdict[str, int] = defaultdict(count().__next__)
    codes = np.fromiter(map(number.__getitem__, names), np.int64, len(names))
    return CodedNames(tuple(number), codes)


def joined(parts: Iterable[Sequence[str]]) -> CodedNames:
    """Return several columns of names as one."""
    columns = [column for column in map(coded, parts) if len(column)]
    if len(columns) < 2:
        return columns[0] if columns else CodedNames((), np.zeros(0, dtype=np.int64))
    first, *others = columns
    # the first column has mostly nearly all names: they keep their numbers
    known = places_of_names(first.distinct)
    further: dict[str, int] = {}
    for name in chain.from_iterable(column.distinct for column in others):
        if name not in known:
            further.setdefault(name, len(known) + len(further))
    number = {**known, **further} if further else known
    distinct = (*first.distinct, *further) if further else first.distinct
    codes = [first.codes, *(column.places(number).astype(np.uint32) for column in others)]
    return CodedNames(distinct, np.concatenate(codes))


def repeated(name: str, count: int) -> CodedNames:
    """Return one name for so many rows."""
    return CodedNames((name,), np.zeros(count, dtype=np.uint8))


def rows_of_records(names: Sequence[str]) -> dict[str, IntArray]:
    """Return the rows of each record among names, in their order, by its `record_key`."""
    column = coded(names)
    number: dict[str, int] = {}
    place = column.numbers(lambda name: number.setdefault(record_key(name), len(number)))
    rows = np.split(np.argsort(place, kind="stable"), np.cumsum(np.bincount(place, minlength=len(number)))[:-1])
    found = zip(number, rows, strict=False)  # without names there is still one part
    return {key: of_record for key, of_record in found if len(of_record)}
