"""The public names of orip with their signatures, a line each.

``PYTHONPATH=tests python -m api.public_names > tests/api/public_api.txt`` writes what the test compares with, after a
change of the API that was meant; CHANGELOG.md tells users of it.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cached_property
from typing import Any

from msgspec import Struct

import orip

_ATTRIBUTES = re.compile(r"^Attributes\n-+\n(.*?)(?=\n\n|\Z)", re.DOTALL | re.MULTILINE)
_ATTRIBUTE = re.compile(r"^(\w[\w, ]*) : (.+)$", re.MULTILINE)


def public_api() -> str:
    """Return the text of public_api.txt."""
    return "".join(f"{line}\n" for name in orip.__all__ for line in _described(name, getattr(orip, name)))


def _described(name: str, value: Any) -> Iterator[str]:
    if not inspect.isclass(value):
        yield f"{name}{_signature(value)}"
        return
    bases = [
        base.__name__ for base in value.__bases__ if base not in {object, Struct} and not base.__name__.startswith("_")
    ]
    yield f"class {name}({', '.join(bases)})"
    doc = inspect.getdoc(value) or ""
    if issubclass(value, Struct) or is_dataclass(value):
        yield from _fields(name, value)
    elif "\nParameters\n" in doc:  # other classes are not made by users
        yield f"    {name}{_signature(value)}"
    for listed, kind in _ATTRIBUTE.findall("".join(_ATTRIBUTES.findall(doc))):
        yield from (f"    {name}.{attribute}: {kind}" for attribute in listed.split(", "))
    yield from _members(name, value)


def _fields(name: str, value: Any) -> Iterator[str]:
    for field in inspect.signature(value).parameters.values():
        if not field.name.startswith("_"):
            default = "" if field.default is field.empty else f" = {field.default!r}"
            yield f"    {name}.{field.name}: {value.__annotations__[field.name]}{default}"


def _members(name: str, value: type) -> Iterator[str]:
    own = [base for base in value.__mro__ if base is value or base.__name__.startswith("_")]
    members = {member: found for base in reversed(own) for member, found in vars(base).items()}
    for member, found in sorted(members.items()):
        if member.startswith("_") and member != "__getitem__":
            continue
        if isinstance(found, property | cached_property):
            function = found.fget if isinstance(found, property) else found.func
            yield f"    {name}.{member} -> {inspect.signature(function).return_annotation}"
        elif isinstance(found, staticmethod | classmethod):
            yield f"    {name}.{member}{_signature(found.__func__)}"
        elif inspect.isfunction(found):
            yield f"    {name}.{member}{_signature(found)}"


def _signature(function: Any) -> str:
    return str(inspect.signature(function)).replace("'", "")


if __name__ == "__main__":
    sys.stdout.write(public_api())
