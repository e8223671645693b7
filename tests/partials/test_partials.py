"""Every partial against a numerical derivative, and a case for every function that returns partials."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

import cases
import numpy as np
import pytest

import orip

CASES = cases.all_cases()

TOLERANCE = 1e-7
"""Of the largest partial of a column.

Two central differences with steps h and h/2 are extrapolated to h = 0, which leaves an error of the fourth order: with
steps of a thousandth of what bends the function, 1e-12 of the derivative. Rounding leaves 1e-9 of it: coordinates of
some thousand metres are rounded to 1e-12, and steps move the values by 1e-3. Any wrong sign, factor or missing term of
the coefficients used here is off by 1e-5 or more.
"""

NOTHING = 1e-14
"""What sums of products of sines and cosines leave of a partial that is zero."""

LONGEST_STEP = 0.05
"""Of a variable without influence, in units of the variable."""


def numerical_column(case: cases.Case, column: int) -> np.ndarray:
    largest = np.abs(case.partials[:, column]).max()
    step = case.move / largest if largest * LONGEST_STEP > case.move else max(LONGEST_STEP, case.move)

    def central(half_width: float) -> np.ndarray:
        change = np.zeros_like(case.at)
        change[column] = half_width
        return (case.value(case.at + change) - case.value(case.at - change)) / (2.0 * half_width)

    return (4.0 * central(step / 2.0) - central(step)) / 3.0


@pytest.mark.parametrize("case", CASES, ids=str)
def test_partials_are_those_of_central_differences(case):
    for column in range(len(case.at)):
        expected = numerical_column(case, column)
        largest = max(np.abs(expected).max(), np.abs(case.partials[:, column]).max())
        worst = np.abs(case.partials[:, column] - expected).max()
        assert worst <= TOLERANCE * largest + NOTHING, f"variable {column}: off by {worst:.1e} of {largest:.1e}"


def functions_with_partials() -> set[str]:
    """Return the full names of all functions and methods of orip that return partials, abstract ones left out."""
    found = set()
    for info in pkgutil.walk_packages(orip.__path__, "orip."):
        if info.name.rpartition(".")[2] == "__main__":
            continue
        module = importlib.import_module(info.name)
        owners = [module, *(each for _, each in inspect.getmembers(module, inspect.isclass))]
        for owner in owners:
            for name, function in vars(owner).items():
                if name.endswith(cases.SUFFIX) and inspect.isfunction(function) and _is_own(function):
                    found.add(cases.full_name(function))
    return found


def _is_own(function: object) -> bool:
    return function.__module__.startswith("orip.") and not getattr(function, "__isabstractmethod__", False)


def test_completeness():
    missing = functions_with_partials() - {case.of for case in CASES}
    assert not missing, f"without a case in tests/partials/cases.py: {', '.join(sorted(missing))}"


def test_scan_finds_functions_and_methods():
    found = functions_with_partials()
    assert "orip.geometry.perspective.perspective_with_partials" in found
    assert "orip.bundle.kinds.photo_point.PhotoPointObservations.linearise_with_partials" in found


def test_every_kind_of_observation_occurs_in_a_block():
    counts = np.zeros(len(cases.KINDS), dtype=int)
    for block in cases.blocks().values():
        counts += [len(each.rows.observed) for each in cases.observations_of(block)[1]]
    without = [kind.observe.__name__ for kind, count in zip(cases.KINDS, counts, strict=True) if not count]
    assert not without, f"add observations to the blocks of tests/partials/cases.py: {', '.join(without)}"
