"""Single control points whose coordinates are wrong: the block without them tells where they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from orip.bundle.solve import SolvedBlock
from orip.mistakes.after_adjustment.contradicting_control import control_warnings
from orip.mistakes.hypotheses.hypothesis import Hypothesis
from orip.records.block import Block


def released_control(block: Block, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield control points, one at a time, as tie points.

    Parameters
    ----------
    block : Block
    names : sequence of str
        Control points that are doubted, the worst first.
    """
    place = block.point_index()
    for name in names:
        constant = block.constant_points.copy()
        constant[place[name]] = False
        points = tuple(point for point in block.control_points if point.name != name)
        changed = replace(block, control_points=points, constant_points=constant)
        text = partial(_text, block=block, name=name)
        yield Hypothesis("contradicting-control", f"control point {name}", changed, text)


def _text(solved: SolvedBlock, block: Block, name: str) -> str:
    """Return how the coordinates as given differ from those found; "" if they do not."""
    row = block.point_index()[name]
    sd = solved.deviation_scale * np.sqrt(np.diag(solved.cofactors_of(solved.problem.unknowns.points[row])))
    found = block.ground.to_project(solved.state.points[[row]])[0]
    return "".join(warning.text for warning in control_warnings(block, {name: (found, sd)}))
