"""Judging a self-calibration: which camera parameters are significant, and which can be determined at all.

Distortion parameters and the readout are tested against zero (Fisher's F on k and f degrees of freedom), P1 and P2
together, the others alone; of A3, A5, A7 and A9, which depend on each other, only the highest order may be removed, and
the rest is tested again without it. C, DX and DY are never tested: zero has no meaning there. The additional parameters
of a set are orthogonal by construction and are tested one by one; there, one that the other unknowns explain by more
than nine tenths, or that spoils the points, is not determinable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.special import fdtri

from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT, set_names
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, OWN_PARAMETERS, Camera, first_of_lens
from orip.records.observation_kinds import ADDITIONAL_PARAMETER
from orip.records.results.solution import Diagnosis
from orip.structs import replace

ALPHA = 0.05
MOST_LOST_DIGITS = 5.0
"""A parameter that loses more digits to the other unknowns is not determinable in practice."""

MOST_CORRELATION = 0.90
"""Square of the multiple correlation above which an additional parameter is not determinable."""

MOST_OF_TRACE = 0.10
"""Part of the trace of the points' cofactors that one additional parameter may contribute."""

Verdict = Literal["significant", "not significant", "not determinable"]

_GROUPS = (("A1",), ("A3",), ("A5",), ("A7",), ("A9",), ("P1", "P2"), ("B1",), ("B2",), ("READOUT",))
_HIGHER_ORDERS = {"A3": {"A5", "A7", "A9"}, "A5": {"A7", "A9"}, "A7": {"A9"}}
"""The radial parameters of higher order that are removed before each one."""


class ParameterTest(Struct, frozen=True):
    """The test of one group of a camera's distortion parameters.

    Parameters
    ----------
    parameters : tuple of str
        Those of the group that are unknown.
    statistic, limit : float
        Roots of F and of its quantile: for one parameter |a| / sd and the two-sided limit of Student's t.
    lost_digits : float
        The most that a parameter of the group loses to the other unknowns.
    """

    camera: str
    parameters: tuple[str, ...]
    statistic: float
    limit: float
    lost_digits: float
    verdict: Verdict


def parameter_tests(solved: SolvedBlock) -> tuple[ParameterTest, ...]:
    """Return the tests of all unknown distortion parameters; none without redundancy."""
    if solved.variance.redundancy <= 0:
        return ()
    found = []
    first = first_of_lens(solved.block.cameras)
    for row, (camera, columns) in enumerate(zip(solved.block.cameras, solved.problem.unknowns.cameras, strict=True)):
        for group in _GROUPS:
            is_tested = first[row] == row or group[0] in OWN_PARAMETERS  # a lens is tested once
            unknown = [kind for kind in group if is_tested and columns[CAMERA_PARAMETERS.index(kind)] != CONSTANT]
            if unknown:
                found.append(_test(solved, camera, unknown, columns))
    return (*found, *_additional_tests(solved))


def _additional_tests(solved: SolvedBlock) -> Iterator[ParameterTest]:
    """Return the tests of the additional parameters of all cameras, one by one."""
    unknowns = solved.problem.unknowns.additional
    places = np.argwhere(unknowns != CONSTANT)
    if not len(places):
        return
    columns = unknowns[unknowns != CONSTANT]
    cofactor = solved.cofactors.reduced.diagonal()[columns]
    from_photos = solved.normals.scale[columns] ** 2 - 1.0 / _a_priori_errors(solved) ** 2
    unexplained = 1.0 / np.maximum(from_photos * cofactor, 1.0)
    spoiling = _share_of_trace(solved, columns, cofactor) > MOST_OF_TRACE
    limit = float(np.sqrt(fdtri(1, solved.variance.redundancy, 1.0 - ALPHA)))
    for index, (row, place) in enumerate(places):
        camera = solved.block.cameras[row]
        value = solved.state.additional[row, place]
        statistic = float(abs(value) / np.sqrt(cofactor[index]) / solved.deviation_scale)
        verdict: Verdict = "significant" if statistic > limit else "not significant"
        if 1.0 - unexplained[index] > MOST_CORRELATION or spoiling[index]:
            verdict = "not determinable"
        name = set_names(camera)[place]
        yield ParameterTest(camera.name, (name,), statistic, limit, float(-np.log10(unexplained[index])), verdict)


def _a_priori_errors(solved: SolvedBlock) -> FloatArray:
    rows = next(kind.rows for kind in solved.problem.observations if kind.rows.kind == ADDITIONAL_PARAMETER)
    return rows.error


def _share_of_trace(solved: SolvedBlock, columns: NDArray[np.int64], cofactor: FloatArray) -> FloatArray:
    """Return the part (k,) of the trace of the points' cofactors that each parameter contributes (trace test)."""
    unit = np.zeros((solved.problem.layout.size, len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    spread = solved.normals.solve(unit)[solved.problem.layout.reduced :]
    trace = float(np.einsum("bii->", solved.cofactors.blocks))
    return np.asarray(np.sum(spread**2, axis=0) / cofactor / trace) if trace > 0.0 else np.zeros(len(columns))


def _test(solved: SolvedBlock, camera: Camera, parameters: list[str], columns: NDArray[np.int64]) -> ParameterTest:
    places = [CAMERA_PARAMETERS.index(kind) for kind in parameters]
    unknowns = columns[places]
    cofactor = solved.cofactors.reduced[np.ix_(unknowns, unknowns)]
    row = [record.name for record in solved.block.cameras].index(camera.name)
    values = solved.state.cameras[row, places]
    normals = solved.normals
    lost = max(digits_lost(solved, int(column)) for column in unknowns)
    limit = float(np.sqrt(fdtri(len(unknowns), solved.variance.redundancy, 1.0 - ALPHA)))
    if normals.removed[unknowns].any() or lost > MOST_LOST_DIGITS:
        return ParameterTest(camera.name, tuple(parameters), float("nan"), limit, lost, "not determinable")
    # scaled to unit diagonal: coefficients of different orders differ by many decades
    scale = np.sqrt(np.diag(cofactor))
    scaled = values / scale
    quantity = float(scaled @ np.linalg.solve(cofactor / np.outer(scale, scale), scaled))
    statistic = float(np.sqrt(quantity / len(unknowns))) / solved.deviation_scale
    verdict: Verdict = "significant" if statistic > limit else "not significant"
    return ParameterTest(camera.name, tuple(parameters), statistic, limit, lost, verdict)


def digits_lost(solved: SolvedBlock, column: int) -> float:
    """Return log10(N_jj Q_jj), with 1 / (N_jj Q_jj) = 1 - multiple correlation squared with all other unknowns."""
    normals = solved.normals
    if normals.removed[column]:
        return float(normals.lost_digits[column])
    product = normals.scale[column] ** 2 * solved.cofactors.reduced[column, column]
    return float(np.log10(product)) if product > 0.0 else 0.0


def calibration_diagnosis(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Return a diagnosis of each parameter that is not significant or not determinable."""
    tests = parameter_tests(solved)
    candidates = removable(tests)
    for test in tests:
        if test.verdict == "significant":
            continue
        names = ", ".join(test.parameters)
        where, (is_, it) = f"camera {test.camera}", ("is", "it") if len(test.parameters) == 1 else ("are", "them")
        if test.verdict == "not determinable":
            text = f"{names} of {where} hardly differs from the other unknowns ({test.lost_digits:.1f} digits lost)"
        else:
            text = f"{names} of {where} {is_} not significant ({test.statistic:.2f}, limit {test.limit:.2f})"
        remedy = f"hold {it} at zero, or let 'orip solve --prune' do so"
        if test not in candidates:
            remedy = "judge it again when the higher orders are held at zero"
        yield Diagnosis("not-significant", where, text, remedy)


def removable(tests: tuple[ParameterTest, ...]) -> list[ParameterTest]:
    """Return the tests of parameters that may be removed, the worst first; of radial ones only the highest order."""
    unknown: dict[str, set[str]] = {}
    for test in tests:
        unknown.setdefault(test.camera, set()).update(test.parameters)
    failed = [
        test
        for test in tests
        if test.verdict != "significant"
        and not any(_HIGHER_ORDERS.get(name, set()) & unknown[test.camera] for name in test.parameters)
    ]
    return sorted(failed, key=_worth)


def _worth(test: ParameterTest) -> float:
    return -test.lost_digits if test.verdict == "not determinable" else test.statistic / test.limit


class Pruned(Struct, frozen=True):
    """A block whose cameras have only significant parameters, and the tests of the removed ones in order."""

    solved: SolvedBlock
    removed: tuple[ParameterTest, ...]


def prune(solved: SolvedBlock, solve_again: Callable[[Block], SolvedBlock]) -> Pruned:
    """Hold the worst parameter at zero and adjust again, until all remaining parameters are significant.

    Parameters
    ----------
    solve_again : callable
        Adjusts a block whose cameras have fewer unknowns.
    """
    removed: list[ParameterTest] = []
    while worst := removable(parameter_tests(solved)):
        removed.append(worst[0])
        solved = solve_again(_without(solved, worst[0]))
    return Pruned(solved, tuple(removed))


def pruning_diagnosis(removed: Sequence[ParameterTest]) -> Iterator[Diagnosis]:
    """Return a diagnosis for each parameter that pruning holds at zero, in the order of removal."""
    for test in removed:
        names = ", ".join(test.parameters)
        where = f"camera {test.camera}"
        if test.verdict == "not determinable":
            why = f"the other unknowns explain it ({test.lost_digits:.1f} digits lost)"
        else:
            why = f"it is not significant ({test.statistic:.2f}, limit {test.limit:.2f})"
        text = f"{names} of {where} was held at zero: {why}"
        of_a_set = "." in names
        remedy = (
            "solve with --prune again" if of_a_set else "take it out of the camera's unknown parameters in orip.toml"
        )
        yield Diagnosis("pruned", where, text, remedy)


def _without(solved: SolvedBlock, test: ParameterTest) -> Block:
    """Return the block with parameters constant at zero, starting from the adjusted values."""
    state, block = solved.state, solved.block
    cameras = []
    for camera, values in zip(block.cameras, state.cameras.tolist(), strict=True):
        gone = test.parameters if camera.name == test.camera else ()
        parameters = tuple(
            0.0 if kind in gone else value for kind, value in zip(CAMERA_PARAMETERS, values, strict=True)
        )
        unknown = tuple(kind for kind in camera.unknown if kind not in gone)
        cameras.append(replace(camera, parameters=parameters, unknown=unknown))
    return replace(
        block,
        cameras=tuple(cameras),
        photo_orientation=np.hstack([state.centres, state.angles()]),
        point_start=state.points,
        held_additional=block.held_additional | {(test.camera, name) for name in test.parameters},
    )
