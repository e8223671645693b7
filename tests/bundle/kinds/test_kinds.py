"""Kinds of observation: the table of their names and units, and the equations that are made of them."""

from __future__ import annotations

import pytest
from bundle.aerial_block import aerial_block

from orip.bundle.kinds.all_kinds import KINDS
from orip.bundle.problem import pose_problem
from orip.records.observation_kinds import OBSERVATION_KINDS, unit_of_observation


def test_every_kind_with_equations_is_in_the_table_and_the_other_way_round() -> None:
    problem = pose_problem(aerial_block("kinds").block)
    assert [observation.rows.kind for observation in problem.observations] == list(OBSERVATION_KINDS.values())
    assert len(KINDS) == len(OBSERVATION_KINDS)


@pytest.mark.parametrize(
    ("kind", "component", "unit"),
    [
        ("photo", "x", "mm"),
        ("control", "Z", "foot"),
        ("additional", "EBNER.1", ""),
        ("element", "C", "mm"),
        ("element", "A3", "mm^-2"),
        ("element", "Z0", "foot"),
        ("element", "X", "foot"),
        ("element", "KAPPA", "degrees"),
        ("element", "R", "degrees"),
        ("constant element", "PHI", "degrees"),
        ("constant element", "X0", "foot"),
        ("distance", "XY", "foot"),
        ("constant distance", "XYZ", "foot"),
        ("direction", "zenith", "degrees"),
    ],
)
def test_unit_of_an_observation_follows_from_its_kind(kind: str, component: str, unit: str) -> None:
    assert unit_of_observation(kind, component, "foot") == unit
