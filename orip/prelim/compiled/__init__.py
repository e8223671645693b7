"""The compiled inner loops of preliminary values, which need the extension `orip.prelim._kernels`."""

from __future__ import annotations

from typing import NoReturn

from orip.errors import NotCompiledError


class _Missing:
    """Stands for the extension; whoever needs a loop of it is told how to get it."""

    def __getattr__(self, _name: str) -> NoReturn:
        raise NotCompiledError


try:
    from orip.prelim import _kernels as kernels
except ImportError:  # the extension is built where there is a compiler
    kernels = _Missing()  # type: ignore[assignment]

__all__ = ["LARGEST_TURN", "is_compiled", "kernels"]

LARGEST_TURN = 0.5
"""Largest rotation of one step, radians: beyond it the linear equations no longer describe the problem."""


def is_compiled() -> bool:
    """Tell whether the extension was built."""
    return not isinstance(kernels, _Missing)
