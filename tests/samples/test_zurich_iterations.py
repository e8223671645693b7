"""The iterations of J.-H. Yom's thesis (Glasgow, 2000, appendix B), digit by digit.

The program of the thesis took plain Gauss-Newton corrections of the angles alpha, zeta and kappa, all of the same
weight, with camera and control constant, and printed its results after the tenth one. So do these tests, with orip's
equations: what was printed before the minimum was reached is then met to its last digit.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from samples.test_zurich import printed
from support.sample_projects import sample

import orip
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.starting_state import starting_state
from orip.bundle.state import BlockState, entries_at
from orip.structs import replace

OBSERVATIONS = 454
PRINTED = (4.2258, 1.9123, 0.77017, 0.27411, 0.13868, 0.10423, 0.077145, 0.072281, 0.072267, 0.072265)
"""sqrt(Σ vv / 454), mm, before each of the ten corrections."""

HALF_A_DIGIT = 0.00051
"""Of the third decimal, with the rounding of the printed figure's own computation."""


def about_x(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def about_z(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation from photo to ground of alpha, zeta, kappa (radians)."""
    alpha, zeta, kappa = angles
    return about_z(alpha) @ about_x(np.pi / 2.0 + zeta) @ about_z(-kappa)


def terrestrial_angles(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return alpha, zeta, kappa (radians) of a rotation from photo to ground."""
    return np.array(
        [
            np.arctan2(rotation[0, 2], -rotation[1, 2]),
            np.arccos(rotation[2, 2]) - np.pi / 2.0,
            np.arctan2(-rotation[2, 0], rotation[2, 1]),
        ]
    )


def axes_of(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes (columns, ground system) about which alpha, zeta and kappa turn a photo."""
    turned = about_z(angles[0])
    return np.column_stack([[0.0, 0.0, 1.0], turned[:, 0], -(turned @ about_x(np.pi / 2.0 + angles[1]))[:, 2]])


def corrected(problem: BlockProblem, state: BlockState, correction: NDArray[np.float64]) -> BlockState:
    """Return the state with the correction of alpha, zeta and kappa that belongs to orip's rotations."""
    unknowns = problem.unknowns
    turns = entries_at(correction, unknowns.photos[:, 3:])
    rotations = np.array(
        [
            rotation(angles + np.linalg.solve(axes_of(angles), turn))
            for angles, turn in zip(map(terrestrial_angles, state.rotations), turns, strict=True)
        ]
    )
    return replace(state.moved(correction, unknowns), rotations=rotations)


def iterations(problem: BlockProblem, state: BlockState) -> Iterator[tuple[float, BlockState]]:
    """Yield sqrt(Σ vv / n) before each correction, mm, and the state after it."""
    while True:
        equations = problem.linearise(state)
        used = equations.active
        error = problem.block.photo_points.error[0, 0]
        figure = error * np.sqrt(np.sum(equations.residual[used] ** 2) / OBSERVATIONS)
        design = equations.design.toarray()[used]
        scale = np.linalg.norm(design, axis=0)
        scale[scale == 0.0] = 1.0
        solved, *_ = np.linalg.lstsq(design / scale, -equations.residual[used], rcond=None)
        state = corrected(problem, state, solved / scale)
        yield float(figure), state


@pytest.fixture(scope="module")
def thesis(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[float], BlockState, orip.Solution]:
    folder = sample(Path(tmp_path_factory.mktemp("iterations")), "zurich_city_hall")
    solution = orip.open_project(folder).solve()
    problem = pose_problem(solution._solved.block)
    steps = iterations(problem, starting_state(problem.block))
    figures, states = zip(*(next(steps) for _ in PRINTED), strict=True)
    return list(figures), states[-1], solution


def test_angles_and_rotations_belong_together() -> None:
    angles = np.radians([[-40.0, 20.0, 100.0], [130.0, -5.0, -2.0]])
    for angle in angles:
        assert np.allclose(terrestrial_angles(rotation(angle)), angle, atol=1e-12)


def test_all_ten_printed_figures(thesis: tuple[list[float], BlockState, orip.Solution]) -> None:
    # printed with five significant digits; the third lies almost half way between two of them
    last_digit = 10.0 ** (np.floor(np.log10(PRINTED)) - 4.0)
    assert (np.abs(np.array(thesis[0]) - PRINTED) <= 0.51 * last_digit).all()


def test_all_printed_orientations(thesis: tuple[list[float], BlockState, orip.Solution]) -> None:
    _, state, solution = thesis
    rows = printed("zurich_printed_photos.csv")
    assert len(rows) == 15
    for row in rows:
        place = solution.photos.names.index(row["photo"])
        assert state.centres[place] == pytest.approx(
            [float(row[name]) for name in ("X0", "Y0", "Z0")], abs=HALF_A_DIGIT
        )
        wanted = [float(row[name]) for name in ("alpha", "zeta", "kappa")]
        difference = np.degrees(terrestrial_angles(state.rotations[place])) - wanted
        assert (difference + 180.0) % 360.0 - 180.0 == pytest.approx([0.0] * 3, abs=HALF_A_DIGIT), row["photo"]


def test_all_printed_points(thesis: tuple[list[float], BlockState, orip.Solution]) -> None:
    _, state, solution = thesis
    rows = printed("zurich_printed_points.csv")
    assert len(rows) == 45
    for row in rows:
        place = solution.points.names.index(row["point"])
        assert state.points[place] == pytest.approx([float(row[name]) for name in "XYZ"], abs=HALF_A_DIGIT), row[
            "point"
        ]
