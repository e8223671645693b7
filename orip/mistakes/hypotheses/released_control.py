"""Single control points whose coordinates are wrong: the block without them shows where they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.after_adjustment.contradicting_control import control_warnings
from orip.mistakes.hypotheses.hypothesis import Hypothesis
from orip.records.block import Block
from orip.structs import replace


def released_control(block: Block, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield control points, one at a time, as tie points.

    Parameters
    ----------
    block : Block
    names : sequence of str
        Control points that are doubted, the worst first.
    """
    for name in names:
        changed = without_control(block, [name])
        yield Hypothesis(changed, partial(_findings, block=block, name=name))


def without_control(block: Block, names: Sequence[str]) -> Block:
    """Return a block with some of its control points as tie points."""
    place = block.point_index()
    constant = block.constant_points.copy()
    constant[[place[name] for name in names]] = False
    points = tuple(point for point in block.control_points if point.name not in names)
    return replace(block, control_points=points, constant_points=constant)


def _findings(solved: SolvedBlock, block: Block, name: str) -> list[ProjectWarning]:
    """Return how the coordinates as given differ from those found; nothing if they do not."""
    row = block.point_index()[name]
    sd = solved.deviation_scale * np.sqrt(np.diag(solved.cofactors_of(solved.problem.unknowns.points[row])))
    found = block.ground.to_project(solved.state.points[[row]])[0]
    return control_warnings(block, {name: (found, sd)})
