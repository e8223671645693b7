"""The equations of all kinds of observation, as the modules of this folder list them.

Their order, which is that of the rows of the adjustment, is the order of the table in
`orip.records.observation_kinds`.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

import orip.bundle.kinds
from orip.bundle.kinds.observation import KindEquations
from orip.records.block import Block
from orip.records.observation_kinds import OBSERVATION_KINDS


def _listed_by_modules() -> Iterator[KindEquations]:
    folder = orip.bundle.kinds
    for module in iter_modules(folder.__path__, f"{folder.__name__}."):
        if module.name != __name__:
            yield from getattr(import_module(module.name), "KINDS", ())


_BY_NAME = {equations.kind.name: equations for equations in _listed_by_modules()}

KINDS: tuple[KindEquations, ...] = tuple(_BY_NAME[name] for name in OBSERVATION_KINDS)


def require_enough_digits(block: Block) -> None:
    """Refuse observations that the normal equations have not enough digits for, at the starting values of a block.

    Raises
    ------
    InputError
    """
    for kind in KINDS:
        kind.refuse(block)
