"""Pruning: parameters that nothing needs are held at zero, those that are real stay."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import OFF, noisy, redefined, solved
from support.synthetic_block import synthetic_block

from orip.bundle.calibration import parameter_tests, prune, removable
from orip.records.camera import CAMERA_PARAMETERS
from orip.structs import replace

RADIAL = (0.0, -3e-2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""A3 alone, with half the frame as unit of length."""


def calibrated(seed, unknown, distortion=RADIAL):
    made = synthetic_block("convergent", "prune", distortion=distortion, unknown=unknown, **OFF)
    return made, solved(noisy(made, seed))


def pruned(found):
    result = prune(found, solved)
    return result, [name for test in result.removed for name in test.parameters]


def test_a_useless_a7_goes_and_a_real_a3_stays():
    a3, a7 = CAMERA_PARAMETERS.index("A3"), CAMERA_PARAMETERS.index("A7")
    useless = 0
    for seed in range(20):
        made, found = calibrated(seed, ("C", "A3", "A5", "A7"))
        result, gone = pruned(found)
        assert "A3" not in gone
        assert removable(parameter_tests(result.solved)) == []
        state, camera = result.solved.state, result.solved.block.cameras[0]
        assert "A3" in camera.unknown
        if gone[:1] == ["A7"]:
            useless += 1
            assert state.cameras[0, a7] == 0.0
            assert "A7" not in camera.unknown
        if gone == ["A7", "A5"]:
            column = result.solved.problem.unknowns.cameras[0, a3]
            sd = np.sqrt(result.solved.cofactors.reduced[column, column])
            assert abs(state.cameras[0, a3] - made.cameras[0, a3]) < 4.0 * sd
    # one in twenty is significant by chance
    assert useless >= 16


def test_of_all_radial_terms_the_highest_order_goes_first():
    _, found = calibrated(3, ("C", "A3", "A5", "A7", "A9"))
    assert {test.parameters for test in removable(parameter_tests(found))} <= {("A9",)}
    _, gone = pruned(found)
    assert gone[:2] == ["A9", "A7"]
    assert "A3" not in gone


def test_c_and_the_principal_point_are_never_tested():
    _, found = calibrated(1, ("C", "DX", "DY"))
    assert parameter_tests(found) == ()
    assert pruned(found)[1] == []


def test_decentring_goes_as_a_pair_and_stays_as_a_pair():
    _, without = calibrated(2, ("C", "DX", "DY", "A3", "P1", "P2"))
    assert {"P1", "P2"} <= set(pruned(without)[1])
    _, real = calibrated(2, ("C", "A3", "P1", "P2"), (0.0, -3e-2, 0.0, 0.0, 0.0, 4e-3, -4e-3, 0.0, 0.0))
    assert pruned(real)[1] == []


def test_affinity_that_is_real_stays():
    _, real = calibrated(3, ("C", "A3", "B1", "B2"), (0.0, -3e-2, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3, 1e-3))
    assert pruned(real)[1] == []
    _, without = calibrated(3, ("C", "A3", "B1", "B2"))
    assert set(pruned(without)[1]) <= {"B1", "B2"}
    assert len(pruned(without)[1]) >= 1


@pytest.mark.slow
def test_significance_is_what_alpha_says():
    significant = total = 0
    for seed in range(40):
        _, found = calibrated(100 + seed, ("C", "A3", "B1", "B2"))
        tests = {test.parameters: test for test in parameter_tests(found)}
        assert tests["A3",].verdict == "significant"
        for name in ("B1", "B2"):
            significant += tests[name,].verdict == "significant"
            total += 1
    # 5 % of 80 by chance: 4 ± 2, five standard deviations allowed
    assert significant <= 14


def test_a_parameter_of_a_set_that_nothing_needs_goes_and_a_real_one_stays():
    made = aerial_block("prune", 9)
    block = redefined(noisy(made, 5), **OFF)
    base = 0.4 * 230.0
    x, y = block.photo_points.xy.T
    bent = block.photo_points.xy + np.stack([0.03 * x * (y * y - 2.0 * base**2 / 3.0) / (base**3 / 3.0), 0.0 * x], 1)
    block = replace(
        block,
        photo_points=replace(block.photo_points, xy=bent),
        cameras=(replace(block.cameras[0], additional_set="EBNER"),),
    )
    result, gone = pruned(solved(block))
    assert "EBNER.7" not in gone
    assert len(gone) >= 8
    assert len(gone) == len(set(gone))
    assert result.solved.variance.sigma0 == pytest.approx(1.0, abs=0.1)
