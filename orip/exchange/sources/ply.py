"""Vertices of binary PLY files (little endian)."""

from __future__ import annotations

from typing import Any

import numpy as np

from orip.exchange.sources.faults import Faults
from orip.files.text.shown import shown_token

Vertices = np.ndarray[Any, Any]
"""Array (n,) whose fields are the properties of the vertices."""

_TYPES = {
    "char": "<i1", "int8": "<i1", "uchar": "<u1", "uint8": "<u1",
    "short": "<i2", "int16": "<i2", "ushort": "<u2", "uint16": "<u2",
    "int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4",
    "float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8",
}  # fmt: skip

_LONGEST_HEAD = 4096
_END = b"end_header\n"


def read_vertices(data: bytes, needed: tuple[str, ...], faults: Faults) -> Vertices | None:
    """Return the vertices of a file.

    Parameters
    ----------
    data : bytes
        The file.
    needed : tuple of str
        Properties that have to be there.
    faults : Faults
        Takes the complaints; None is returned with them.
    """
    length = data.find(_END, 0, _LONGEST_HEAD)
    if not data.startswith(b"ply") or length < 0:
        faults.complain("this is not a PLY file; save the project again", 1)
        return None
    found = _layout(data[:length].decode("ascii", errors="replace").splitlines(), faults)
    if found is None:
        return None
    count, properties = found
    missing = [name for name in needed if name not in dict(properties)]
    if missing or len(dict(properties)) < len(properties):
        said = f"no property {missing[0]}" if missing else "a property twice"
        faults.complain(f"the vertices have {said}; this layout is not known", 1)
        return None
    layout = np.dtype(properties)
    begin = length + len(_END)
    if count * layout.itemsize > len(data) - begin:
        room = (len(data) - begin) // layout.itemsize
        faults.complain(
            f"{count} vertices are announced, and there is room for {room} after byte {begin}: the file is cut off "
            "or its head is wrong; save the project again",
            1,
        )
        return None
    return np.frombuffer(data, dtype=layout, count=count, offset=begin)


def _layout(head: list[str], faults: Faults) -> tuple[int, list[tuple[str, str]]] | None:
    """Return the number of vertices, the first element, and names and types of their properties."""
    if "format binary_little_endian 1.0" not in head:
        faults.complain("only binary PLY files (little endian) are read; save the project again", 2)
        return None
    count, properties = None, []
    for number, line in enumerate(head, start=1):
        words = line.split()
        if words[:1] == ["element"]:
            if count is not None:
                break
            is_vertex = len(words) == 3 and words[1] == "vertex"
            count = faults.whole(words[2], "number of vertices", number) if is_vertex else None
            if count is None:
                faults.complain("the first element has to be 'element vertex' and its number", number)
                return None
        elif words[:1] == ["property"] and count is not None:
            if len(words) != 3 or words[1] not in _TYPES:
                faults.complain(f"the property '{shown_token(line)}' is of no known type", number)
                return None
            properties.append((words[2], _TYPES[words[1]]))
    if count is None or not properties:
        faults.complain("there are no vertices in the head of the file; save the project again", 1)
        return None
    return count, properties
