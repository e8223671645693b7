"""Which functions of the program have to do with partials: found by reading the source, whatever their names are.

A function is found if the type that it returns holds partials, if it reads partials of another one, or if its name or
docstring speaks of them. A type holds partials if it has arrays named `by_...`, `partials` or `derivative`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import orip

PACKAGES = ("bundle", "geometry", "interior", "mistakes", "multimodel", "prelim", "records")

_FIELD = re.compile(r"^by_[a-z]|partials$|derivative$")
_SPOKEN_OF = re.compile(r"\bpartials?\b(?! blocks?\b)|\bderivatives?\b|\bjacobian|\brates\b")
_MAPPED = "Mapped"
"""The tuple of coordinates and their partials in `orip.interior.distortion`."""


@cache
def functions_with_partials() -> frozenset[str]:
    """Return the full names of all functions and methods that have to do with partials, abstract ones left out."""
    modules = dict(_modules())
    types = {_MAPPED, *(name for tree in modules.values() for name in _types_with_partials(tree))}
    fields = {field for tree in modules.values() for found in _classes(tree) for field in _partials_of(found)}
    return frozenset(
        f"{module}.{name}"
        for module, tree in modules.items()
        for name, function in _functions(tree, "")
        if not _is_abstract(function)
        and (_returns(function, types) or _reads(function, fields) or _speaks(name, function))
    )


def _modules() -> Iterator[tuple[str, ast.Module]]:
    root = Path(orip.__file__).parent
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root.parent).with_suffix("").parts
            yield ".".join(parts), ast.parse(path.read_text(encoding="utf-8"))


def _classes(tree: ast.Module) -> Iterator[ast.ClassDef]:
    return (node for node in tree.body if isinstance(node, ast.ClassDef))


def _types_with_partials(tree: ast.Module) -> Iterator[str]:
    return (found.name for found in _classes(tree) if any(_partials_of(found)))


def _partials_of(found: ast.ClassDef) -> Iterator[str]:
    for node in found.body:
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        if _FIELD.search(node.target.id) and "FloatArray" in ast.unparse(node.annotation):
            yield node.target.id


def _functions(node: ast.AST, owner: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef):
            yield owner + child.name, child
            yield from _functions(child, f"{owner}{child.name}.<locals>.")
        elif not isinstance(child, ast.expr):  # no function is defined in one
            yield from _functions(child, f"{owner}{child.name}." if isinstance(child, ast.ClassDef) else owner)


def _is_abstract(function: ast.FunctionDef) -> bool:
    """Tell whether a function has no body but a docstring."""
    return all(isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) for node in function.body)


def _returns(function: ast.FunctionDef, types: set[str]) -> bool:
    named = (
        {node.id for node in ast.walk(function.returns) if isinstance(node, ast.Name)} if function.returns else set()
    )
    return bool(named & types)


def _reads(function: ast.FunctionDef, fields: set[str]) -> bool:
    return any(isinstance(node, ast.Attribute) and node.attr in fields for node in ast.walk(function))


def _speaks(name: str, function: ast.FunctionDef) -> bool:
    return bool(_SPOKEN_OF.search(name.replace("_", " ").lower() + " " + (ast.get_docstring(function) or "").lower()))
