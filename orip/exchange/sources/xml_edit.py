"""Contents of XML elements put in the place of old ones; every other byte of the file stays as it is."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from xml.parsers import expat

from msgspec import Struct, field

from orip.errors import InputError
from orip.exchange.sources.faults import Faults
from orip.exchange.sources.xml_tree import xml_of

_TAG = re.compile(rb"""<[^"'>]*(?:"[^"]*"[^"'>]*|'[^']*'[^"'>]*)*>""")

SAME = 1e-11
"""Relative to the largest of the numbers; what was written and read again differs by less."""


class PlacedElement(Struct):
    """An element and its place in the bytes of a file.

    Parameters
    ----------
    tag : str
    attributes : mapping of str to str
    begin : int
        Byte of its start tag.
    inside, after : int
        Bytes between which its content is; equal for an empty element ``<a/>``.
    end : int
        Byte after its end tag.
    children : list of PlacedElement
    """

    tag: str
    attributes: Mapping[str, str]
    begin: int
    inside: int
    after: int = 0
    end: int = 0
    children: list[PlacedElement] = field(default_factory=list)

    def all(self, path: str) -> Iterator[PlacedElement]:
        """Iterate over the descendants of a path such as ``Externe/Centre``."""
        tag, _, rest = path.partition("/")
        for child in self.children:
            if child.tag == tag:
                yield from child.all(rest) if rest else (child,)

    def within(self, tag: str) -> Iterator[PlacedElement]:
        """Iterate over all descendants of a tag."""
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.within(tag)


class XmlEdit:
    """A file of XML, and what is to be changed in it.

    Parameters
    ----------
    data : bytes
    shown : str or None
        The file, as the user would name it; None: it was read without complaints already.

    Raises
    ------
    InputError
        If it is no XML, or has what is refused when it is read.
    """

    def __init__(self, data: bytes, shown: str | None = None) -> None:
        faults = Faults(shown or "")
        if shown is not None and xml_of(data, faults) is None:
            raise InputError(faults.complaints)
        self.data = data
        self.root = _placed(data)
        self._changes: list[tuple[int, int, bytes]] = []

    def numbers(self, element: PlacedElement) -> tuple[float, ...]:
        """Return the numbers in an element, none where it has other words."""
        try:
            return tuple(float(word) for word in self.data[element.inside : element.after].split())
        except ValueError:
            return ()

    def replace(self, element: PlacedElement, values: Sequence[float], *, size: float | None = None) -> bool:
        """Put numbers in the place of others unless these are equal up to rounding; return whether they are not.

        Parameters
        ----------
        element : PlacedElement
        values : sequence of float
        size : float, optional
            The largest of the numbers, if that is not given.
        """
        old = self.numbers(element)
        limit = SAME * (max([1e-300, *map(abs, values)]) if size is None else size)
        if len(old) == len(values) and all(
            abs(first - second) <= limit for first, second in zip(old, values, strict=True)
        ):
            return False
        text = " ".join(repr(float(value)) for value in values)
        self._changes.append((element.inside, element.after, text.encode()))
        return True

    def insert(self, element: PlacedElement, text: str) -> None:
        """Put text behind what is in an element that is not empty."""
        self._changes.append((element.after, element.after, text.encode()))

    def remove(self, element: PlacedElement) -> None:
        """Take an element out."""
        self._changes.append((element.begin, element.end, b""))

    def result(self) -> bytes:
        """Return the file with its changes."""
        pieces, place = [], 0
        for begin, end, text in sorted(self._changes, key=lambda change: change[:2]):
            pieces += [self.data[place:begin], text]
            place = end
        return b"".join([*pieces, self.data[place:]])


def _placed(data: bytes) -> PlacedElement:
    top = PlacedElement("", {}, 0, 0, len(data), len(data))
    stack = [top]
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        begin = parser.CurrentByteIndex
        found = _TAG.match(data, begin)
        element = PlacedElement(tag, attributes, begin, begin if found is None else found.end())
        stack[-1].children.append(element)
        stack.append(element)

    def end(_tag: str) -> None:
        element = stack.pop()
        is_empty = data[element.inside - 2 : element.inside] == b"/>"
        element.after = element.inside if is_empty else parser.CurrentByteIndex
        found = None if is_empty else _TAG.match(data, element.after)
        element.end = element.inside if found is None else found.end()

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.Parse(data, True)
    return top
