"""Simulated blocks scatter as their standard deviations say, unknown by unknown.

Each study adjusts one design again and again with new normal errors. The squares of an unknown's errors, divided by
its cofactor, sum up to a chi-square variable with as many degrees of freedom as there are runs; the mean error, divided
by its standard deviation, is normal. Both are tested for every unknown at a family-wise level of 0.001 (Bonferroni).
The figures of the long studies are in docs/monte-carlo.md; `--log-cli-level=INFO` shows them.
"""

from __future__ import annotations

import logging
from functools import cache

import numpy as np
import pytest
from monte_carlo.simulated_blocks import (
    NO_DOWN_WEIGHTING,
    design,
    in_parallel,
    random_numbers,
    solved,
    started_off,
    with_noise,
)
from msgspec import Struct
from scipy import stats
from scipy.spatial.transform import Rotation
from support.synthetic_block import DISTORTED, SyntheticBlock

from orip.adjustment.convergence import TerminationReason
from orip.bundle.solve import SolvedBlock
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT
from orip.structs import replace

LOG = logging.getLogger(__name__)

FAMILY = 0.001

STUDIES = {
    "control, aerial": ("aerial", {}),
    "control, phi = ±90": ("terrestrial", {}),
    "free, aerial": ("aerial", {"datum": "free"}),
    "free, convergent": ("convergent", {"datum": "free"}),
    "free, three datum points": ("convergent", {"datum": "free", "datum_points": ("101", "112", "125")}),
    "self-calibrating": (
        "convergent",
        {"unknown": ("C", "DX", "DY", "A3", "A5", "P1", "P2", "B1", "B2"), "distortion": DISTORTED},
    ),
    "self-calibrating, distortion at measured": (
        "convergent",
        {
            "unknown": ("C", "DX", "DY", "A3", "P1", "P2"),
            "distortion": DISTORTED,
            "distortion_at": "measured",
            "precision_mm": 0.001,
        },
    ),
}
"""Photo coordinates are good to 5 µm, but to 1 µm where the distortion's argument is measured: its errors are then
errors of the design matrix, and at 5 µm show in the principal point (docs/monte-carlo.md)."""


class Run(Struct, frozen=True):
    """Errors of all unknowns divided by their standard deviations (for sigma0 = 1), and the figures of the whole."""

    normalised: np.ndarray
    square_sum: float
    redundancy: int
    sum_of_redundancy_numbers: float
    converged: bool


@cache
def exact(study: str) -> SyntheticBlock:
    scene, settings = STUDIES[study]
    return design(scene, study, **NO_DOWN_WEIGHTING, **settings)


def run_once(case: tuple[str, int]) -> Run:
    study, run = case
    made, random = exact(study), random_numbers(study, run)
    found = solved(started_off(with_noise(made, random), made, 0.001, random))
    equations = found.equations
    return Run(
        normalised=errors_of(found, made) / standard_deviations(found),
        square_sum=float(np.sum(equations.residual[equations.active] ** 2)),
        redundancy=found.variance.redundancy,
        sum_of_redundancy_numbers=float(np.nansum(found.variance.redundancy_numbers)),
        converged=found.reason is TerminationReason.CONVERGED,
    )


def standard_deviations(found: SolvedBlock) -> np.ndarray:
    """Return the roots of the cofactors of cameras, photos and points, of their unknowns alone."""
    blocks = np.einsum("bii->bi", found.cofactors.blocks).ravel()
    diagonal = np.concatenate([np.diag(found.cofactors.reduced), blocks])
    return np.sqrt(diagonal[columns_of(found)])


def columns_of(found: SolvedBlock) -> np.ndarray:
    unknowns = found.problem.unknowns
    columns = np.concatenate([unknowns.cameras.ravel(), unknowns.photos.ravel(), unknowns.points.ravel()])
    return columns[columns != CONSTANT]


def errors_of(found: SolvedBlock, made: SyntheticBlock) -> np.ndarray:
    """Return adjusted minus true of the same unknowns, rotations about the ground axes.

    A free network is first fitted to the truth, by its datum points: its own datum is that of the starting values.
    """
    unknowns, state = found.problem.unknowns, found.state
    if found.problem.datum is not None:
        state = laid_upon(state, made.points, found.problem.datum.points)
    true_rotations = Rotation.from_euler("XYZ", made.orientations[:, 3:]).as_matrix()
    turned = Rotation.from_matrix(state.rotations @ np.swapaxes(true_rotations, 1, 2)).as_rotvec()
    errors = [
        state.cameras - made.cameras,
        np.hstack([state.centres - made.orientations[:, :3], turned]),
        state.points - made.points,
    ]
    columns = np.concatenate([unknowns.cameras.ravel(), unknowns.photos.ravel(), unknowns.points.ravel()])
    return np.concatenate([error.ravel() for error in errors])[columns != CONSTANT]


def laid_upon(state: BlockState, points: np.ndarray, datum: np.ndarray) -> BlockState:
    """Return the state moved, turned and scaled so that its datum points fit best."""
    from_mean, to_mean = state.points[datum].mean(axis=0), points[datum].mean(axis=0)
    offset, wanted = state.points[datum] - from_mean, points[datum] - to_mean
    u, values, vt = np.linalg.svd(wanted.T @ offset)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    scale = float(np.sum(values) / np.sum(offset**2))

    def moved(xyz: np.ndarray) -> np.ndarray:
        return to_mean + scale * (xyz - from_mean) @ rotation.T

    return replace(
        state, points=moved(state.points), centres=moved(state.centres), rotations=rotation @ state.rotations
    )


def judge(study: str, runs: int, processes: int) -> None:
    found = in_parallel(run_once, [(study, run) for run in range(runs)], processes)
    assert all(run.converged for run in found)
    missing = max(abs(run.sum_of_redundancy_numbers - run.redundancy) for run in found)
    normalised = np.array([run.normalised for run in found])
    count = normalised.shape[1]
    squares = np.sum(normalised**2, axis=0)
    shift = normalised.mean(axis=0) * np.sqrt(runs)
    spread = two_sided(stats.chi2(runs).cdf(squares))
    bias = two_sided(stats.norm.cdf(shift))
    whole = sum(run.square_sum for run in found)
    freedom = sum(run.redundancy for run in found)
    ratios = np.sqrt(squares / runs)
    LOG.info(
        "%s: %d runs, %d unknowns, redundancy %d; scatter over standard deviation %.3f to %.3f, all together %.4f; "
        "smallest p of scatter %.2g, of bias %.2g, limit %.2g; sigma0 %.4f; sum of r off by %.1e",
        *(study, runs, count, found[0].redundancy, ratios.min(), ratios.max(), np.sqrt(np.mean(ratios**2))),
        *(spread.min(), bias.min(), FAMILY / count, np.sqrt(whole / freedom), missing),
    )
    assert missing < 1e-8
    assert spread.min() > FAMILY / count
    assert bias.min() > FAMILY / count
    assert two_sided(stats.chi2(freedom).cdf(whole)) > FAMILY


def two_sided(below: np.ndarray | float) -> np.ndarray | float:
    return 2.0 * np.minimum(below, 1.0 - below)


@pytest.mark.parametrize("study", STUDIES)
def test_errors_scatter_as_the_standard_deviations_say(study):
    judge(study, 20, 1)


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("study", STUDIES)
def test_errors_of_1000_blocks_scatter_as_the_standard_deviations_say(study):
    judge(study, 1000, 2)
