"""XML as a tree of elements that know their lines, and elements' contents replaced where every other byte stays."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from xml.parsers import expat

from msgspec import Struct, field

from orip.errors import InputError
from orip.exchange.sources.text import Faults
from orip.files.text.lines import DOS_END, foreign_bytes, read_bytes
from orip.files.text.regular_file import UTF_16
from orip.files.text.shown import shown_token

# Document types and entities are refused: no format read here has them, and they can make a small file expand without
# bound. Parsed by expat itself, as the trees of `xml.etree` do not know lines.

MOST_ELEMENTS = 3_000_000
"""Elements that a tree may have; in memory each of them is many times larger than in the file."""

_DEEPEST = 60


class XmlElement(Struct):
    """An element: its tag, attributes, own text, children and the line that it begins in."""

    tag: str
    line: int
    attributes: dict[str, str]
    text: str = ""
    children: list[XmlElement] = field(default_factory=list)

    def child(self, path: str) -> XmlElement | None:
        """Return the first descendant of a path such as ``Externe/Centre``; None if there is none."""
        element: XmlElement | None = self
        for tag in path.split("/"):
            element = next((child for child in element.children if child.tag == tag), None) if element else None
        return element

    def all(self, tag: str) -> Iterator[XmlElement]:
        """Iterate over the children of a tag."""
        return (child for child in self.children if child.tag == tag)

    def within(self, tag: str) -> Iterator[XmlElement]:
        """Iterate over all descendants of a tag, in the order of the file."""
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.within(tag)


class _RefusedError(Exception):
    """The text has what is refused."""


class _TreeBuilder:
    """Takes the events of expat."""

    def __init__(self, parser: expat.XMLParserType, parts: Mapping[str, Callable[[XmlElement], None]]) -> None:
        self._parser = parser
        self._parts = parts
        self._open: list[XmlElement] = []
        self._texts: list[list[str]] = []
        self._kept = 0
        self.root: XmlElement | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        element = XmlElement(tag, self._parser.CurrentLineNumber, attributes)
        self._kept += 1
        if self._kept > MOST_ELEMENTS or len(self._open) > _DEEPEST:
            message = f"there are more elements in one another, or in all, than a file of this kind has ({tag})"
            raise _RefusedError(message)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)
        self._texts.append([])

    def end(self, tag: str) -> None:
        element = self._open.pop()
        element.text = "".join(self._texts.pop())  # as a whole: a long text comes in thousands of pieces
        take = self._parts.get(tag)
        if take is not None and self._open:
            siblings = self._open[-1].children
            siblings.pop()
            self._kept -= 1 + len(element.children)
            take(element)

    def text(self, data: str) -> None:
        self._texts[-1].append(data)

    def doctype(self, name: str, *_: object) -> None:
        message = f"a document type is declared (<!DOCTYPE {shown_token(name)}); remove it, entities are not read"
        raise _RefusedError(message)


def read_xml(
    path: Path, faults: Faults, parts: Mapping[str, Callable[[XmlElement], None]] | None = None
) -> XmlElement | None:
    """Return the root of an XML file; None, and a complaint kept, if it is no such file.

    Parameters
    ----------
    faults : Faults
        Takes the complaints.
    parts : mapping of tag to function, optional
        Elements of these tags are given to their function as soon as they are complete, and are not in the tree.
    """
    data, complaints = read_bytes(path, faults.shown)
    faults.complaints += complaints
    return None if data is None else xml_of(data, faults, parts)


_ENCODING = re.compile(rb"""\A(\s*<\?xml[^>]*?encoding\s*=\s*)(?:"[^"]*"|'[^']*')""")


def _as_utf_8(data: bytes) -> bytes:
    """Return XML without what DOS writes at its end; UTF-16 as UTF-8, and so declared."""
    if data.startswith(UTF_16):
        return _ENCODING.sub(rb'\1"UTF-8"', foreign_bytes(data))
    return data.removesuffix(DOS_END)


def xml_of(
    data: bytes, faults: Faults, parts: Mapping[str, Callable[[XmlElement], None]] | None = None
) -> XmlElement | None:
    """Return the root of an XML text, as `read_xml`."""
    parser = expat.ParserCreate()
    builder = _TreeBuilder(parser, parts or {})
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.text
    parser.StartDoctypeDeclHandler = builder.doctype
    try:
        parser.Parse(_as_utf_8(data), True)
    except _RefusedError as fault:
        faults.complain(str(fault), parser.CurrentLineNumber)
        return None
    except expat.ExpatError as fault:
        message = f"this is not XML ({expat.ErrorString(fault.code)}); export the file again"
        faults.complain(message, fault.lineno, fault.offset + 1)
        return None
    except (LookupError, ValueError) as fault:
        faults.complain(f"the encoding of this XML cannot be read ({fault}); save it as UTF-8", 1)
        return None
    return builder.root


class XmlFields:
    """Values of elements and attributes; what is missing or wrong is complained of with its line."""

    def __init__(self, faults: Faults) -> None:
        self.faults = faults

    def required(self, element: XmlElement, path: str) -> XmlElement | None:
        """Return a descendant; None, and a complaint kept, if it is missing."""
        found = element.child(path)
        if found is None:
            self.faults.complain(f"<{shown_token(element.tag)}> has no <{path}>; export the file again", element.line)
        return found

    def text(self, element: XmlElement, path: str) -> str | None:
        """Return the text of a required descendant, without blanks and quotes around it."""
        found = self.required(element, path)
        return None if found is None else plain(found.text)

    def decimals(self, element: XmlElement, path: str, count: int) -> tuple[float, ...] | None:
        """Return the numbers of a required descendant; None if there are not as many."""
        found = self.required(element, path)
        return None if found is None else self.faults.decimals(found.text, count, f"<{path}>", found.line)

    def decimal(self, element: XmlElement, path: str) -> float | None:
        """Return the number of a required descendant."""
        found = self.decimals(element, path, 1)
        return None if found is None else found[0]

    def optional(self, element: XmlElement, path: str, missing: float = 0.0) -> float:
        """Return the number of a descendant; `missing` where there is none, or where it is not a number."""
        if element.child(path) is None:
            return missing
        found = self.decimal(element, path)
        return missing if found is None else found

    def attribute(self, element: XmlElement, name: str) -> str | None:
        """Return a required attribute; None, and a complaint kept, if it is missing."""
        value = element.attributes.get(name)
        if value is None:
            message = f"<{shown_token(element.tag)}> has no attribute '{name}'; export the file again"
            self.faults.complain(message, element.line)
        return value

    def attribute_decimal(self, element: XmlElement, name: str) -> float | None:
        """Return the number of a required attribute; None, and a complaint kept, if it is not one."""
        value = self.attribute(element, name)
        if value is None:
            return None
        found = self.faults.decimals(value, 1, f"'{name}' of <{element.tag}>", element.line)
        return None if found is None else found[0]

    def attribute_whole(self, element: XmlElement, name: str, least: int = 0) -> int | None:
        """Return the whole number of a required attribute; None, and a complaint kept, if it is not one."""
        value = self.attribute(element, name)
        return None if value is None else self.faults.whole(value, f"'{name}' of <{element.tag}>", element.line, least)


def plain(text: str) -> str:
    """Return a text without blanks and quotes around it."""
    return text.strip().removeprefix('"').removesuffix('"')


def is_true(word: str | None, *, missing: bool) -> bool:
    """Return whether an attribute says ``true``, ``True`` or ``1``."""
    return missing if word is None else word.strip().lower() in ("true", "1")


_TAG = re.compile(rb"""<[^"'>]*(?:"[^"]*"[^"'>]*|'[^']*'[^"'>]*)*>""")

SAME = 1e-11
"""Relative to the largest of the numbers; what was written and read again differs by less."""


class PlacedElement(Struct):
    """An element and its place in the bytes of a file.

    Parameters
    ----------
    attributes : mapping of str to str
    begin : int
        Byte of its start tag.
    inside, after : int
        Bytes between which its content is; equal for an empty element ``<a/>``.
    end : int
        Byte after its end tag.
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
        self.data = _as_utf_8(data)
        self.root = _placed(self.data)
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
