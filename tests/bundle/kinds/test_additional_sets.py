"""Ebner's and Gruen's parameter sets take up a deformation of the image, and nothing where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import FRAME_MM, aerial_block
from bundle.solving import OFF, noisy, redefined, solution

from orip.structs import replace

MADE = aerial_block("sets", 13)
BASE = 0.4 * FRAME_MM
SETS = {"EBNER": 12, "GRUEN": 44}


def deformed(amount):
    """Return the block with x l and y k bending (Ebner's 7 and 9, from the published formulas), mm at the corners."""
    block = redefined(noisy(MADE, 1), **OFF)
    xy = block.photo_points.xy
    x, y = xy.T
    k, line = x * x - 2.0 * BASE**2 / 3.0, y * y - 2.0 * BASE**2 / 3.0
    unit = amount / (BASE**3 / 3.0)
    bent = xy + unit * np.stack([x * line + 0.5 * y * k, np.zeros_like(x)], axis=1)
    return replace(block, photo_points=replace(block.photo_points, xy=bent)), unit


def with_set(block, name):
    return replace(block, cameras=(replace(block.cameras[0], additional_set=name),))


@pytest.mark.parametrize("name", SETS)
def test_a_deformation_is_absorbed(name):
    block, _ = deformed(0.03)
    without, found = solution(block), solution(with_set(block, name))
    assert without.sigma0 > 1.5
    assert found.status == "converged"
    assert found.sigma0 == pytest.approx(1.0, abs=0.06)
    assert len(found.additional) == SETS[name]
    off = [np.sqrt(np.mean((solved.points.values - MADE.points) ** 2)) for solved in (without, found)]
    assert off[1] < 0.6 * off[0]
    assert abs(np.nansum(found.residuals.redundancy_number) - found.redundancy) < 1e-8


def test_parameters_of_ebner_are_those_of_the_deformation():
    block, unit = deformed(0.03)
    found = {parameter.name: parameter for parameter in solution(with_set(block, "EBNER")).additional}
    wanted = dict.fromkeys(found, 0.0) | {"EBNER.7": unit, "EBNER.9": 0.5 * unit}
    for name, value in wanted.items():
        assert found[name].value == pytest.approx(value, abs=4.0 * found[name].sd), name
    assert found["EBNER.7"].value > 20.0 * found["EBNER.7"].sd


@pytest.mark.parametrize("name", SETS)
def test_without_a_deformation_no_parameter_is_far_from_zero(name):
    found = solution(with_set(redefined(noisy(MADE, 2), **OFF), name))
    assert found.status == "converged"
    assert found.sigma0 == pytest.approx(1.0, abs=0.06)
    ratios = np.array([abs(parameter.value) / parameter.sd for parameter in found.additional])
    assert ratios.max() < 4.0
    assert found.singular == ()


def test_held_parameters_stay_zero_and_are_no_unknowns():
    block, _ = deformed(0.03)
    whole = with_set(block, "EBNER")
    held = frozenset(("CAM", f"EBNER.{number}") for number in range(1, 13) if number not in (7, 9))
    found, all_free = solution(replace(whole, held_additional=held)), solution(whole)
    assert found.unknowns == all_free.unknowns - 10
    values = {parameter.name: (parameter.value, parameter.sd) for parameter in found.additional}
    assert all(values[name][0] == 0.0 and np.isnan(values[name][1]) for _, name in held)
    assert found.sigma0 == pytest.approx(1.0, abs=0.06)
