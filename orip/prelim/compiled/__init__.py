"""The compiled inner loops of preliminary values; NumPy does the same where there is no compiler."""

from __future__ import annotations

try:
    from orip.prelim import _kernels as kernels
except ImportError:  # the extension is built where there is a compiler
    kernels = None  # type: ignore[assignment]  # callers ask is_compiled first

__all__ = ["is_compiled", "kernels"]


def is_compiled() -> bool:
    """Tell whether the extension was built."""
    return kernels is not None
