"""The compiled loops over photo points refuse arguments that do not belong together, and write nowhere else."""

from __future__ import annotations

from datetime import datetime_CAPI  # type: ignore[attr-defined]
from typing import Any

import numpy as np
import pytest
from bundle.solving import with_photo_points
from bundle.test_banded_block import BLOCK as BANDED
from bundle.test_photo_loop import rolling, two_cameras_with_sets
from support.wrong_calls import call, functions_of, overlapping, recorded, written_by, wrong_calls

from orip.adjustment.normals import solve_normals
from orip.adjustment.precision import cofactors
from orip.bundle.compiled import photo_loop
from orip.bundle.problem import pose_problem
from orip.bundle.starting_state import starting_state
from orip.records.block import Block
from orip.structs import replace

pytestmark = pytest.mark.skipif(not photo_loop.is_compiled(), reason="the extension was not built: no compiler here")

OWN = 17
"""Where the arguments begin that each loop has for itself: orip/bundle/compiled/module.c."""
OF_CAMERA, OF_PHOTO, OF_POINT, ORDER, START, BLOCK_NUMBER, GROUP_START, RUNS_START, RUNS = range(3, 12)
"""Arguments of a layout."""
FUNCTIONS = (
    "layout", "turns", "residuals", "points", "right", "eliminate", "movements", "precision", "forward", "backward",
)  # fmt: skip
MAX_LOST = 12.0


def small_block() -> Block:
    """Return a free network: two cameras with sets, one of them a rolling shutter, and a few points."""
    block = rolling(two_cameras_with_sets())
    block = replace(block, definition=replace(block.definition, datum="free"), control_points=())
    return with_photo_points(block, np.flatnonzero(block.photo_points.point < 12))


def everything(block: Block) -> None:
    """Ask for all that the loops compute."""
    problem = pose_problem(block)
    state = starting_state(block)
    equations = problem.linearise(state)
    weights = np.ones(len(equations.residual))
    equations.rows.block_normals(weights, -equations.residual, problem.layout)
    equations.rows.right_side(weights, -equations.residual, problem.layout)
    normals = solve_normals(equations, weights, problem.layout, MAX_LOST)
    normals.solve(np.ones((problem.layout.size, 1)))
    cofactors(equations, normals, problem.inner_constraints(state))


@pytest.fixture(scope="module")
def calls() -> dict[str, list[Any]]:
    with pytest.MonkeyPatch.context() as patched:
        return recorded(photo_loop.compiled, lambda: everything(small_block()), patched)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_wrong_arguments(name: str, calls: dict[str, list[Any]]) -> None:
    assert_refused(name, calls[name])


@pytest.mark.parametrize("name", ["eliminate", "precision"])
def test_wrong_bands(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = recorded(photo_loop.compiled, lambda: everything(BANDED), monkeypatch)[name]
    assert_refused(name, arguments, OWN)


def assert_refused(name: str, arguments: list[Any], first: int = 0) -> None:
    """Assert that wrong arguments from the first one on are refused."""
    function = getattr(photo_loop.compiled, name)
    assert call(function, arguments) is None
    written = written_by(function, arguments)
    assert bool(written) == (name not in {"layout", "turns"})
    for wrong in (*wrong_calls(arguments, written, first), *overlapping(arguments, written)):
        fault = call(function, wrong.arguments)
        assert wrong.refused is None or (fault is not None) == wrong.refused, wrong.what


@pytest.mark.parametrize("place", [0, -1])
@pytest.mark.parametrize(
    "argument", [OF_CAMERA, OF_PHOTO, OF_POINT, ORDER, START, BLOCK_NUMBER, GROUP_START, RUNS_START, RUNS]
)
def test_indices_that_lead_elsewhere_are_refused(argument: int, place: int, calls: dict[str, list[Any]]) -> None:
    for number in (-1, 10**6, -(2**31), 2**31 - 1):
        arguments = copied(calls["layout"])
        arguments[argument][place] = number
        assert refused_by(arguments, calls["backward"]), number


def copied(arguments: list[Any]) -> list[Any]:
    """Return arguments with copies of their arrays."""
    return [given.copy() if isinstance(given, np.ndarray) else given for given in arguments]


def refused_by(indices: list[Any], backward: list[Any]) -> bool:
    """Return whether a layout, or a loop with it, is refused: how many points there are is known to the loop alone."""
    try:
        layout = photo_loop.compiled.layout(*indices)
    except ValueError:
        return True
    return isinstance(call(photo_loop.compiled.backward, [layout, *backward[1:]]), ValueError)


def test_a_photo_that_is_not_among_the_runs_of_its_group_is_refused(calls: dict[str, list[Any]]) -> None:
    """Its unknowns would be looked for without end."""
    arguments = copied(calls["layout"])
    arguments[RUNS][-1] = arguments[RUNS][-2]
    assert isinstance(call(photo_loop.compiled.layout, arguments), ValueError)


def test_places_beyond_the_reduced_system_are_refused(calls: dict[str, list[Any]]) -> None:
    cameras, photos = OWN - 2, OWN - 1
    for argument in (cameras, photos):
        arguments = copied(calls["backward"])
        arguments[argument].flat[0] = arguments[OWN + 2].size
        assert isinstance(call(photo_loop.compiled.backward, arguments), ValueError)


def test_indices_changed_after_they_were_checked_have_no_effect(calls: dict[str, list[Any]]) -> None:
    indices = copied(calls["layout"])
    layout = photo_loop.compiled.layout(*indices)
    found = []
    for wrong in (None, 2**31 - 1):
        for array in indices[:-1] if wrong else ():
            array[...] = min(wrong or 0, np.iinfo(array.dtype).max) if array.dtype != bool else True
        turns, *arrays, vectors = calls["backward"][1:]
        arguments = [given.copy() for given in arrays]
        photo_loop.compiled.backward(layout, turns, *arguments, vectors)
        found.append(arguments[-1])
    assert np.array_equal(*found)


def test_another_capsule_is_no_layout(calls: dict[str, list[Any]]) -> None:
    assert isinstance(call(photo_loop.compiled.backward, [datetime_CAPI, *calls["backward"][1:]]), TypeError)


def test_a_layout_of_another_block_is_refused(calls: dict[str, list[Any]]) -> None:
    with pytest.MonkeyPatch.context() as patched:
        other = recorded(photo_loop.compiled, lambda: everything(BANDED), patched)["backward"][0]
    assert isinstance(call(photo_loop.compiled.backward, [other, *calls["backward"][1:]]), ValueError)


@pytest.mark.parametrize("unknowns", [0, 3, 7, 10.5, 15])
def test_photos_have_six_unknowns_or_nine_or_twelve(unknowns: int, calls: dict[str, list[Any]]) -> None:
    assert isinstance(call(photo_loop.compiled.layout, [*calls["layout"][:-1], float(unknowns)]), ValueError)


def test_every_function_is_called(calls: dict[str, list[Any]]) -> None:
    assert set(calls) == set(functions_of(photo_loop.compiled)) == set(FUNCTIONS)
