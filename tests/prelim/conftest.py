"""Fixtures of the tests of preliminary values."""

from __future__ import annotations

import pytest
from compiled_cases import WITH_LOOPS


@pytest.fixture
def without_loops(monkeypatch: pytest.MonkeyPatch):
    """Return what does something once with the loops and once without."""

    def both(do):
        with_loops = do()
        for module in WITH_LOOPS:
            monkeypatch.setattr(module, "is_compiled", lambda: False)
        return with_loops, do()

    return both
