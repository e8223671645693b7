"""How results of several kernels are compared: what differs is seen, whatever stands in the result."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from kernels.processor import Kernel, different
from kernels.sample_results import disagreement

RESULT: dict[str, Any] = {
    "cameras": {"CAM": {"C": {"value": 35.0, "sd": 0.01}, "A1": {"value": 0.0, "sd": None}}},
    "photos": {"1": {"X0": {"value": 100.0, "sd": 0.1}, "camera": "CAM"}},
    "points": {"P": {"X": {"value": -7.0, "sd": 0.02}, "rays": 2, "kind": "tie"}},
}


def changed(group: str, name: str, kind: str, **figures: float | None) -> dict[str, Any]:
    result = copy.deepcopy(RESULT)
    result[group][name][kind] |= figures
    return result


def test_a_result_agrees_with_itself() -> None:
    assert disagreement(RESULT, RESULT).size == 0.0


@pytest.mark.parametrize(
    ("other", "size", "name"),
    [
        (changed("photos", "1", "X0", value=100.0 + 1e-10), 1e-9, "photos.1.X0"),
        (changed("points", "P", "X", sd=0.020002), 1e-4, "points.P.X"),
        (changed("cameras", "CAM", "A1", value=1e-12), float("inf"), "cameras.CAM.A1"),
        (changed("cameras", "CAM", "C", sd=None), float("inf"), "cameras.CAM.C"),
        (RESULT | {"points": {}}, float("inf"), "points.P.X"),
    ],
)
def test_differences_are_in_standard_deviations(other: dict[str, Any], size: float, name: str) -> None:
    found = disagreement(RESULT, other)
    assert found.size == pytest.approx(size, rel=1e-3)
    assert found.name == name


def test_names_of_the_same_kernels_count_once_and_those_that_cannot_be_run_not_at_all() -> None:
    tried = [Kernel("Zen", "Haswell"), Kernel("Haswell", "Haswell"), Kernel("SkylakeX", ""), Kernel("Atom", "Nehalem")]
    assert [kernel.name for kernel in different(tried)] == ["Zen", "Atom"]
