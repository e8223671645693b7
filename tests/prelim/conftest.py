"""Fixtures of the tests of preliminary values."""

from __future__ import annotations

import pytest
from support.prelim_references import intersection as intersections
from support.prelim_references import relative, resection, similarity

from orip.prelim import growing_block, rays
from orip.prelim.relative import given_scale, solution
from orip.prelim.resection import resection as photo
from orip.prelim.resection import start
from orip.prelim.similarity import adjustment, joining, partial_blocks
from orip.prelim.similarity import start as similarity_start

REFERENCES = (
    (adjustment, "_adjustment", similarity._adjustment),
    (photo, "_fit_all", lambda seen, _found: range(len(seen.starts) - 1)),
    (given_scale, "_adjusted", relative._adjusted),
    (given_scale, "_at_scale", relative._at_scale),
    (growing_block, "_residual_lengths", intersections._residual_lengths),
    (rays, "_intersected", intersections._intersected),
    (rays, "_with_consensus", intersections._with_consensus),
    (joining, "_found", lambda source, target, names: joining._Joint(source, target, names).found()),
    (partial_blocks, "_assembled", similarity._assembled),
    (partial_blocks, "_places", similarity._places),
    (photo, "_solution_at_once", lambda _given: None),
    (similarity_start, "_best_of", similarity._best_of),
    (solution, "_solution", relative._solution),
    (start, "_best_orientations", resection._side_by_side),
    (start, "_of_triples", resection._of_triples),
)
"""Functions that call compiled loops: the module, the name, and what does the same with NumPy."""


@pytest.fixture
def without_loops(monkeypatch: pytest.MonkeyPatch):
    """Return what does something once with the loops and once with NumPy."""

    def both(do):
        with_loops = do()
        for module, name, reference in REFERENCES:
            monkeypatch.setattr(module, name, reference)
        return with_loops, do()

    return both
